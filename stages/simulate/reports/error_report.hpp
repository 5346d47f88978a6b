// How far the body at rest is off, and whether a finer mesh is to follow.
#pragma once

#include <optional>

#include "sim/solvers/options.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/program/stage_main.hpp"
#include "stages/simulate/frame_loop.hpp"

namespace viscera {

// The parameter `adapt`.
struct AdaptGoal {
  std::optional<double> total;   // error of the displacement at rest, as a share of it; or
  std::optional<double> within;  // mm, the same, or that of one quantity,
  std::string of;                // by its name: a label's centroid, a probe or a gap
  std::size_t at_most = 0;       // tets
  bool last = false;             // no mesh follows this one
};

Param adapt_param();
// None: not asked for. Throws Error(bad_config).
std::optional<AdaptGoal> read_adapt(const StageRun& run);
// Throws Error(bad_config) where what it names is none of the model's.
void check_adapt(const StageRun& run, const sim::Model& model,
                 const std::vector<sim::Probe>& probes, const std::vector<sim::GapProbe>& gaps);

// What is asked of the error bar beside the displacement: the centroid of every label, and then the
// probes and the gaps; of a gap the vertex that is nearest in the state `u`, [n] m, at `end_s`,
// than which the gap is off by no more.
std::vector<sim::Probe> asked_of_error_bar(const sim::Model& model, const sim::Scene& scene,
                                           const std::vector<sim::Probe>& probes,
                                           const std::vector<sim::GapProbe>& gaps,
                                           const std::vector<sim::Vec3<double>>& u, double end_s);

// How far the body at rest is off (sim/error_bar.hpp), the centroids of its labels, the probes and
// the gaps, of a run that was solved with `options`; where that is unknown, why. Takes seconds to
// minutes. Writes size_field.vtu for the next mesh: with an AdaptGoal only where it is missed and a
// finer mesh may meet it; where none may, a gate fails.
void report_error_bar(StageRun& run, const TetMesh& mesh, const sim::Model& model,
                      const SceneFile& file, const std::vector<sim::Probe>& probes,
                      const std::vector<sim::GapProbe>& gaps, const Outcome& outcome,
                      const sim::SolverOptions& options);

}  // namespace viscera
