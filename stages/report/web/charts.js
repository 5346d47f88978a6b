// The plots: time courses from metrics.csv, with a cursor that follows the 3D view, and the mesh
// quality histograms. Columns are known by name; what is not known gets a plot of its own.
"use strict";

const timePlots = [
  {title: "Energy", unit: "J", columns: {total_J: "total", kinetic_J: "kinetic",
    elastic_J: "elastic", gravity_J: "gravity"}},
  {title: "Speed: coming to rest", unit: "m/s", log: true,
   columns: {max_speed_m_s: "fastest point", rms_speed_m_s: "root mean square"}},
  {title: "Volume over volume at rest", unit: "1", columns: {volume_ratio: "whole body"}},
  {title: "Smallest volume ratio of any tet", unit: "1", columns: {min_J: "min J"}},
  {title: "Points in contact", unit: "1", columns: {contacts: "contacts"}},
  {title: "Force of the solver's error and of fast vibrations", unit: "N",
   columns: {force_handed_on_N: "handed on"}},
  {title: "Inverted tets", unit: "1", columns: {inverted: "inverted"}, onlyIfNonZero: true},
];
// Columns of three components each, by what exerts them; plotted by their sizes.
const vectorPlots = [
  {title: "Force on the body, by what exerts it", unit: "N", column: /^force_(.+)_([xyz])_N$/},
  {title: "Moment about the centre of mass at rest", unit: "N m",
   column: /^moment_(.+)_([xyz])_N_m$/},
  {title: "How far probes have moved", unit: "mm", column: /^probe_(.+)_([xyz])_mm$/,
   fromStart: true},
];
const notPlotted = new Set(["frame", "time_s", "volume_ml"]);

function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// The unit that a column's name ends with, and the name without it.
function splitUnit(column) {
  const units = [["_m_s2", "m/s²"], ["_m_s", "m/s"], ["_N_m", "N m"], ["_kPa", "kPa"], ["_Pa", "Pa"], ["_ml", "ml"],
                 ["_mm", "mm"], ["_ms", "ms"], ["_J", "J"], ["_N", "N"], ["_s", "s"]];
  const found = units.find(([suffix]) => column.endsWith(suffix));
  return found ? [column.slice(0, -found[0].length), found[1]] : [column, "1"];
}

// The series with the sizes of its vectors in place of their components, and a plot of each kind.
function sizesOfVectors(series) {
  const plots = [], scalars = {...series};
  for (const {title, unit, column, fromStart} of vectorPlots) {
    const columns = {};
    for (const name of Object.keys(series).filter(name => column.test(name))) {
      const of = name.match(column)[1], size = title + ": " + of;
      if (!(size in columns)) {
        const parts = ["x", "y", "z"].map(axis => series[name.replace(/_[xyz]_/, "_" + axis + "_")]);
        scalars[size] = parts[0].map((_, k) => parts.some(part => part[k] === null) ? null
          : Math.hypot(...parts.map(part => part[k] - (fromStart ? part[0] : 0))));
        columns[size] = viscera.words(of);
      }
      delete scalars[name];
    }
    plots.push({title, unit, columns});
  }
  return {series: scalars, plots};
}

function plotsFor(series, vectors) {
  const named = timePlots.concat(vectors);
  const known = new Set(named.flatMap(plot => Object.keys(plot.columns)));
  const further = Object.keys(series).filter(name => !known.has(name) && !notPlotted.has(name));
  const plots = named.concat(further.map(name => {
    const [words, unit] = splitUnit(name);
    return {title: viscera.words(words), unit, columns: {[name]: viscera.words(words)}};
  }));
  return plots.map(plot => ({...plot, present: Object.keys(plot.columns).filter(name =>
    series[name] && series[name].some(v => v !== null))})).filter(plot => plot.present.length &&
      !(plot.onlyIfNonZero && plot.present.every(name => series[name].every(v => !v))));
}

// A line at the shown time, and a dashed one where the body came to rest.
const cursorPlugin = {
  id: "cursor",
  afterDatasetsDraw(chart, _, options) {
    const {ctx, chartArea: area, scales: {x}} = chart;
    const vertical = (time, colour, dash) => {
      if (time === null || time < x.min || time > x.max) return;
      const at = x.getPixelForValue(time);
      ctx.save();
      ctx.strokeStyle = colour;
      ctx.setLineDash(dash);
      ctx.beginPath();
      ctx.moveTo(at, area.top);
      ctx.lineTo(at, area.bottom);
      ctx.stroke();
      ctx.restore();
    };
    if (!options.time) return;
    vertical(options.rest(), css("--muted"), [3, 3]);
    vertical(options.time(), css("--accent"), []);
  },
};

function frameFor(parent, title, unit, label) {
  const canvas = viscera.element("canvas", {role: "img", "aria-label": label});
  const shown = viscera.unit(unit);
  const small = shown ? viscera.element("small", {}, " " + shown) : null;
  parent.append(viscera.element("div", {class: "chart"},
    viscera.element("h3", {}, title, small),
    viscera.element("div", {class: "chart-box"}, canvas)));
  return canvas;
}

