// Quality gates: those that failed lead the page and say what that means and what to change; the
// rest wait folded.
"use strict";

viscera.allGates = report =>
  report.stages.flatMap(({stage, gates}) => gates.map(gate => ({...gate, stage})));
viscera.failedGates = report => viscera.allGates(report).filter(gate => !gate.passed);

// The places of failed gates, [{gate: index among the failed, at: LPS mm}]: the 3D view rings them.
viscera.gatePlaces = report => viscera.failedGates(report).flatMap((gate, i) =>
  (gate.at || []).filter(at => Array.isArray(at) && at.length === 3).map(at => ({gate: i, at})));

// In words and coordinates, of which a table holds a few.
function whereText(gate) {
  const shown = 3, at = gate.at || [], list = at.slice(0, shown)
    .map(place => `(${place.map(x => x.toFixed(1)).join(", ")})`).join(", ");
  const more = at.length > shown ? ` and ${at.length - shown} more` : "";
  return [gate.where, list && `at ${list} mm LPS${more}`].filter(Boolean).join("; ");
}

const sentence = text => text && text[0].toUpperCase() + text.slice(1) + (text.endsWith(".") ? "" : ".");

// Under the verdict; a page with many failures names them all in its table.
viscera.failuresInShort = function (report, box) {
  const shown = 3, failed = viscera.failedGates(report);
  for (const gate of failed.slice(0, shown)) {
    const advice = gate.remedy ? `To change it: ${gate.remedy}.` : "";
    box.append(el("p", {}, el("b", {}, `${stageTitle(gate.stage)}: ${viscera.gateText(gate)}.`),
      " " + [gate.meaning, sentence(whereText(gate)), advice].filter(Boolean).join(" ")));
  }
  if (failed.length <= shown) return;
  box.append(el("p", {}, `And ${failed.length - shown} more: see `,
    el("a", {href: "#gates"}, "Quality gates"), "."));
};

// `mark(i)` points out place i of gatePlaces in the 3D view, undefined none; it is absent without
// the view.
viscera.gates = function (report, mark) {
  const failed = viscera.failedGates(report);
  const passed = viscera.allGates(report).filter(gate => gate.passed);
  const row = gate => [
    el("td", {}, el("span", {class: gate.passed ? "pass" : "fail"},
                    gate.passed ? "✓ passed" : "✗ failed")),
    head(viscera.words(gate.name, gate.unit)), number(viscera.quantity(gate.value, gate.unit)),
    number(viscera.required(gate)), cell(stageTitle(gate.stage))];
  const advice = gate => {
    const line = (title, text) => text ? el("div", {}, el("b", {}, title + " "), text) : null;
    return el("td", {class: "advice"}, line("Means", gate.meaning), line("Where", whereText(gate)),
              line("To change it", gate.remedy));
  };
  const heads = ["Verdict", "Gate", "#Found", "#Required", "Stage"];
  fillTable("gates-table", [...heads, "What it means, where it is, what to change"],
            failed.map(gate => [...row(gate), advice(gate)]));
  const places = viscera.gatePlaces(report);
  const first = i => places.findIndex(place => place.gate === i);
  pointOutRows("gates-table", mark && (i => mark(first(i) >= 0 ? first(i) : undefined)));
  byId("gates-table").hidden = failed.length === 0;
  byId("gates-more").hidden = passed.length === 0;
  byId("gates-more").open = passed.length <= 10;
  byId("gates-count").textContent =
    passed.length === 1 ? "The gate that passed" : `The ${passed.length} gates that passed`;
  fillTable("gates-passed", heads, passed.map(row));
};
