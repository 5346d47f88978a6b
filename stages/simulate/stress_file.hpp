// stress.vtu: stress and strain of the body as it is at the end of a run, in its tets and at their
// corners. Points are at rest, with their displacement beside them. One point for every vertex and
// material: `vertex` says which of the mesh's it is. stress.h5 and stress.xdmf: von Mises' stress
// and J of the tets in every frame.
#pragma once

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/options.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/program/stage_main.hpp"
#include "stages/simulate/scene/schedule.hpp"

namespace viscera {

// Throws Error(bad_config) where nothing says which stresses a scene has.
void check_stress(const StageRun& run, const sim::Scene& scene, sim::Method method);

// Likewise where frames do not hold all that stresses are told from.
void check_stress_frames(const sim::SolverOptions& options);

// Writes the file and says in metrics and log how large stresses are. `order`: of the elements.
void write_stress(StageRun& run, const TetMesh& mesh, const sim::Model& model,
                  const sim::Scene& scene, const sim::State& state, int order);

// Of every frame of the trajectory in the run's folder, with what the schedule had changed by then.
// `model` and `scene` are those of the run, `history` is State::history in its first frame.
void write_stress_frames(StageRun& run, sim::Model model, sim::Scene scene,
                         const Schedule& schedule, std::vector<double> history);

}  // namespace viscera
