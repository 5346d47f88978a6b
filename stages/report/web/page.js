// What every page has: its data, the theme, and its state in #status: loading, ready or failed, the
// milliseconds to the first frame, and the rectangle of the 3D view. Time and theme can be set in the
// address: #t=0.5&theme=dark.
"use strict";

// `charts` follow the theme; `onTheme` and `onFailure(message)` are called beside that.
viscera.openPage = function (charts, onTheme, onFailure = () => {}) {
  const report = JSON.parse(byId("report").textContent);
  const asked = new URLSearchParams(location.hash.slice(1));
  const status = byId("status");

  function fail(message) {
    status.dataset.state = "failed";
    status.append(message + "\n");
    onFailure(message);
  }
  window.addEventListener("error", event => fail(event.message));
  window.addEventListener("unhandledrejection", event => fail(String(event.reason)));

  function setTheme(name) {
    document.documentElement.dataset.theme = name;
    byId("theme").textContent = name === "dark" ? "Light" : "Dark";
    byId("theme").setAttribute("aria-label",
      "Switch to the " + (name === "dark" ? "light" : "dark") + " theme");
    onTheme();
    viscera.themeCharts(charts);
  }
  const prefersDark = matchMedia("(prefers-color-scheme: dark)");
  const wanted = asked.get("theme");
  const preferred = prefersDark.matches ? "dark" : "light";
  setTheme(["dark", "light"].includes(wanted) ? wanted : preferred);
  prefersDark.addEventListener("change", e => setTheme(e.matches ? "dark" : "light"));
  byId("theme").addEventListener("click", () =>
    setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));

  function noteFirstFrame(view) {
    view.onDrawn(() => {
      if (status.dataset.firstFrameMs) return;
      status.dataset.firstFrameMs = Math.round(performance.now());
      const box = byId("canvas").getBoundingClientRect();
      status.dataset.canvas = [box.left, box.top, box.width, box.height].map(Math.round).join(",");
    });
  }
  function showVersions() {
    byId("report-version").textContent = report.version;
    byId("page-libraries").textContent =
      Object.entries(report.libraries).map(([name, version]) => name + " " + version).join(", ");
  }
  // A factor's heading stands where something below it is shown, or it says all itself.
  function showFactors() {
    for (const factor of document.querySelectorAll(".factor")) {
      const sections = [];
      for (let next = factor.nextElementSibling; next && next.matches("section.panel");
           next = next.nextElementSibling) sections.push(next);
      factor.hidden = sections.length > 0 && sections.every(section => section.hidden);
    }
  }
  function showNavigation() {
    showFactors();
    for (const section of document.querySelectorAll("main > section.panel")) {
      if (section.hidden) continue;
      byId("nav").append(viscera.element("a", {href: "#" + section.id}, section.dataset.short));
    }
  }
  const ready = () => { if (status.dataset.state === "loading") status.dataset.state = "ready"; };
  const note = message => status.append(message + "\n");
  return {report, asked, fail, note, noteFirstFrame, showVersions, showNavigation, ready};
};
