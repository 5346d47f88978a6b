// What the manifest says of a run: metrics, gates, and why it diverged.
#pragma once

#include "sim/solvers/options.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/program/stage_main.hpp"
#include "stages/simulate/frame_loop.hpp"

namespace viscera {

void report_outcome(StageRun& run, const sim::Model& model, const SceneFile& file,
                    const Schedule& schedule, const sim::SolverOptions& options,
                    const Outcome& outcome);

// How a run ended, in words: at rest and what it waited for, or what kept it from resting.
std::string ending(const Outcome& outcome);

// No tet may be inside out at the end, whatever the scene expects; the scene's expectations become
// gates on metrics of this run.
void apply_gates(StageRun& run, const sim::Model& model, const SceneFile& file,
                 const Outcome& outcome);

// Where probes are at the end, and how far they have moved.
void report_probes(StageRun& run, const sim::Model& model, const std::vector<sim::Probe>& probes,
                   const Outcome& outcome);

// How wide gaps are at the end, and the least that they were.
void report_gaps(StageRun& run, const std::vector<sim::GapProbe>& gaps, const Outcome& outcome);

void report_divergence(StageRun& run, const sim::Model& model, const sim::Scene& scene,
                       const Outcome& outcome);

}  // namespace viscera
