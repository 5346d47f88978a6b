// What a finished mesh is worth: its measures, topology, volumes and distances as JSON for
// quality.json and the manifest, and the gates. Lengths in mm, volumes in mm3.
#pragma once

#include <optional>

#include "stages/mesh/surface_mesh.hpp"
#include "stages/program/stage_main.hpp"
#include "stages/tetmesh/quality/label_loss.hpp"
#include "stages/tetmesh/quality/measure.hpp"
#include "stages/tetmesh/time_step.hpp"

namespace viscera {

// What a mesh is judged against, as far as it is known.
struct Wanted {
  std::map<int, double> label_volumes;  // mm3; empty: no volume is judged
  double body_volume = 0.0;             // mm3
  std::optional<std::size_t> bodies;
  std::optional<double> tets;
  std::optional<SurfaceMesh> surface;  // of the body
  std::optional<double> cell_size;     // mm
  std::optional<LabelImage> labels;
  LabelLoss loss;                      // of the labels, where they are given
  std::map<int, LabelLoss> misplaced;  // by label, where the mesh was made of them
  TimeGoal time;
};

// By which share of the tets asked for a mesh may have more or fewer.
inline constexpr double allowed_off_target = 0.1;

// Adds the gates and metrics of `mesh` to the run; returns what quality.json says.
Json judge(StageRun& run, const TetMesh& mesh, const std::vector<TetQuality>& quality,
           const Wanted& wanted);

}  // namespace viscera