function axis(title) {
  return {title: {display: Boolean(title), text: title}, grid: {drawBorder: false},
          ticks: {maxRotation: 0, autoSkipPadding: 16}};
}

// A label at each decade only.
function logAxis() {
  const shared = axis("");
  const decade = value => Math.abs(Math.log10(value) % 1) < 1e-9;
  shared.ticks.callback = value => decade(value) ? viscera.number(value) : "";
  shared.ticks.autoSkip = false;
  shared.grid.lineWidth = item => item.tick && decade(item.tick.value) ? 1 : 0;
  return {type: "logarithmic", ...shared};
}

function lineChart(canvas, plot, times, series, time, rest, seek) {
  const colours = ["--accent", "--series-2", "--series-3", "--series-4"];
  const datasets = plot.present.map((name, i) => ({
    label: plot.columns[name], borderWidth: 1.6, pointRadius: 0,
    borderColor: () => css(colours[i % 4]), backgroundColor: () => css(colours[i % 4]),
    data: series[name].map((y, k) => ({x: times[k], y: plot.log && y <= 0 ? null : y})),
  }));
  const values = datasets.flatMap(set => set.data.map(p => p.y)).filter(y => y !== null);
  const flat = values.length > 0 && values.every(y => y === values[0]);
  return new Chart(canvas, {
    type: "line", data: {datasets}, plugins: [cursorPlugin],
    options: {
      animation: false, responsive: true, maintainAspectRatio: false, normalized: true,
      parsing: false, spanGaps: false,
      interaction: {mode: "index", intersect: false},
      onClick(event, _, chart) { seek(chart.scales.x.getValueForPixel(event.x)); },
      scales: {
        x: {type: "linear", min: times[0], max: times[times.length - 1], ...axis("time, s")},
        y: plot.log && values.length ? logAxis()
          : {type: "linear", ...axis(""), grace: flat ? 1 : 0},
      },
      plugins: {
        cursor: {time, rest},
        legend: {display: datasets.length > 1, align: "start",
                 labels: {boxWidth: 14, boxHeight: 2, padding: 8}},
        tooltip: {callbacks: {
          title: items => viscera.quantity(items[0].parsed.x, "s"),
          label: item => item.dataset.label + " " + viscera.quantity(item.parsed.y, plot.unit),
        }},
      },
    },
  });
}

// `clock`: {time(), rest(), seek(t)}.
viscera.timeCharts = function (parent, columns, clock) {
  const {series, plots} = sizesOfVectors(columns), times = series.time_s;
  return plotsFor(series, plots).map(plot => {
    const last = plot.present.map(name => plot.columns[name] + " ends at " +
      viscera.quantity(series[name].filter(v => v !== null).pop(), plot.unit)).join(", ");
    const canvas = frameFor(parent, plot.title, plot.unit, plot.title + " against time: " + last);
    return lineChart(canvas, plot, times, series, clock.time, clock.rest, clock.seek);
  });
};

// Values beyond a histogram's range are counted in its last bar; the heading then says so.
viscera.histograms = function (parent, measures) {
  const present = Object.entries(measures)
    .filter(([, m]) => m.histogram && m.histogram.counts.length);
  return present.map(([name, m]) => {
    const {low, high, counts} = m.histogram, width = (high - low) / counts.length;
    const beyond = m.max > high ? ` (last bar: and more, up to ${viscera.number(m.max)})` : "";
    const title = viscera.words(name), unit = viscera.unit(m.unit) + beyond;
    const canvas = frameFor(parent, title, unit, `${title}: tets per interval from ` +
      `${viscera.quantity(low, m.unit)} to ${viscera.quantity(high, m.unit)}${beyond}`);
    const data = counts.map((count, i) => ({x: low + (i + 0.5) * width, y: count}));
    return new Chart(canvas, {
      type: "bar",
      data: {datasets: [{data, backgroundColor: () => css("--accent"), barPercentage: 1,
                         categoryPercentage: 0.94}]},
      options: {
        animation: false, responsive: true, maintainAspectRatio: false, parsing: false,
        scales: {x: {type: "linear", min: low, max: high, offset: false, ...axis("")},
                 y: {...axis("tets"), beginAtZero: true}},
        plugins: {legend: {display: false}, tooltip: {callbacks: {
          title: items => viscera.number(items[0].parsed.x - width / 2) + " to " +
            viscera.quantity(items[0].parsed.x + width / 2, m.unit),
          label: item => viscera.number(item.parsed.y) + " tets",
        }}},
      },
    });
  });
};

viscera.themeCharts = function (charts) {
  Chart.defaults.font.family = getComputedStyle(document.body).fontFamily;
  for (const chart of charts) {
    for (const scale of Object.values(chart.options.scales)) {
      scale.ticks.color = css("--muted");
      scale.title.color = css("--muted");
      scale.grid.color = css("--grid");
    }
    chart.options.plugins.legend.labels.color = css("--ink");
    chart.update("none");
  }
};
