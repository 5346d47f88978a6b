// From a run's files and params to what is simulated: what the stage and the live simulator share.
#pragma once

#include <functional>

#include "pipeline/base/error.hpp"
#include "sim/base/refusal.hpp"
#include "sim/model/model.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/program/stage_main.hpp"
#include "stages/simulate/frame_loop.hpp"
#include "stages/simulate/scene/scene_file.hpp"

namespace viscera {

struct Setup {
  SceneFile file;
  TetMesh mesh;      // mm
  sim::Model model;  // m
};

// Throws Error for files that do not fit, sim::Refusal for a body that cannot be simulated.
Setup set_up(StageRun& run);
// The same with a mesh that stands in for that of the run's file.
Setup set_up(StageRun& run, TetMesh mesh);

// The mesh as a body of the scene's materials. Throws Error(bad_config) for a label without one.
sim::Model body_of(const StageRun& run, const SceneFile& file, const TetMesh& mesh);

// The scene with values replaced (read_scene) and the params that stand in for parts of it.
SceneFile scene_of(const StageRun& run, const Json& changes);

// What frames are to know of themselves, as the run's params ask for it; refers to the body.
FrameOptions frame_options(const StageRun& run, const SceneFile& file, const sim::Model& model,
                           const sim::SolverOptions& options);

// A refusal as an error that names the run's file and has its exit code.
Error to_error(const sim::Refusal& refusal, const StageRun& run);

// Runs `work`, its refusals turned into errors.
void translated(const StageRun& run, const std::function<void()>& work);

}  // namespace viscera
