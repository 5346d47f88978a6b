#include "sim/model/start.hpp"

#include <string>

#include "sim/base/refusal.hpp"

namespace viscera::sim {
namespace {

[[noreturn]] void refuse(const char* field, const std::string& found, const std::string& allowed,
                         const char* remedy) {
  throw Refusal(Refusal::Cause::scene, field, found, allowed, remedy);
}

// Less of a face's area left than round-off of single precision in the edges leaves behind.
bool is_collapsed(const Model& model, const State& state, std::size_t tet) {
  constexpr double area = 1e-6;
  const auto& [a, b, c, d] = model.tets[tet];
  const Vec3<double> u[4] = {state.u[a], state.u[b], state.u[c], state.u[d]};
  const Mat3<double> f = plus_identity(1.0, displacement_gradient(u, model.rest_inverse[tet]));
  return squared_norm(cofactor(f)) < area * area;
}

}  // namespace

void check_start(const Model& model, const State& state) {
  const std::size_t n = model.vertex_count();
  if (state.u.size() != n || state.v.size() != n) {
    refuse("start state", std::to_string(state.u.size()) + " vertices",
           std::to_string(n) + ", one for each of the mesh", "start from a state of this mesh");
  }
  if (!state.finite()) {
    refuse("start state", "values that are not finite", "finite displacements and velocities",
           "start from an earlier state");
  }
  std::size_t count = 0, first = 0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    if (is_collapsed(model, state, t) && count++ == 0) first = t;
  }
  if (count == 0) return;
  refuse("start state",
         std::to_string(count) + " tets pressed to a line or a point, the first is number " +
             std::to_string(first),
         "tets that keep an area: nothing opens the others again", "start from an earlier state");
}

}  // namespace viscera::sim
