// Shared by all scripts of the page: element building (text only ever enters as text nodes, so
// nothing in the data can become markup), number formats and colours.
"use strict";

const byId = id => document.getElementById(id);
const viscera = {};

viscera.element = function (tag, attributes, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value !== undefined && value !== null) node.setAttribute(name, value);
  }
  node.append(...children.filter(child => child !== null && child !== undefined));
  return node;
};

// Four significant digits without trailing zeros; grouping for large counts.
viscera.number = function (value) {
  if (value === null || value === undefined) return "none";
  if (typeof value !== "number") return String(value);
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (Number.isInteger(value)) {
    const text = size < 10000 ? String(value) : value.toLocaleString("en").replace(/,/g, "\u2009");
    return text.replace("-", "\u2212");
  }
  if (size < 1e-4 || size >= 1e7) {
    const [digits, exponent] = value.toExponential(2).split("e");
    return digits + "\u00a0×\u00a010" + superscript(Number(exponent));
  }
  if (size >= 1000) return viscera.number(Math.round(value));
  return String(Number(value.toPrecision(4))).replace("-", "\u2212");
};

function superscript(exponent) {
  return String(exponent).replace(/[-0-9]/g, c => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
}

const prettyUnits = {deg: "°", percent: "%", um: "µm", "m/s^2": "m/s²", "m/s2": "m/s²",
                     "kg/m^3": "kg/m³", "kg/m3": "kg/m³", "mm^3": "mm³", mm3: "mm³",
                     "mm^2": "mm²", mm2: "mm²"};
viscera.unit = unit => !unit || unit === "1" ? "" : prettyUnits[unit] || unit;

viscera.quantity = function (value, unit) {
  const shown = value === null ? "" : viscera.unit(unit);
  return viscera.number(value) + (shown === "" || shown === "°" ? shown : "\u00a0" + shown);
};

// "min_dihedral_deg" in "deg" reads "min dihedral": the unit stands with the value.
viscera.words = function (name, unit) {
  const suffix = unit && unit !== "1" ? "_" + unit.replace("/", "_") : "";
  const bare = suffix && name.endsWith(suffix) ? name.slice(0, -suffix.length) : name;
  return bare.replace(/_/g, " ");
};

// "min dihedral 9°, required ≥ 10°"
viscera.required = gate =>
  (gate.comparison === ">=" ? "≥ " : "≤ ") + viscera.quantity(gate.limit, gate.unit);
viscera.gateText = gate => `${viscera.words(gate.name, gate.unit)} ` +
  `${viscera.quantity(gate.value, gate.unit)}, required ${viscera.required(gate)}`;

// The longest of 1, 2, 5, 10, 20, … that is no longer than `length`.
viscera.roundLength = function (length) {
  const decade = 10 ** Math.floor(Math.log10(length));
  return [5, 2, 1].map(m => m * decade).find(l => l <= length);
};

viscera.bytes = function (count) {
  const step = count < 1e3 ? 0 : count < 1e6 ? 1 : count < 1e9 ? 2 : 3;
  return Number((count / 1000 ** step).toPrecision(3)) + "\u00a0" + ["B", "kB", "MB", "GB"][step];
};

viscera.seconds = function (s) {
  if (s < 60) return viscera.number(Number(s.toPrecision(3))) + "\u00a0s";
  return Math.floor(s / 60) + "\u00a0min " + Math.round(s % 60) + "\u00a0s";
};

// Into a table, or that with this id. `rows`: [{cells: [text or node], failed}]; `numeric`: all
// columns but the first hold numbers.
viscera.fillTable = function (id, headings, rows, numeric = true) {
  const table = typeof id === "string" ? byId(id) : id;
  const kind = i => numeric && i > 0 ? "number" : undefined;
  const head = viscera.element("tr", {}, ...headings.map((heading, i) =>
    viscera.element("th", {scope: "col", class: kind(i)}, heading)));
  table.append(viscera.element("thead", {}, head), viscera.element("tbody", {}, ...rows.map(row =>
    viscera.element("tr", {class: row.failed ? "failed" : undefined}, ...row.cells.map((cell, i) =>
      viscera.element(i === 0 ? "th" : "td", {class: kind(i)}, cell))))));
};

// The largest label takes a muted tissue colour; the others are Okabe and Ito's, told apart by
// colour-blind readers too. `labels` as in viewer.labels.
viscera.labelColours = function (labels) {
  const others = ["#e69f00", "#2f7fc1", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#d8c817"];
  const colours = new Map();
  const bySize = [...labels].sort((a, b) => b.rest_ml - a.rest_ml || a.id - b.id);
  bySize.forEach((label, i) => {
    colours.set(label.id, i === 0 ? "#c07a6c" : others[(i - 1) % others.length]);
  });
  return colours;
};

// Colour maps on [0, 1] as lists of evenly spaced stops: viridis for amounts, blue to red through
// light grey for deviations from the middle.
const maps = {
  amount: ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"],
  deviation: ["#2166ac", "#67a9cf", "#d1e5f0", "#f2f2f2", "#fddbc7", "#ef8a62", "#b2182b"],
};
const parsed = {};
for (const [name, stops] of Object.entries(maps)) {
  parsed[name] = stops.map(hex => [1, 3, 5].map(i => parseInt(hex.slice(i, i + 2), 16) / 255));
}
viscera.mapped = function (name, t, out, at) {
  const stops = parsed[name];
  const x = Math.min(Math.max(t, 0), 1) * (stops.length - 1);
  const i = Math.min(Math.floor(x), stops.length - 2), f = x - i;
  for (let k = 0; k < 3; ++k) out[at + k] = stops[i][k] * (1 - f) + stops[i + 1][k] * f;
};
