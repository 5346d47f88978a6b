// Everything on the page that is text: verdict, key figures, cost, metrics, provenance.
// What a report does not hold is left out, never shown empty.
"use strict";

const el = (...args) => viscera.element(...args);
const number = content => el("td", {class: "number"}, content);
const code = text => el("code", {}, text);
const stageTitles = {labels: "Labels", surface: "Surface", tetmesh: "Tet mesh",
                     simulate: "Simulation"};
const stageTitle = name => stageTitles[name] || viscera.words(name);

// Shows the section that holds `id` and fills the table: `head` texts (a leading "#" right-aligns),
// `rows` lists of cells.
function fillTable(id, head, rows) {
  const heads = head.map(text => text.startsWith("#")
    ? el("th", {scope: "col", class: "number"}, text.slice(1)) : el("th", {scope: "col"}, text));
  byId(id).replaceChildren(el("thead", {}, el("tr", {}, ...heads)),
                           el("tbody", {}, ...rows.map(cells => el("tr", {}, ...cells))));
  const section = byId(id).closest("section");
  if (rows.length) section.hidden = false;
}

const cell = content => el("td", {}, content);
const head = content => el("th", {scope: "row"}, content);

viscera.metric = function (report, stage, name) {
  const found = report.stages.find(s => s.stage === stage);
  const metric = found && found.metrics.find(m => m.name === name);
  return metric ? metric.value : undefined;
};

viscera.restTime = report => viscera.metric(report, "simulate", "rest_time");

// Why the run rested no sooner, or did not rest: the condition that came last, or those not met.
viscera.restReason = function (report) {
  const metric = name => viscera.metric(report, "simulate", name);
  const words = {
    loads: ["the loads ended last", "the loads had not ended"],
    "inverted tets": ["the last inverted tet opened last", "tets were inverted"],
    speed: ["the speed fell last", "the body was too fast"],
    residual: ["the residual force fell last", "forces were not in balance"],
  };
  const last = metric("rest_last_condition"), missing = metric("rest_missing");
  if (words[last]) return words[last][0];
  if (!Array.isArray(missing)) return viscera.restTime(report) === null ? "when the run ended" : null;
  if (!missing.length) return "the time was over before rest had been held";
  return "when the run ended " + missing.map(name => words[name] ? words[name][1] : name).join(", ");
};

// How far the body at rest is off, as a sentence; null where no simulation is told of.
viscera.errorBar = function (report) {
  if (!report.stages.some(s => s.stage === "simulate")) return null;
  const metric = name => viscera.metric(report, "simulate", name);
  const mm = value => viscera.quantity(Number(value.toPrecision(2)), "mm");
  const unknown = metric("error_bar_unknown"), total = metric("error_total");
  if (unknown) return "How far the body is off is not known: " + unknown + ".";
  if (typeof total !== "number") {
    return "How far the body is off was not asked for (simulate: certify): of its error one run " +
      "knows the solver's share alone.";
  }
  const share = viscera.quantity(Number((100 * metric("error_total_share")).toPrecision(2)), "percent");
  const centroids = Object.entries(metric("error_centroids") || {});
  const surface = metric("error_surface"), surfaceKnown = typeof surface === "number";
  return `At rest the body is off by ${mm(total)} (root mean square) or less, ${share} of its displacement: ` +
    `solver ${mm(metric("error_solver"))}, elements ${mm(metric("error_element"))}, ` +
    `mesh ${mm(metric("error_mesh"))}, supports ${mm(metric("error_support") ?? 0)}` +
    (surfaceKnown ? `, surface ${mm(surface)}` : "") + "; centroids: " +
    centroids.map(([label, off]) => `${label} ${mm(off)}`).join(", ") +
    `. Not in it: the ${surfaceKnown ? "labels'" : "surface's"} distance from the scan, the borders of loads, and whether materials and loads are right.`;
};

viscera.verdict = function (report) {
  const {state, gates_passed: passed, gates_failed: failed} = report.verdict;
  const all = passed + failed;
  const gates = all === 1 ? "The one quality gate" : `All ${all} quality gates`;
  const text = {
    passed: `✓ ${gates} passed`,
    failed: `✗ ${failed} of ${all} quality gates failed`,
    diverged: "✗ The simulation diverged",
    ungated: "No quality gates were evaluated",
  }[state];
  const box = byId("verdict");
  box.dataset.state = state;
  for (const caveat of report.verdict.caveats) {
    box.append(el("p", {class: "caveat"}, "⚠ " + caveat));
  }
  const errorBar = viscera.errorBar(report);
  if (errorBar) box.append(el("p", {}, errorBar));
  box.append(el("strong", {}, text), el("span", {class: "caution"}, "Not for clinical use"));
  const gateFailed = 5;  // the exit code whose message only names the gates
  for (const stage of report.stages.filter(s => s.message && s.exit !== gateFailed)) {
    box.append(el("p", {}, stageTitle(stage.stage) + ": " + stage.message));
  }
  viscera.failuresInShort(report, box);
};

