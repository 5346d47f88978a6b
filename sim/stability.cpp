#include "sim/stability.hpp"

#include <algorithm>
#include <iomanip>
#include <limits>
#include <sstream>
#include <string>

#include "sim/refusal.hpp"

namespace viscera::sim {
namespace {

struct Shape {
  double altitude;  // m, the smallest
  double spread;    // sum |g_i|^2, 1/m2
};

// Rows of B are the gradients of N_1 to N_3; the altitude over vertex i is 1/|grad N_i|.
Shape shape_of(const Mat3<double>& rest_inverse) {
  const Mat3<double> rows = transpose(rest_inverse);
  const auto& [a, b, c] = rows.col;
  const Vec3<double> gradients[4] = {-(a + b + c), a, b, c};
  double steepest = 0.0, squares = 0.0;
  for (const auto& g : gradients) {
    steepest = std::max(steepest, norm(g));
    squares += dot(g, g);
  }
  return {1.0 / steepest, squares};
}

// Of the position based effects only the Neo-Hookean block and Prony branches have a limit.
StabilityLimit limit_of(const Stability& s, const Scene& scene, Method method) {
  if (method == Method::tled) return {"Courant", s.courant_max, courant_limit, s.courant_tet};
  const bool limited = scene.has<NeoHookean>() || scene.has<Prony>();
  if (method == Method::fem || !limited) return {"none", 0.0, 1.0, 0};
  return {"Cs", s.cs_max, cs_limit, s.cs_tet};
}

// Of all elastic effects that are on together, Pa.
double explicit_modulus(const Scene& scene, const Material& material) {
  double sum = 0.0;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (requires { &Effect::explicit_modulus; }) {
      for (const auto& params : std::get<i>(scene.effects)) {
        sum += Effect::explicit_modulus(material, params);
      }
    }
  });
  return sum;
}

}  // namespace

Stability assess(const Model& model, const Scene& scene, Method method) {
  Stability result;
  result.altitude_min = std::numeric_limits<double>::infinity();
  const double dt = scene.time.substep_s();
  const auto keep_largest = [](double value, std::size_t tet, double& largest, std::size_t& where) {
    if (value > largest) largest = value, where = tet;
  };
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Material material = model.material(t);
    const Lame constants = lame(material);
    const auto [h, spread] = shape_of(model.rest_inverse[t]);
    const double shear = dt * std::sqrt(constants.mu / material.density);
    const double sound = dt * std::sqrt((constants.lambda + 2.0 * constants.mu) / material.density);
    result.altitude_min = std::min(result.altitude_min, h);
    keep_largest(shear / h, t, result.cs_max, result.cs_tet);
    keep_largest(sound / h, t, result.kappa_max, result.kappa_tet);
    const double stiffest = std::sqrt(explicit_modulus(scene, material) / material.density);
    keep_largest(dt * stiffest * std::sqrt(spread), t, result.courant_max, result.courant_tet);
  }
  result.limit = limit_of(result, scene, method);
  const double needed = scene.time.substeps * result.limit.value / result.limit.at_most;
  result.substeps_needed = std::max(1.0, std::ceil(needed * (1.0 - 1e-12)));
  return result;
}

Stability apply_policy(const Model& model, Scene& scene, Method method) {
  const Stability first = assess(model, scene, method);
  const StabilityLimit& limit = first.limit;
  if (limit.value <= limit.at_most) return first;
  if (scene.stability == StabilityPolicy::warn) return first;
  const double needed = first.substeps_needed;
  if (scene.stability == StabilityPolicy::refuse || needed > max_substeps) {
    std::ostringstream found, at_most;
    found << scene.time.substeps << ", which makes " << limit.name << ' ' << limit.value
          << " at tet " << limit.tet;
    at_most << std::setprecision(15) << needed << " substeps for " << limit.name << ' '
            << limit.at_most << ", and at most " << max_substeps;
    throw Refusal(Refusal::Cause::scene, "time.substeps", found.str(), at_most.str(),
                  "raise time.substeps, soften the material, or mesh without slivers");
  }
  scene.time.substeps = static_cast<int>(needed);
  return assess(model, scene, method);
}

}  // namespace viscera::sim
