// Puts the page of a comparison together: answers, figures, tables, the runs in one view, plots.
"use strict";

(function () {
  const {element, number, quantity, fillTable} = viscera;
  const charts = [], timeCharts = [];
  let overlay = null, time = 0, last = 0, playing = false;
  const page = viscera.openPage(charts, () => { if (overlay) overlay.theme(); });
  const {report, asked} = page;

  const orNone = (value, unit) => value === null ? "–" : quantity(value, unit);

  function showAnswers() {
    const {scenes} = report.study;
    if (!scenes.length) return;
    byId("answers").hidden = false;
    for (const scene of scenes) {
      for (const text of scene.sentences) {
        byId("answers-list").append(element("p", {class: "answer"}, text));
      }
    }
    byId("answers-note").textContent = "Errors are the largest of any vertex in any frame (scenes that " +
      "are judged at rest: in the last), against references that are named below. " + machine();
  }
  const machine = () => {
    const run = report.runs.find(r => r.cpu_model);
    const devices = [...new Set(report.runs.map(r => r.device))].sort();
    return run ? `Timed on ${run.cpu_model}: ${devices.join("; ")}.` : "";
  };

  function showEnsemble() {
    const e = report.ensemble;
    if (!e) return;
    byId("ensemble").hidden = false;
    const mm = v => quantity(Number(v.toPrecision(3)), "mm");
    fillTable("ensemble-table", ["Where the centre goes", "Moves by, mean", "Least to most",
      "Spread left–right, front–back, up–down", "95 % lie within"], e.labels.map(l => ({cells: [l.name,
        mm(l.moved_mm.mean), `${mm(l.moved_mm.least)} to ${mm(l.moved_mm.most)}`,
        l.spread_mm.map(mm).join(", "), `${mm(l.radius_mm)} of the mean`]})));
    byId("ensemble-note").textContent = `${e.runs} runs under the assumptions that the spec lists, each ` +
      "counted alike: a spread of assumptions, not a probability. Spread: standard deviation. The " +
      `largest of any point is ${mm(e.largest_spread_mm)}.` +
      (e.left_out.length ? ` Left out, because they diverged: ${e.left_out.join(", ")}.` : "");
  }

  const figureWords = {
    ensemble: f => [`The mean shape of ${f.caption.runs} runs from the front and from behind, coloured by ` +
      `spread: dark 0, yellow ${number(Number(f.caption.largest_spread_mm.toPrecision(3)))} mm.`],
    grid: f => ["Rows from the top: " + f.caption.map(row => row.run).join(", ") + ". Columns: t " +
      f.caption[0].times_s.map(t => number(Number(t.toPrecision(3)))).join(", ") +
      " s; a run that came to rest before stays as it is."],
    methods: f => ["Each method at its own greatest deformation. From the left: " + f.caption.map(c =>
      `${c.run} at ${quantity(Number(c.time_s.toPrecision(3)), "s")}`).join(", ") + "."],
    overlay: f => [f.caption.map(c => `${c.outlined}, outlined in orange, over ${c.over}`).join("; ") +
      ", at the outlined run's greatest deformation, " + quantity(Number(f.caption[0].time_s.toPrecision(3)), "s") + "."],
  };
  function showFigures() {
    byId("figures").hidden = !report.figures.length;
    for (const figure of report.figures) {
      const words = figureWords[figure.what](figure)[0];
      byId("figures-list").append(element("figure", {},
        element("img", {src: "data:image/png;base64," + figure.png, alt: words}),
        element("figcaption", {}, words)));
    }
  }

  function showMethods() {
    byId("methods").hidden = !report.methods.length;
    fillTable("cost-table", ["Method", "Device", "Tets", "Steps a frame", "Task, simulated", "Task, wall time",
      "Frames a second", "Frame, median (quartiles)", "Set-up", "Transfer", "Diagnosis", "Writing",
      "Cs"], report.methods.map(m => ({cells: [
        `${m.run} (${m.solver})`, m.device, number(m.tets), number(m.substeps),
        m.rest_time === null ? `no rest until ${quantity(Number(m.end_time.toPrecision(3)), "s")}` : quantity(Number((m.rest_time - m.contact_time).toFixed(3)), "s"),
        orNone(m.task_wall, "s"), orNone(m.frames_per_second, "1"),
        `${quantity(m.frame_ms_median, "ms")} (${number(m.frame_ms_q1)} to ${number(m.frame_ms_q3)})`,
        ...[m.setup_wall, m.transfer_wall, m.diagnosis_wall, m.writing_wall].map(s => orNone(s, "s")),
        number(m.stability_Cs_max)]})));
    byId("cost-note").textContent = "The task lasts from first contact until no vertex is faster than " +
      "the scene's rest speed for its rest time. Wall time is that of the solver's steps in the task, until the " +
      "device has finished; set-up, transfer, diagnosis and writing are apart, of the whole run. " +
      machine();
    fillTable("smoothness-table", ["Method", "At", "S", "Deviation", "S at rest", "S / S at rest",
      "Inverted then", "Inverted at most"], report.methods.map(m => ({cells: [
        `${m.run} (${m.solver})`, orNone(m.max_deformation_time, "s"),
        number(m.smoothness_max_deformation), number(m.smoothness_max_deformation_deviation),
        number(m.smoothness_rest), number(m.smoothness_max_deformation / m.smoothness_rest),
        number(m.inverted_max_deformation), number(m.inverted_max)]})));
  }

  function show(t) {
    time = Math.min(Math.max(t, 0), last);
    byId("time").value = time;
    byId("clock").textContent = time.toFixed(2) + "\u00a0s";
    overlay.setTime(time);
    for (const chart of timeCharts) chart.draw();
  }
  function setPlaying(on) {
    playing = on;
    byId("play").setAttribute("aria-label", on ? "Pause" : "Play");
    if (!on) return;
    if (time >= last) show(0);
    let stamp = performance.now();
    const step = () => {
      if (!playing) return;
      const now = performance.now();
      show(time + (now - stamp) / 1000);
      stamp = now;
      if (time >= last) setPlaying(false);
      else setTimeout(step, 16);
    };
    step();
  }
  async function showView() {
    if (!report.views.length) return;
    byId("view").hidden = false;
    const solvers = new Map(report.runs.map(r => [r.run, r.solver]));
    for (const view of report.views) view.solver = solvers.get(view.name);
    try {
      const runs = [];
      for (const view of report.views) {
        runs.push({meta: view.meta, colour: view.colour,
                   data: await viscera.unpack(view.packed, view.meta)});
      }
      overlay = viscera.createOverlay(byId("canvas"), runs);
    } catch (error) {
      byId("view-notice").textContent = "The 3D view could not start (" + error.message + ").";
      byId("view-notice").hidden = false;
      page.note("view: " + error.message);
      return;
    }
    last = Math.max(...report.views.map(v => v.meta.times_s[v.meta.times_s.length - 1] || 0));
    byId("time").max = last;
    byId("time").addEventListener("input", e => { setPlaying(false); show(Number(e.target.value)); });
    byId("play").addEventListener("click", () => setPlaying(!playing));
    byId("canvas").addEventListener("keydown", event => {
      if (event.key !== " ") return;
      event.preventDefault();
      setPlaying(!playing);
    });
    report.views.forEach((view, i) => {
      const box = element("input", {type: "checkbox", checked: ""});
      box.addEventListener("change", () => overlay.setVisible(i, box.checked));
      const swatch = element("span", {class: "swatch"});
      swatch.style.background = viscera.rgb(view.colour);
      byId("method-checks").append(element("label", {}, box, swatch, `${view.name} (${view.solver})`));
    });
    page.noteFirstFrame(overlay);
    timeCharts.push(...viscera.overlayCharts(byId("time-charts"), report.views, {
      time: () => time, seek: t => { setPlaying(false); show(t); }}));
    charts.push(...timeCharts);
    const t = Number(asked.get("t"));
    show(asked.has("t") && isFinite(t) ? t : report.runs.find(r => r.run === report.views[0].name).max_deformation_time || 0);
  }

  function bodyWords({body, no_body, span}) {
    if (body === null) return `Solver error only: ${no_body}. What the mesh adds to it is not known.`;
    return `The truth of the body is ${body.reference} on ${number(body.tets)} tets; its check, ${body.check} ` +
      `on ${number(body.check_tets)} tets, differs by ${quantity(Number(body.agreement_mm.toPrecision(3)), "mm")}` +
      (span === "history" ? ", the difference that other time steps make included" : "") +
      (body.agreement_centroid_mm === null ? "." :
        ` (the centroid by ${quantity(Number(body.agreement_centroid_mm.toPrecision(2)), "mm")}).`);
  }

  function showStudy() {
    for (const scene of report.study.scenes) {
      byId("study").hidden = false;
      const box = element("div", {class: "charts"}), meshes = element("table", {class: "data"}),
            table = element("table", {class: "data"});
      byId("study-scenes").append(element("h3", {}, scene.name), box,
        element("div", {class: "scroll"}, meshes),
        element("p", {class: "note"}, "A hollow point is nearer to its reference than ten times the " +
          "distance of that reference to its own check: its error is too small to be told, and it is on no " +
          `front. Crosses failed. The body moves by up to ${quantity(Number(scene.size_mm.toPrecision(3)), "mm")}.`),
        element("details", {}, element("summary", {}, `All ${scene.points.length} points`),
          element("div", {class: "scroll"}, table)));
      const errors = [["solver_mm", "Solver's error on its own mesh"]];
      if (scene.body !== null) errors.push(["total_mm", "Error of mesh and solver together"]);
      errors.push(["centroid_mm", `Error of the centroid of ${scene.centroid}`]);
      for (const [key, title] of errors) {
        const chart = viscera.workPrecision(box, scene, key, title);
        if (chart) charts.push(chart);
      }
      fillTable(meshes, ["Mesh, tets", "Reference", "Its check", "They differ by", "Error of the mesh"],
        scene.meshes.map(m => ({cells: [number(m.tets), m.reference, m.check || "none",
          orNone(m.agreement_mm, "mm"), m.discretisation_mm === null
            ? "not known: no finer truth" : quantity(m.discretisation_mm, "mm")]})));
      meshes.after(element("p", {class: "note"}, bodyWords(scene)));
      fillTable(table, ["Setting", "Tets", scene.cost, "Interval", "99th percentile", "Runs", "Cs", "Solver's error",
        "rms", "Total error", "Centroid", "Energy rise", "Volume off", "Inverted", "Failed"],
        scene.points.map(p => ({failed: p.failed !== "", cells: [p.label + (p.front ? " ★" : ""),
          number(p.tets), number(p.ms[1]), `${number(p.ms[0])} to ${number(p.ms[2])}`, orNone(p.p99_ms, "ms"), number(p.repeats),
          orNone(p.cs, "1"), orNone(p.solver_mm, "mm"), orNone(p.solver_rms_mm, "mm"),
          orNone(p.total_mm, "mm"), orNone(p.centroid_mm, "mm"), orNone(p.energy_rise, "1"), number(p.volume_off), number(p.inverted),
          p.failed || "–"]})));
    }
  }

  // {effects.fibre: {stiffness: 5 kPa}} as a spec would say it.
  function changeWords(value) {
    if (value === null || typeof value !== "object") return String(value);
    if (Array.isArray(value)) return "[" + value.map(changeWords).join(", ") + "]";
    return Object.entries(value).map(([name, item]) => {
      const words = changeWords(item);
      return name.replace(/^(effects|materials)\./, "") + (words === "" ? "" : typeof item === "object"
        && !Array.isArray(item) ? ` (${words})` : " " + words);
    }).join(", ");
  }
  function showEffects() {
    const {effects} = report.study;
    byId("effects").hidden = !effects.length;
    fillTable("effects-table", ["Change", "Scene", "Setting", "Frame with", "Frame without", "Difference",
      "Moves the result by"], effects.map(e => ({failed: e.failed !== "", cells: [changeWords(e.change), e.scene,
        `${e.label}, ${number(e.tets)} tets`, quantity(e.ms[1], "ms"), quantity(e.ms_without[1], "ms"),
        e.told_apart ? quantity(Number((e.ms[1] - e.ms_without[1]).toPrecision(3)), "ms")
          : "not told apart", e.failed || orNone(e.mm, "mm")]})));
  }

  function showRuns() {
    byId("runs").hidden = false;
    byId("runs-count").textContent = `${report.runs.length} runs`;
    fillTable("runs-table", ["Run", "Solver", "Tets", "Substeps", "Frames", "Frame", "Exit"],
      report.runs.map(r => ({failed: r.exit !== 0, cells: [r.run, r.solver, number(r.tets),
        orNone(r.substeps, "1"), orNone(r.frames, "1"), orNone(r.frame_ms_median, "ms"),
        number(r.exit)]})));
  }

  async function start() {
    page.showVersions();
    showAnswers();
    showEnsemble();
    showFigures();
    showMethods();
    await showView();
    showStudy();
    showEffects();
    showRuns();
    page.showNavigation();
    viscera.themeCharts(charts);
    page.ready();
  }
  start().catch(error => page.fail(error.message));
})();
