// What accuracy costs in time, from the runs of a sweep. Runs of one scene are held against a
// reference on the same mesh, of the same elements (the solver's error) and, where there is one,
// against a truth of the body (the total error; the references' own distance from the truth is the
// discretisation error).
//
// The truth is the reference of quadratic tets on the finest mesh that has one. It needs a check,
// the reference of quadratic tets on the next mesh; in motion also a second one with other time
// steps, because two meshes may share the error of their steps. Without these the study knows the
// solver's error only. A total is given only on meshes coarser than the truth's: no mesh is its own
// truth. An error under ten times the distance of its reference to the check is doubtful: too small
// to be told.
//
// Runs that differ in `repeat` alone are one point: its time is their median, its interval that of
// the quartiles; of a single run that of its frames' quartiles. Of two points a difference in time
// is claimed only where these do not touch.
#pragma once

#include "stages/report/compare/runs.hpp"

namespace viscera {

struct StudyOptions {
  // Maps of params of viscera-simulate: a run that has all values of one of them is a reference. Of
  // those of one scene, mesh and element the last is the reference and the one before it says how
  // far the reference itself may be off.
  Json references = Json::array();
  std::vector<double> wanted_mm;  // errors that the sentences speak of, largest first
  std::string centroid;           // of this label, told as a quantity of its own; "": none
};

// { wanted_mm, scenes: [{name, scene_sha256, checkpoint_sha256, stiffness_sha256 (null: without),
//     change, span, size_mm, cost, body, no_body, centroid, front_by, meshes, points, sentences}],
//   effects: [{scene, label, tets, change, ms, ms_without, told_apart, mm, failed}] }
//
// body: {reference, tets, check, check_tets, agreement_mm (mesh and steps), agreement_centroid_mm
//       (null: no such label)}; null: there is none,
//       and no_body says why (a clause)
// front_by: the error by which points are on the front, "total_mm"; without a body "solver_mm"
// meshes: [{sha256, element, tets, reference, check, agreement_mm, discretisation_mm (null: no
// finer truth)}] points: [{setting, label, solver, method (solver and device), run, mesh_sha256,
// tets, end_s (as
//           asked for), ms [lo, median, hi], p99_ms (of the frames of one run), repeats, cs,
//           solver_error_bound (predicted share at rest), solver_mm, solver_rms_mm, total_mm,
//           centroid_mm (of mesh and solver),
//           end_mm, energy_rise (null: of a scene whose energies are not all known), volume_off,
//           inverted, failed (why; "": it did not), doubtful (solver_mm), total_doubtful,
//           centroid_doubtful, front (not doubtful, and no other such point is both cheaper and
//           nearer; by solver_mm among the points of one mesh)}]
// Errors are the largest of any vertex in any frame (span "end": in the last), null where there is
// none. Times are ms a frame (span "end": ms until it rests).
Json study_of(const std::vector<ComparedRun>& runs, const StudyOptions& options);

}  // namespace viscera
