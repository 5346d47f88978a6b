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

// [{found: "liver surface", at: LPS mm, away: mm, thickness, cells: mm or null, size: text}], the
// farthest first within each: all of them.
viscera.lostParts = function (report) {
  const parts = [];
  const surface = report.stages.find(s => s.stage === "surface");
  for (const {name, value} of surface ? surface.metrics : []) {
    if (!value || !value.lost || !Array.isArray(value.lost.farthest)) continue;
    for (const part of value.lost.farthest) {
      parts.push({found: name + " surface", at: part.place_mm, away: part.distance_mm,
        thickness: null, cells: null,
        size: `${viscera.number(part.voxels)} voxel${part.voxels === 1 ? "" : "s"}`});
    }
  }
  for (const part of viscera.lostFromMesh(report).parts || []) {
    const ml = viscera.quantity(Number((part.detached_ml || part.ml).toPrecision(3)), "ml");
    parts.push({found: "mesh", at: part.at, away: part.depth_mm,
      thickness: part.detached_ml > 0 ? null : part.thickness_mm,
      cells: part.detached_ml > 0 ? null : part.cell_size_mm,
      size: ml + (part.detached_ml > 0 ? ", cut off" : "")});
  }
  return parts.filter(part => Array.isArray(part.at) && part.at.length === 3);
};

viscera.lostFromMesh = report => (report.quality || {}).lost || {};

// What the mesh lacks in all, and the cells that would keep it.
viscera.lostSum = function (report) {
  const lost = viscera.lostFromMesh(report);
  if (!(lost.parts || []).length) return "";
  const short = value => viscera.number(Number(value.toPrecision(2)));
  return ` The mesh lacks ${short(lost.ml)} ml, ${short(100 * lost.share)} % of the label, up to ` +
    `${short(lost.farthest_mm)} mm away` +
    (lost.cell_size_mm ? `; a cell size of ${short(lost.cell_size_mm)} mm` +
      (lost.sigma_mm ? ` with a sigma of ${short(lost.sigma_mm)} mm` : "") + " would keep it." : ".");
};

// `mark(i)` points out part i in the 3D view, undefined none; it is absent without the view.
viscera.lostTable = function (report, mark) {
  const parts = viscera.lostParts(report);
  if (!parts.length) return;
  const mm = value => value === null || value === undefined ? "–"
    : viscera.number(Number(value.toPrecision(3)));
  fillTable("lost-table",
    ["Missing in", "#away, mm", "#thickness, mm", "#size", "#kept by cells of, mm",
     "#place, LPS mm"],
    parts.map(part => [head(part.found), number(mm(part.away)), number(mm(part.thickness)),
                       number(part.size), number(mm(part.cells)),
                       number(part.at.map(x => x.toFixed(1)).join(", "))]));
  pointOutRows("lost-table", mark);
  byId("lost-count").textContent = parts.length === 1 ? "The place" : `All ${parts.length} places`;
  byId("lost-box").open = parts.length <= 10;
  byId("lost-note").textContent = "Parts of the labels farther from the surface, or from the mesh, " +
    "than it may leave them: too thin for the smoothing or for the cells. A finer cell size, or a " +
    "smaller sigma, keeps them." + viscera.lostSum(report) +
    (mark ? " The 3D view rings the places; a row points its own out." : "");
};
