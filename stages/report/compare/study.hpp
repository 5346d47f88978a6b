// What accuracy costs in time, from the runs of a sweep. Runs of one scene are held against a
// reference on the same mesh (the solver's error) and against one that stands for the body (the
// total; the references' own distance from it is the discretisation's part): the reference of
// quadratic tets on the finest mesh that has one, else that of linear tets on the finest mesh.
//
// Runs that differ in `repeat` alone are one point: its time is their median, its interval that of
// the quartiles; of a single run that of its frames' quartiles. Of two points a difference in time
// is claimed only where these do not touch.
#pragma once

#include "stages/report/compare/runs.hpp"

namespace viscera {

struct StudyOptions {
  // Maps of params of viscera-simulate: a run that has all values of one of them is a reference. Of
  // those of one scene and mesh the last is the reference and the one before it says how far the
  // reference itself may be off.
  Json references = Json::array();
  std::vector<double> wanted_mm;  // errors that the sentences speak of, largest first
};

// { wanted_mm, scenes: [{name, scene_sha256, change, span, size_mm, cost, body, meshes, points,
// sentences}],
//   effects: [{scene, label, tets, change, ms, ms_without, told_apart, mm, failed}] }
//
// body: {reference, tets, check, check_tets, agreement_mm}: the finest, and the next (null: none)
// meshes: [{sha256, tets, reference, check, agreement_mm, discretisation_mm (null: stands for
// the body)}] points: [{setting, label, solver, method (solver and device), run, mesh_sha256, tets,
//           ms [lo, median, hi], p99_ms (of the frames of one run), repeats, cs, solver_mm,
//           solver_rms_mm, total_mm, end_mm, energy_rise (null: of a scene whose energies are not
//           all known), volume_off, inverted, failed (why; "": it did not), doubtful,
//           total_doubtful (nearer to its reference than ten times that one to its check), front
//           (no other point of its scene is both cheaper and nearer, in total)}]
// Errors are the largest of any vertex in any frame (span "end": in the last), null where there is
// none. Times are ms a frame (span "end": ms until it rests).
Json study_of(const std::vector<ComparedRun>& runs, const StudyOptions& options);

}  // namespace viscera