viscera.keyFigures = function (report) {
  const figures = [];
  const add = (name, value, note) => {
    if (value !== undefined && value !== null) figures.push([name, value, note]);
  };
  const viewer = report.viewer;
  const labels = viewer ? viewer.labels : [];
  if (labels.length) {
    add("Volume", viscera.quantity(labels.reduce((sum, l) => sum + l.rest_ml, 0), "ml"),
        labels.length === 1 ? "1 material" : labels.length + " materials");
  }
  if (viewer) add("Mesh", viscera.number(viewer.tets) + "\u00a0tets",
      viscera.number(viewer.points) + " points");
  const angle = ((report.quality || {}).measures || {}).dihedral_min;
  if (angle) add("Smallest dihedral", viscera.quantity(angle.min, angle.unit));
  const times = report.series.time_s || (viewer && viewer.times_s);
  if (times && times.length) add("Simulated", viscera.quantity(times[times.length - 1], "s"));
  const rest = viscera.restTime(report);
  if (rest !== undefined) {
    add("At rest after", rest === null ? "not at rest" : viscera.quantity(rest, "s"),
        viscera.restReason(report));
  }
  const error = viscera.metric(report, "simulate", "solver_error_bound");
  const off = viscera.metric(report, "simulate", "error_total");
  if (typeof off === "number") {
    add("Error at rest", viscera.quantity(Number(off.toPrecision(2)), "mm"),
        "root mean square, or less; its parts stand above");
  } else if (typeof error === "number") {
    add("Solver's error at rest", viscera.quantity(Number((100 * error).toPrecision(2)), "percent"),
        "predicted bound; the error of elements and mesh comes besides (simulate: certify)");
  }
  const ratio = (report.series.volume_ratio || []).filter(v => v !== null);
  if (ratio.length) {
    const off = 100 * ratio.reduce((most, r) => Math.max(most, Math.abs(r - 1)), 0);
    add("Volume change, most", viscera.quantity(Number(off.toPrecision(2)), "percent"));
  }
  const total = report.stages.reduce((sum, s) => sum + s.wall_s, 0);
  if (report.stages.length) add("Computing time", viscera.seconds(total), "all stages");
  const simulate = report.stages.find(s => s.stage === "simulate");
  if (simulate) add("Device", simulate.device);
  byId("key-figures").replaceChildren(...figures.map(([name, value, note]) =>
    el("div", {}, el("dt", {}, name), el("dd", {}, value,
      note ? el("small", {}, note) : null))));
};

// One row a label from whatever knows it: labels.json, quality.json, the trajectory.
viscera.labelRows = function (report) {
  const rows = new Map();
  const merge = (list, pick) => {
    for (const item of Array.isArray(list) ? list : []) {
      const id = item.id ?? item.label;
      if (id === undefined) continue;
      const row = rows.get(id) || {id};
      rows.set(id, Object.assign(row, pick(item), item.name ? {name: item.name} : {}));
    }
  };
  if (report.labels) {
    merge(report.labels.labels, l => ({ct_ml: l.ml, borders: l.borders}));
  }
  if (report.quality && report.quality.volume) {
    merge(report.quality.volume.labels, l => ({tets: l.tets, mesh_ml: l.ml,
      ct_ml: l.input_ml, error: typeof l.volume_error === "number" ? 100 * l.volume_error : null}));
  }
  if (report.viewer) {
    merge(report.viewer.labels, l => ({tets: l.tets, mesh_ml: l.rest_ml, end_ml: l.end_ml}));
  }
  const size = row => row.mesh_ml ?? row.ct_ml ?? 0;
  return [...rows.values()].sort((a, b) => size(b) - size(a));
};

// What a reader of volumes must know: a label that the edge of the scan cuts is not whole.
function cutLabels(rows) {
  return rows.flatMap(row => (Array.isArray(row.borders) ? row.borders : []).map(cut =>
    `⚠ ${row.name || "label " + row.id} is cut by the ${cut.face} border of the volume over ` +
    `${viscera.quantity(Math.round(cut.area_mm2), "mm^2")}.`)).join(" ");
}

