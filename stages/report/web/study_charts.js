// Plots of a comparison: time courses of several runs on one axis, and error against time of work with
// failures, the front and the 16.7 ms line.
"use strict";

const solverColours = {xpbd: ["#c2382e", "#f0766c"], pbd: ["#b08a00", "#e6c229"],
                       fem: ["#2a64b8", "#6fa3ec"], tled: ["#1d8a63", "#4cc79a"],
                       "xpbd on CUDA": ["#8a3fb5", "#c592ea"],
                       "xpbd, smoothed": ["#d9730d", "#ffa94d"], "fem, smoothed": ["#5b3fb8", "#a48cf0"],
                       "tled, smoothed": ["#0e7490", "#4fc3dc"], "fem, quadratic": ["#1e3a8a", "#93b4f5"],
                       "xpbd on CUDA, smoothed": ["#c0268f", "#f07ccb"]};
viscera.solverColour = function (method) {
  const dark = document.documentElement.dataset.theme === "dark";
  return (solverColours[method] || ["#6f7b88", "#95a1af"])[dark ? 1 : 0];
};

viscera.rgb = colour => `rgb(${colour.map(c => Math.round(255 * c)).join(",")})`;

// One plot a column; `clock` as in charts.js.
viscera.overlayCharts = function (parent, views, clock) {
  const plots = [["elastic_J", "Elastic energy", "J"], ["max_speed_m_s", "Fastest point", "m/s"],
                 ["volume_ratio", "Volume over volume at rest", "1"], ["inverted", "Inverted tets", "1"]];
  return plots.filter(([column]) => views.some(v => v.series[column])).map(([column, title, unit]) => {
    const canvas = frameFor(parent, title, unit, title + " of every run against time");
    const log = column === "max_speed_m_s";
    const datasets = views.filter(v => v.series[column]).map(v => ({
      label: v.name, borderWidth: 1.6, pointRadius: 0,
      borderColor: viscera.rgb(v.colour), backgroundColor: viscera.rgb(v.colour),
      data: v.series[column].map((y, k) => ({x: v.series.time_s[k], y: log && y <= 0 ? null : y})),
    }));
    return new Chart(canvas, {
      type: "line", data: {datasets}, plugins: [cursorPlugin],
      options: {
        animation: false, responsive: true, maintainAspectRatio: false, parsing: false,
        interaction: {mode: "nearest", axis: "x", intersect: false},
        onClick(event, _, chart) { clock.seek(chart.scales.x.getValueForPixel(event.x)); },
        scales: {x: {type: "linear", ...axis("time, s")},
                 y: log ? logAxis() : {type: "linear", ...axis("")}},
        plugins: {cursor: {time: clock.time, rest: () => null},
                  legend: {display: true, align: "start",
                           labels: {boxWidth: 14, boxHeight: 2, padding: 8}},
                  tooltip: {callbacks: {label: item => item.dataset.label + " " +
                    viscera.quantity(item.parsed.y, unit)}}},
      },
    });
  });
};

// The time that a picture may take at 60 a second.
const frameLine = {
  id: "frameLine",
  afterDatasetsDraw(chart, _, options) {
    const {ctx, chartArea: area, scales: {x}} = chart;
    if (!options.ms || options.ms < x.min || options.ms > x.max) return;
    const at = x.getPixelForValue(options.ms);
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = css("--muted");
    ctx.setLineDash([4, 3]);
    ctx.beginPath();
    ctx.moveTo(at, area.top);
    ctx.lineTo(at, area.bottom);
    ctx.stroke();
    ctx.font = "11px system-ui, sans-serif";
    ctx.fillText("16.7 ms", at + 4, area.top + 10);
    ctx.restore();
  },
};

// Labels at 1, 2 and 5 of each decade: some scenes span less than one.
function fineLogAxis(title) {
  const shared = logAxis();
  const leading = value => Math.round(value / 10 ** Math.floor(Math.log10(value) + 1e-9));
  shared.ticks.callback = value =>
    [1, 2, 5].includes(leading(value)) ? viscera.number(Number(value.toPrecision(1))) : "";
  return {...shared, title: {display: true, text: title}};
}

