// Tets that were inside out when the simulation ended: a result that has them is wrong there.
"use strict";

// [{tet, J, at: LPS mm in the scan, at_end: LPS mm}], the most inverted first.
viscera.invertedPlaces = function (report) {
  const places = viscera.metric(report, "simulate", "inverted_places");
  return (Array.isArray(places) ? places : [])
    .filter(place => Array.isArray(place.at) && place.at.length === 3);
};

// `mark(i)` points out place i in the 3D view, undefined none; it is absent without the view.
viscera.invertedTable = function (report, mark) {
  const metric = name => viscera.metric(report, "simulate", name);
  const places = viscera.invertedPlaces(report), total = metric("inverted_end");
  if (!places.length) return;
  const where = at => number(at.map(x => x.toFixed(1)).join(", "));
  fillTable("inverted-table", ["#Tet", "#J", "#place in the scan, LPS mm", "#at the end, LPS mm"],
    places.map(place => [number(viscera.number(place.tet)),
      number(viscera.number(Number(place.J.toPrecision(3)))), where(place.at), where(place.at_end)]));
  pointOutRows("inverted-table", mark);
  byId("inverted-count").textContent = places.length === total
    ? (total === 1 ? "The place" : `All ${total} places`)
    : `${places.length} of ${total} places, the most inverted`;
  byId("inverted-box").open = places.length <= 10;
  byId("inverted-note").textContent = `${viscera.number(total)} tet${total === 1 ? " is" : "s are"} ` +
    "turned inside out (J, the volume over the volume at rest, is not positive) in the last frame, " +
    `some since ${viscera.quantity(Number(metric("inverted_since").toPrecision(3)), "s")}. Positions ` +
    "and stresses near them are wrong; a run with them is not at rest and fails its gate." +
    (mark ? " The 3D view rings the places; a row points its own out." : "");
};