// `toggle(id, on)` and `colours` are there when the 3D view is.
viscera.labelTable = function (table, report, colours, toggle) {
  const rows = viscera.labelRows(report);
  const has = key => rows.some(row => row[key] !== undefined && row[key] !== null);
  const columns = [["ct_ml", "#CT ml"], ["mesh_ml", "#mesh ml"], ["error", "#error %"],
                   ["end_ml", "#end ml"], ["tets", "#tets"]].filter(([key]) => has(key));
  byId(table + "-note").textContent = cutLabels(rows);
  fillTable(table, ["Label", ...columns.map(c => c[1])], rows.map(row => {
    const name = row.name || "label " + row.id;
    let title = document.createTextNode(name);
    if (toggle && colours.has(row.id)) {
      const box = el("input", {type: "checkbox", checked: ""});
      box.addEventListener("change", () => toggle(row.id, box.checked));
      const swatch = el("span", {class: "swatch", "aria-hidden": "true"});
      swatch.style.background = colours.get(row.id);
      title = el("label", {}, box, swatch, name);
    }
    return [head(title), ...columns.map(([key]) =>
      number(row[key] === undefined || row[key] === null ? "–" : viscera.number(
        key === "error" ? Number(row[key].toPrecision(2)) : row[key])))];
  }));
};

// What was simulated: the effects that were on and off, and the scene's materials and settings.
viscera.scene = function (report) {
  const list = [], add = (name, value) => {
    if (value !== undefined && value !== null) list.push([name, value]);
  };
  const names = value => Array.isArray(value)
    ? value.map(v => viscera.words(v)).join(", ") || "none" : viscera.words(String(value));
  const on = viscera.metric(report, "simulate", "effects_on");
  const off = viscera.metric(report, "simulate", "effects_off");
  if (on) add("Effects simulated", names(on));
  if (off) add("Effects off: no cost, no influence", names(off));
  const {materials, effects, scene, units, ...settings} = report.scene || {};
  if (materials) {
    add("Materials", objectTable(Object.entries(materials).map(([name, m]) => ({name, ...m}))));
  }
  for (const [name, values] of Object.entries({...effects, ...settings})) {
    if (values && Object.keys(values).length) add(viscera.words(name), valueNode(values));
  }
  byId("scene-list").replaceChildren(...pairs(list).children);
  byId("scene-note").textContent = units === "SI" ? "All in m, kg, s and Pa." : "";
  byId("scene").hidden = list.length === 0;
};

viscera.qualityTables = function (report) {
  const measures = Object.entries((report.quality || {}).measures || {});
  if (!measures.length) return;
  const percentiles = ["1", "50", "99"]
    .filter(p => measures.some(([, m]) => (m.percentiles || {})[p] !== undefined));
  fillTable("quality-summary",
    ["Measure", "#min", ...percentiles.map(p => `#${p} %`), "#mean", "#max"],
    measures.map(([name, m]) => [head(viscera.words(name)), ...[m.min,
      ...percentiles.map(p => (m.percentiles || {})[p]), m.mean, m.max].map(value =>
      number(value === undefined ? "–" : viscera.quantity(value, m.unit)))]));
  const worst = measures.flatMap(([name, m]) => (m.worst || []).slice(0, 3).map(tet => [
    head(viscera.words(name)), number(viscera.quantity(tet.value, m.unit)), number(String(tet.tet)),
    number(String(tet.label)), number((tet.at || []).map(x => x.toFixed(1)).join(", "))]));
  if (!worst.length) return;
  fillTable("worst", ["Measure", "#value", "#tet", "#label", "#place, LPS mm"], worst);
  byId("worst-box").hidden = false;
};

viscera.stageTable = function (report) {
  const longest = Math.max(...report.stages.map(s => s.wall_s), 1e-9);
  fillTable("stages-table",
    ["Stage", "#Wall", "", "#CPU", "#Memory", "Device", "Started", "#Exit"],
    report.stages.map(s => {
      const bar = el("span", {class: "bar"});
      bar.style.width = 100 * s.wall_s / longest + "%";
      return [head(stageTitle(s.stage)), number(viscera.seconds(s.wall_s)),
              el("td", {class: "wide", "aria-hidden": "true"}, bar),
              number(viscera.seconds(s.cpu_s)),
              number(viscera.quantity(Math.round(s.max_rss_mb), "MB")),
              cell(s.device), cell(s.started), number(String(s.exit))];
    }));
};

