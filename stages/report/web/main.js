// Puts the page together: the 3D view first, then tables, then plots. The view can be set in the
// address, as time and theme (page.js) can: #t=0.5&theme=dark&colour=ratio&view=A&edges=1&play=1.
"use strict";

(function () {
  const timeCharts = [], charts = [];
  let viewer = null, times = [], frame = 0, playing = false, gateMarks = null, lostMarks = null,
    invertedMarks = null;
  const page = viscera.openPage(charts, () => { if (viewer) viewer.theme(); }, message =>
    byId("verdict").append(viscera.element("p", {class: "fail"},
      "This page could not be drawn completely: " + message)));
  const {report, asked} = page;

  function show(index) {
    frame = index;
    byId("time").value = index;
    const text = times[index].toFixed(2) + "\u00a0s";
    byId("clock").textContent = text;
    byId("time").setAttribute("aria-valuetext", text);
    viewer.setFrame(index);
    for (const chart of timeCharts) chart.draw();
  }

  function setPlaying(on) {
    playing = on;
    byId("play").setAttribute("aria-label", on ? "Pause" : "Play");
    byId("play").querySelector("path").setAttribute("d",
      on ? "M4 2.5h3v11H4zM9 2.5h3v11H9z" : "M4 2.5v11l9-5.5z");
    if (!on) return;
    if (frame === times.length - 1) show(0);
    let last = performance.now(), now = times[frame];
    const step = () => {
      if (!playing) return;
      const stamp = performance.now();
      now += (stamp - last) / 1000 * Number(byId("rate").value);
      last = stamp;
      let next = frame;
      while (next + 1 < times.length && times[next + 1] <= now) ++next;
      if (next !== frame) show(next);
      if (frame === times.length - 1) setPlaying(false);
      else soon(step);
    };
    soon(step);
  }

  // With the next frame that is drawn, or in 100 ms where none is: a hidden page plays on.
  function soon(step) {
    const once = () => {
      cancelAnimationFrame(drawn);
      clearTimeout(late);
      step();
    };
    const drawn = requestAnimationFrame(once), late = setTimeout(once, 100);
  }

  function updateLegend() {
    const mode = byId("colour").value, limit = report.viewer.ratio_range;
    byId("legend").hidden = mode === "label";
    if (mode === "label") return;
    const amount = mode !== "ratio";
    const shown = value => viscera.number(Number(value.toPrecision(3)));
    const most = {stress: report.viewer.stress_range_kPa, ratio: 1, quality: 1}[mode] || viewer.range(mode);
    byId("legend-title").textContent = {
      stress: "Von Mises stress, kPa", quality: "Least mean ratio of the tets around a point",
      displacement: "Distance from the scanned place, mm",
      shape: "Distance beyond rigid motion, mm", ratio: "Volume over volume at rest"}[mode];
    byId("legend-lo").textContent = amount ? "0" : "≤ " + (1 - limit).toFixed(3);
    byId("legend-mid").textContent = amount ? shown(most / 2) : "1";
    byId("legend-hi").textContent =
      amount ? (mode === "stress" ? "≥ " : "") + shown(most) : "≥ " + (1 + limit).toFixed(3);
    const bar = byId("legend-bar"), context = bar.getContext("2d"), rgb = [0, 0, 0];
    for (let x = 0; x < bar.width; ++x) {
      viscera.mapped(amount ? "amount" : "deviation", x / (bar.width - 1), rgb, 0);
      context.fillStyle = `rgb(${rgb.map(v => Math.round(255 * v)).join(",")})`;
      context.fillRect(x, 0, 1, bar.height);
    }
  }

  // A round length that is about a fifth of the view.
  function updateScale() {
    const perPixel = viewer.millimetresPerPixel(), length = viscera.roundLength(perPixel * 110);
    byId("scale").querySelector("span").textContent = viscera.quantity(length, "mm");
    byId("scale").querySelector("i").style.width = length / perPixel + "px";
  }

  // A field is first shown opaque, so that its colours are those of the legend.
  function setColour(mode) {
    byId("translucent").checked = mode === "label";
    viewer.setTranslucent(mode === "label");
    viewer.setColour(mode);
    updateLegend();
  }

  function connectView() {
    byId("time").max = Math.max(times.length - 1, 0);
    byId("time").addEventListener("input", event => {
      setPlaying(false);
      show(Number(event.target.value));
    });
    byId("play").addEventListener("click", () => setPlaying(!playing));
    byId("canvas").addEventListener("keydown", event => {
      if (event.key !== " " || times.length < 2) return;
      event.preventDefault();
      setPlaying(!playing);
    });
    byId("transport").hidden = times.length < 2;
    byId("translucent").addEventListener("change", e => viewer.setTranslucent(e.target.checked));
    byId("edges").addEventListener("change", e => viewer.setEdges(e.target.checked));
    byId("colour").addEventListener("change", () => setColour(byId("colour").value));
    for (const button of byId("views").querySelectorAll("button")) {
      button.addEventListener("click", () => viewer.look(button.dataset.view));
    }
    viewer.onDrawn(camera => {
      viscera.drawTriad(byId("triad"), camera);
      updateScale();
    });
    page.noteFirstFrame(viewer);
  }

  function applyAddress() {
    const mode = asked.get("colour");
    if ([...byId("colour").options].some(option => option.value === mode)) {
      byId("colour").value = mode;
      setColour(mode);
    }
    if (["A", "L", "S", "oblique"].includes(asked.get("view"))) viewer.look(asked.get("view"));
    if (asked.get("edges") === "1") byId("edges").click();
    const time = Number(asked.get("t"));
    if (times.length) show(asked.has("t") && isFinite(time) ? viscera.nearest(times, time) : 0);
    updateLegend();
  }

  async function startView() {
    const meta = report.viewer;
    byId("view").hidden = false;
    try {
      const data = await viscera.unpack(byId("geometry").textContent, meta);
      viewer = viscera.createViewer(byId("canvas"), meta, data);
    } catch (error) {
      byId("view-notice").textContent = "The 3D view could not start (" + error.message +
        "). It needs a browser with WebGL and DecompressionStream; the figures below do not.";
      byId("view-notice").hidden = false;
      byId("transport").hidden = true;
      viscera.labelTable("labels", report);
      page.note("view: " + error.message);
      return;
    }
    times = meta.times_s;
    if (meta.stress_range_kPa === null) byId("colour").querySelector("[value=stress]").remove();
    const ground = ((report.scene || {}).effects || {}).ground;
    if (ground && ground.normal) viewer.addGround(ground.normal, 1000 * ground.clearance);
    viscera.labelTable("labels", report, viewer.colours, viewer.setVisible);
    const marked = (name, places) => {
      if (!places.length) return null;
      const marks = viewer.addMarks(places.map(place => place.at));
      byId(name + "-choice").hidden = false;
      byId(name + "-rings").addEventListener("change", e => marks.show(e.target.checked));
      return marks;
    };
    gateMarks = marked("gates", viscera.gatePlaces(report));
    lostMarks = marked("lost", viscera.lostParts(report));
    invertedMarks = marked("inverted", viscera.invertedPlaces(report));
    connectView();
    applyAddress();
    const shown = times.length === meta.frames_total ? `All ${times.length} frames`
      : `${times.length} of ${meta.frames_total} frames, evenly chosen`;
    const error = viscera.quantity(Number(meta.position_error_mm.toPrecision(2)), "mm");
    const cell = viscera.quantity(viewer.gridCell, "mm");
    byId("view-note").textContent = `${shown}; ${viscera.number(meta.vertices)} of ` +
      `${viscera.number(meta.points)} points are on a surface and shown, each within ${error} of ` +
      "the stored position. Parallel projection: the scale bar holds everywhere. L left, " +
      "P posterior, S superior." + (ground ? ` The grid is the ground, in squares of ${cell}.` : "");
  }

  // In the colours of the 3D view, where there is one.
  async function startSlices() {
    byId("slices-view").hidden = false;
    const {ids} = report.slices;  // the largest first
    const own = viscera.labelColours(ids.map((id, i) => ({id, rest_ml: -i})));
    const colours = new Map([...own, ...(viewer ? viewer.colours : [])]);
    viscera.slicesLegend(report, colours);
    await viscera.showSlices(byId("slices").textContent, report.slices, colours);
  }

  function hasTimeCourse() {
    return Boolean(report.series.time_s && report.series.time_s.length > 1);
  }
  function drawCharts() {
    const {series} = report;
    const rest = viscera.restTime(report);
    if (hasTimeCourse()) {
      timeCharts.push(...viscera.timeCharts(byId("time-charts"), series, {
        time: () => viewer && times.length ? times[frame] : null,
        rest: () => typeof rest === "number" ? rest : null,
        seek: time => { if (viewer && times.length) { setPlaying(false); show(viscera.nearest(times, time)); } },
      }));
      if (series.inverted && series.inverted.every(v => v === 0)) {
        byId("time-note").textContent = "No tet was inverted in any frame.";
      }
    }
    if (report.quality && report.quality.measures) {
      charts.push(...viscera.histograms(byId("quality-charts"), report.quality.measures));
    }
    charts.push(...timeCharts);
    viscera.themeCharts(charts);
  }

  async function start() {
    viscera.verdict(report);
    viscera.keyFigures(report);
    if (report.viewer) {
      await startView();
    } else if (viscera.labelRows(report).length) {
      byId("volumes").hidden = false;
      viscera.labelTable("volumes-table", report);
    }
    if (report.slices) await startSlices();
    viscera.lostTable(report, lostMarks && lostMarks.pointOut);
    viscera.invertedTable(report, invertedMarks && invertedMarks.pointOut);
    viscera.gates(report, gateMarks && gateMarks.pointOut);
    viscera.scene(report);
    viscera.qualityTables(report);
    viscera.stageTable(report);
    viscera.metricList(report);
    viscera.provenance(report);
    page.showVersions();
    byId("time-course").hidden = !hasTimeCourse();
    page.showNavigation();
    await new Promise(resolve => requestAnimationFrame(() => setTimeout(resolve)));
    drawCharts();
    if (asked.get("play") === "1" && times.length) setPlaying(true);
    page.ready();
  }
  start().catch(error => page.fail(error.message));
})();
