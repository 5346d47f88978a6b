// Which order of the elements suits a body and a device, for those who name none.
#pragma once

#include <string>

#include "sim/model/model.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

struct SchemeChoice {
  Scheme scheme;
  std::string why;  // half a sentence: "its time step is of second order"
};

// On a device blocks, of which a frame is one launch, unless they lack what the scene needs; colour
// by colour elsewhere. Measured in docs/results/schemes.md. By the scene as it is asked for, before
// a policy changes it: the policy goes by the scheme. Blocks have the size that suits the device
// (SolverOptions::block_tets 0).
SchemeChoice choose_scheme(const Model& model, const Scene& scene, SolverOptions options,
                           bool on_device);

}  // namespace viscera::sim