// A value of any shape: numbers with their unit, texts, lists, tables of objects, nested pairs.
function valueNode(value, unit) {
  const scalar = v => v === null || typeof v !== "object";
  const shown = v => typeof v === "number" || v === null ? viscera.quantity(v, unit) : String(v);
  if (scalar(value)) return el("span", {}, shown(value));
  if (Array.isArray(value)) {
    if (value.length && value.every(v => v && typeof v === "object" && !Array.isArray(v))) {
      return objectTable(value);
    }
    if (!value.every(scalar)) return el("span", {}, JSON.stringify(value));
    const list = value.map(v => typeof v === "number" ? viscera.number(v) : String(v)).join(", ");
    const suffix = viscera.unit(unit);
    return el("span", {}, (list || "none") + (list && suffix ? "\u00a0" + suffix : ""));
  }
  const entries = Object.entries(value);
  if (entries.every(([, v]) => scalar(v)) && entries.length <= 5) {
    const words = entries.map(([key, v]) => viscera.words(key) + " " + shown(v));
    return el("span", {}, words.join(", "));
  }
  return pairs(entries.map(([key, v]) => [viscera.words(key), valueNode(v, unit)]));
}

function objectTable(objects) {
  const names = [...new Set(objects.flatMap(Object.keys))];
  return el("div", {class: "scroll"}, el("table", {class: "data"},
    el("thead", {}, el("tr", {}, ...names.map(n => el("th", {scope: "col"}, viscera.words(n))))),
    el("tbody", {}, ...objects.map(row => el("tr", {}, ...names.map(n =>
      el("td", {}, valueNode(row[n] ?? "–"))))))));
}

function pairs(list) {
  return el("dl", {class: "pairs"}, ...list.flatMap(([name, value]) =>
    [el("dt", {}, name), el("dd", {}, value)]));
}

// A stage's metrics and parameters: what fits a line side by side, the rest below.
viscera.metricList = function (report) {
  for (const stage of report.stages) {
    const metrics = stage.metrics
      .map(m => [viscera.words(m.name, m.unit), valueNode(m.value, m.unit)]);
    const short = metrics.filter(([, node]) => node.tagName === "SPAN");
    const long = metrics.filter(([, node]) => node.tagName !== "SPAN");
    const params = Object.entries(stage.params || {}).map(([name, value]) => [viscera.words(name),
      value === null ? "not set" : valueNode(value, (stage.param_units || {})[name])]);
    byId("metrics-list").append(el("details", {}, el("summary", {}, stageTitle(stage.stage)),
      el("div", {class: "halves"},
        el("div", {}, el("h4", {}, "Metrics"), short.length ? pairs(short) : "none"),
        el("div", {}, el("h4", {}, "Parameters"), params.length ? pairs(params) : "none")),
      long.length ? pairs(long) : ""));
    byId("metrics").hidden = false;
  }
};

viscera.provenance = function (report) {
  fillTable("inputs-table", ["Input", "File", "#Size", "SHA-256", "Figures from its stage"],
    report.inputs.map(i => [head(i.role), cell(code(i.path)), number(viscera.bytes(i.bytes)),
      cell(code(i.sha256)), cell(i.has_manifest ? "✓ manifest matches this file"
                                                : "no manifest beside it")]));
  for (const link of report.links) {
    byId("links").append(el("p", {}, link.given
      ? `✓ ${stageTitle(link.stage)} was made from the ${link.role} named above.`
      : `⚠ ${stageTitle(link.stage)} was made from other ${link.role} than those named above: ` +
        `${link.path}, SHA-256 ${link.sha256.slice(0, 12)}…`));
  }
  for (const stage of report.stages) {
    const file = f => [f.role ? f.role + " in" : "out",
      el("span", {}, code(f.path), " ", viscera.bytes(f.bytes), " ", code(f.sha256))];
    const libraries = Object.entries(stage.libraries).map(([name, v]) => name + " " + v).join(", ");
    byId("provenance-list").append(
      el("h3", {}, `${stageTitle(stage.stage)}, version ${stage.version}`),
      pairs([["device", stage.device], ["frame", stage.frame],
             ["libraries", libraries || "none named"],
             ...stage.inputs.map(file), ...stage.outputs.map(file)]));
  }
  const last = Object.entries(report.series_last);
  if (last.length) {
    byId("provenance-list").append(el("h3", {}, "Final state"),
      pairs(last.map(([name, text]) => [viscera.words(name), code(text)])));
  }
};
