// Thin parts that did not survive: what smoothing took from a label's surface (the surface stage's
// metrics), and what the mesh's cells are too large for (quality.json).
"use strict";

// Lets every row of a table point out its own place in the 3D view by `mark`, which may be absent.
function pointOutRows(table, mark) {
  if (!mark) return;
  [...byId(table).tBodies[0].rows].forEach((row, i) => {
    row.tabIndex = 0;
    for (const event of ["pointerenter", "focus"]) row.addEventListener(event, () => mark(i));
    for (const event of ["pointerleave", "blur"]) row.addEventListener(event, () => mark());
  });
}

// [{found: "liver surface", at: LPS mm, away: mm, thickness: mm or null, size: text}], the farthest
// first within each; `total` counts those that are not listed too.
viscera.lostParts = function (report) {
  const parts = [];
  let total = 0;
  const surface = report.stages.find(s => s.stage === "surface");
  for (const {name, value} of surface ? surface.metrics : []) {
    if (!value || !value.lost || !Array.isArray(value.lost.farthest)) continue;
    total += value.lost.parts;
    for (const part of value.lost.farthest) {
      parts.push({found: name + " surface", at: part.place_mm, away: part.distance_mm,
        thickness: null, size: `${viscera.number(part.voxels)} voxel${part.voxels === 1 ? "" : "s"}`});
    }
  }
  const mesh = ((report.quality || {}).distance || {}).lost || [];
  total += mesh.length;
  for (const part of mesh) {
    parts.push({found: "mesh", at: part.at, away: part.depth_mm,
      thickness: part.detached_ml > 0 ? null : part.thickness_mm,
      size: part.detached_ml > 0 ? viscera.quantity(part.detached_ml, "ml") + ", cut off" : "–"});
  }
  return {parts: parts.filter(part => Array.isArray(part.at) && part.at.length === 3), total};
};

// `mark(i)` points out part i in the 3D view, undefined none; it is absent without the view.
viscera.lostTable = function (report, mark) {
  const {parts, total} = viscera.lostParts(report);
  if (!parts.length) return;
  const mm = value => value === null || value === undefined ? "–"
    : viscera.number(Number(value.toPrecision(3)));
  fillTable("lost-table",
    ["Missing in", "#away, mm", "#thickness, mm", "#size", "#place, LPS mm"],
    parts.map(part => [head(part.found), number(mm(part.away)), number(mm(part.thickness)),
                       number(part.size), number(part.at.map(x => x.toFixed(1)).join(", "))]));
  pointOutRows("lost-table", mark);
  byId("lost-count").textContent = parts.length === total
    ? (total === 1 ? "The place" : `All ${total} places`)
    : `${parts.length} of ${total} places, of each surface the farthest`;
  byId("lost-box").open = parts.length <= 10;
  byId("lost-note").textContent = "Parts of the labels farther from the surface, or from the mesh, " +
    "than it may leave them: too thin for the smoothing or for the cells. A finer cell size, or a " +
    "smaller sigma, keeps them." + (mark ? " The 3D view rings the places; a row points its own out."
                                         : "");
};
