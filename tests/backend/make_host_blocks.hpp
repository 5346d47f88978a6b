// HostBlocks<double> (host_blocks.hpp), for units that do not compile it: that takes minutes under
// the sanitizers. Defined in tests/sim/blocks_test.cpp.
#pragma once

#include <memory>

#include "sim/solvers/solver.hpp"

namespace viscera::sim {

std::unique_ptr<Solver> make_host_blocks(const Model& model, const Scene& scene,
                                         int tets_per_block);

}  // namespace viscera::sim
