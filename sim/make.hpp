// Every solver there is, by method and device.
#pragma once

#include <memory>
#include <string>

#include "sim/backend/cuda/cuda.hpp"
#include "sim/model/model.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/ensemble.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

// Throws Refusal(scene) as check_options does, and for effects that the method does not know.
std::unique_ptr<Solver> make_on_cpu(const Model& model, const Scene& scene,
                                    const SolverOptions& options);

// Throws Refusal(device) and Refusal(scene) as make_ensemble_on_cuda does.
std::unique_ptr<Solver> make_on_cuda(const Model& model, const Scene& scene,
                                     const SolverOptions& options);

// Members one after the other. Refused as above.
std::unique_ptr<Ensemble> make_ensemble_on_cpu(const Model& model, const Scene& scene,
                                               const SolverOptions& options, int members,
                                               const Tune& tune);

}  // namespace viscera::sim
