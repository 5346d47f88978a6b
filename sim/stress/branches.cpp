#include "sim/stress/branches.hpp"

#include <cmath>

#include "sim/scene/elasticity.hpp"

namespace viscera::sim {
namespace {

using Rows = std::array<double, Prony::history>;  // of a deviator (effects/laws/hookean.hpp)

bool keeps_branches(const Model& model, const Scene& scene, const State& state) {
  const std::size_t branches = scene.params<Prony>().size();
  return branches > 0 && state.history.size() == branches * model.tet_count() * Prony::history;
}

// function(branch, tet, index of its history) for every branch of every tet.
template <class Function>
void for_each_branch(const Model& model, const Scene& scene, Function&& function) {
  std::size_t at = 0;
  for (const Prony::Params& branch : scene.params<Prony>()) {
    for (std::size_t t = 0; t < model.tet_count(); ++t, at += Prony::history)
      function(branch, t, at);
  }
}

// dev E of each tet.
std::vector<Rows> deviators(const Model& model, const std::vector<Vec3<double>>& u) {
  const State state{.u = u};
  std::vector<Rows> all(model.tet_count());
  for (std::size_t t = 0; t < all.size(); ++t) {
    double rows[6];
    strain_rows(green_strain(gradient_of(model, state, t)), rows);
    std::copy_n(rows + 1, Prony::history, all[t].begin());
  }
  return all;
}

// The matrix of these coordinates.
Mat3<double> deviator_of(const Rows& rows) {
  Mat3<double> sum{};
  for (int axis = 0; axis < 3; ++axis) {
    Vec3<double> unit{};
    (axis == 0 ? unit.x : axis == 1 ? unit.y : unit.z) = 1.0;
    Vec3<double> column[6];
    basis_times(unit, column);
    for (int k = 0; k < Prony::history; ++k) sum.col[axis] += rows[k] * column[k + 1];
  }
  return sum;
}

}  // namespace

std::vector<Tensor6> branch_stresses(const Model& model, const Scene& scene, const State& state) {
  if (!keeps_branches(model, scene, state)) return {};
  const std::vector<Rows> strains = deviators(model, state.u);
  std::vector<Rows> carried(model.tet_count());  // S, Pa
  for_each_branch(model, scene, [&](const Prony::Params& branch, std::size_t t, std::size_t at) {
    const double modulus = 2.0 * lame(model.material(t)).mu * branch.modulus;
    for (int k = 0; k < Prony::history; ++k)
      carried[t][k] += modulus * (strains[t][k] - state.history[at + k]);
  });
  std::vector<Tensor6> stresses(model.tet_count());
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Mat3<double> h = gradient_of(model, state, t), f = plus_identity(1.0, h);
    const double j = 1.0 + NeoHookean::volume_strain(h);
    if (j > 0.0) stresses[t] = tensor6((1.0 / j) * (f * deviator_of(carried[t]) * transpose(f)));
  }
  return stresses;
}

// y = E - E_v has y' = E' - y / tau.
std::vector<double> followed_history(const Model& model, const Scene& scene, const State& before,
                                     const std::vector<Vec3<double>>& u, double step_s) {
  if (!keeps_branches(model, scene, before)) return {};
  const std::vector<Rows> from = deviators(model, before.u), to = deviators(model, u);
  std::vector<double> history(before.history.size());
  for_each_branch(model, scene, [&](const Prony::Params& branch, std::size_t t, std::size_t at) {
    const double kept = std::exp(-step_s / branch.time);
    const double gained = branch.time / step_s * (1.0 - kept);  // of what E has changed
    for (int k = 0; k < Prony::history; ++k) {
      const double elastic = from[t][k] - before.history[at + k];
      history[at + k] = to[t][k] - kept * elastic - gained * (to[t][k] - from[t][k]);
    }
  });
  return history;
}

}  // namespace viscera::sim
