#include "sim/solvers/fem.hpp"

#include "sim/refusal.hpp"

namespace viscera::sim {

std::unique_ptr<Solver> make_fem(const Model&, const Scene&, const SolverOptions&) {
  throw Refusal(Refusal::Cause::scene, "solver", "fem", "xpbd", "not built yet");
}

}  // namespace viscera::sim
