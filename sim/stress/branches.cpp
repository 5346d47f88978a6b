#include "sim/stress/branches.hpp"

#include "sim/measures/gap.hpp"
#include "sim/scene/elasticity.hpp"

namespace viscera::sim {
namespace {

std::size_t numbers_of(const Model& model, const std::vector<Prony::Params>& branches) {
  return branches.size() * model.tet_count() * Prony::history;
}

// The matrix of these coordinates (effects/laws/hookean.hpp); the first one is 0.
Mat3<double> deviator_of(const double (&row)[6]) {
  Mat3<double> sum{};
  for (int axis = 0; axis < 3; ++axis) {
    Vec3<double> unit{};
    (axis == 0 ? unit.x : axis == 1 ? unit.y : unit.z) = 1.0;
    Vec3<double> column[6];
    basis_times(unit, column);
    for (int k = 1; k < 6; ++k) sum.col[axis] += row[k] * column[k];
  }
  return sum;
}

}  // namespace

bool tells_branches(const Model& model, const Scene& scene, const State& state) {
  const std::size_t all = numbers_of(model, scene.params<Prony>());
  return state.history.size() == all || (state.history.size() > all && obstacles_of(scene).empty());
}

std::vector<Tensor6> branch_stresses(const Model& model, const Scene& scene, const State& state) {
  const auto& branches = scene.params<Prony>();
  if (branches.empty() || !tells_branches(model, scene, state)) return {};
  const std::size_t own = model.tet_count() * Prony::history;
  const double* const viscous =
      state.history.data() + (state.history.size() - numbers_of(model, branches));
  std::vector<Tensor6> stresses(model.tet_count());
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Mat3<double> h = gradient_of(model, state, t), f = plus_identity(1.0, h);
    double strain[6], stress[6] = {};
    strain_rows(green_strain(h), strain);
    for (std::size_t b = 0; b < branches.size(); ++b) {
      const double modulus = 2.0 * lame(model.material(t)).mu * branches[b].modulus;
      for (int k = 0; k < Prony::history; ++k)
        stress[k + 1] += modulus * (strain[k + 1] - viscous[b * own + t * Prony::history + k]);
    }
    const double j = 1.0 + NeoHookean::volume_strain(h);
    if (j > 0.0) stresses[t] = tensor6((1.0 / j) * (f * deviator_of(stress) * transpose(f)));
  }
  return stresses;
}

}  // namespace viscera::sim
