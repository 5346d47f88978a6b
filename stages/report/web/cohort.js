// Puts the page of a cohort together: one row a case, then every figure's spread.
"use strict";

(function () {
  const {element, number, quantity, words, fillTable} = viscera;
  const page = viscera.openPage([], () => {});
  const {report} = page;

  const lines = texts => texts.length
    ? element("span", {}, ...texts.map(text => element("div", {}, text))) : "–";
  const failedGate = ({stage, gate}) => `${stage}: ${viscera.gateText(gate)}`;
  const outlier = o => `${o.stage}: ${words(o.name, o.unit)} ${quantity(o.value, o.unit)} ` +
    `(median ${quantity(o.median, o.unit)})`;

  function showCases() {
    const {cases} = report;
    const settings = [...new Set(cases.flatMap(one => Object.keys(one.settings)))];
    const counts = new Map();
    for (const one of cases) counts.set(one.state, (counts.get(one.state) || 0) + 1);
    byId("cases-count").textContent = `${cases.length} cases: ` +
      [...counts].map(([state, count]) => `${count} ${state}`).join(", ") + "; " +
      `${cases.filter(one => one.outliers.length).length} stand out.`;
    fillTable("cases-table", ["Case", ...settings, "State", "Gates", "Stands out by", "Message"],
      cases.map(one => ({
        failed: one.state !== "ok",
        cells: [one.case, ...settings.map(name => one.settings[name] ?? "–"), one.state,
          one.failed.length ? lines(one.failed.map(failedGate)) : `${one.gates} passed`,
          lines(one.outliers.map(outlier)), lines(one.message.split("\n").filter(Boolean))],
      })), false);
  }

  function showFigures() {
    byId("figures").hidden = !report.spreads.length;
    fillTable("figures-table", ["Figure", "Stage", "Cases", "Least", "Median", "Most"],
      report.spreads.map(s => ({cells: [words(s.name, s.unit), s.stage, number(s.cases),
        quantity(s.least, s.unit), quantity(s.median, s.unit), quantity(s.most, s.unit)]})));
  }

  showCases();
  showFigures();
  page.showVersions();
  page.showNavigation();
  page.ready();
})();