// Error (a key of the points) against time; a point that failed has a cross at the top.
viscera.workPrecision = function (parent, scene, key, title) {
  const points = scene.points.filter(p => p.ms[1] > 0);
  const good = points.filter(p => p.failed === "" && p[key] > 0);
  if (!good.length) return null;
  const canvas = frameFor(parent, title, "mm", title + " against time of work, both logarithmic");
  canvas.parentNode.classList.add("tall");
  const doubt = {total_mm: "total_doubtful", centroid_mm: "centroid_doubtful"}[key] || "doubtful";
  const top = 2 * Math.max(...good.map(p => p[key]));
  const curves = [...new Set(good.map(p => p.method + "|" + p.tets))].map(name => {
    const [method, tets] = name.split("|");
    const curve = good.filter(p => p.method === method && String(p.tets) === tets);
    return {
      label: `${method}, ${viscera.number(Number(tets))} tets`, type: "scatter", showLine: false,
      data: curve.map(p => ({x: p.ms[1], y: p[key], p})),
      pointRadius: curve.map(p => p.front && key === scene.front_by ? 6 : 4),
      pointStyle: ["circle", "rectRot", "triangle", "rect"][[...new Set(points.map(p => p.tets))]
        .sort((a, b) => a - b).indexOf(Number(tets)) % 4],
      borderColor: () => viscera.solverColour(method), borderWidth: 1.5,
      backgroundColor: context => context.raw && context.raw.p[doubt] ? "transparent"
        : viscera.solverColour(method),
    };
  });
  const failed = {
    label: "failed", type: "scatter", pointStyle: "crossRot", pointRadius: 6, borderWidth: 2,
    data: points.filter(p => p.failed !== "").map(p => ({x: p.ms[1], y: top, p})),
    borderColor: () => css("--fail"), backgroundColor: () => css("--fail"),
  };
  const fronts = frontsOf(scene, good, key).map(({label, points}) => ({
    label, type: "line", pointRadius: 0, borderWidth: 1.2, borderDash: [2, 3],
    borderColor: () => css("--muted"), backgroundColor: () => css("--muted"),
    data: points.map(p => ({x: p.ms[1], y: p[key]})),
  }));
  return new Chart(canvas, {
    type: "scatter", data: {datasets: [...curves, failed, ...fronts]}, plugins: [frameLine],
    options: {
      animation: false, responsive: true, maintainAspectRatio: false, parsing: false,
      interaction: {mode: "nearest", intersect: true},
      scales: {
        x: fineLogAxis(scene.cost),
        y: fineLogAxis("mm"),
      },
      plugins: {
        frameLine: {ms: scene.span === "end" ? 0 : 1000 / 60},
        legend: {display: true, align: "start",
                 labels: {boxWidth: 10, boxHeight: 8, padding: 8, usePointStyle: true}},
        tooltip: {filter: item => Boolean(item.raw.p), callbacks: {label: item => pointWords(item.raw.p, key)}},
      },
    },
  });
};

// The points that the study puts on the front, by time: one front by the total, one for each mesh by the
// solver's error, and none in a plot of the other error.
function frontsOf(scene, points, key) {
  if (key !== scene.front_by) return [];
  const front = points.filter(p => p.front).sort((a, b) => a.ms[1] - b.ms[1]);
  if (key === "total_mm") return [{label: "Pareto front", points: front}];
  return [...new Set(front.map(p => p.tets))].sort((a, b) => a - b).map(tets => ({
    label: `Pareto front, ${viscera.number(tets)} tets`, points: front.filter(p => p.tets === tets)}));
}

function pointWords(p, key) {
  const cs = p.cs === null ? "" : `, Cs ${viscera.number(p.cs)}`;
  const state = p.failed === "" ? viscera.quantity(p[key], "mm") : "failed: " + p.failed;
  return `${p.label}, ${viscera.number(p.tets)} tets${cs}: ${state}, ` +
    `${viscera.quantity(p.ms[1], "ms")} (${viscera.number(p.ms[0])} to ${viscera.number(p.ms[2])})`;
}
