#include "sim/measures/explicit_limit.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "sim/base/parallel.hpp"
#include "sim/measures/element_forces.hpp"
#include "sim/measures/stability.hpp"
#include "sim/scene/elasticity.hpp"

namespace viscera::sim {
namespace {

constexpr int max_iterations = 40;
constexpr double settled =
    1e-3;  // relative change of the eigenvalue from one iteration to the next

struct Stretches {
  double s1, s1_s2, s3;  // of the singular values; s3 has the sign of J
  double j;
  double slowest, fastest;  // eigenvalues of H_J

  explicit Stretches(const Mat3<double>& h) {
    const Mat3<double> f = plus_identity(1.0, h), cof = cofactor(f);
    const double squares = squared_norm(f);
    j = det(f);
    s1 = std::sqrt(std::max(0.0, largest_eigenvalue(transpose(f) * f)));
    s1_s2 = std::sqrt(std::max(0.0, largest_eigenvalue(transpose(cof) * cof)));
    s3 = s1_s2 > 0.0 ? j / s1_s2 : 0.0;
    const double r = std::sqrt(squares / 3.0);
    const double angle = std::acos(std::clamp(r > 0.0 ? j / (r * r * r) : 0.0, -1.0, 1.0)) / 3.0;
    fastest = std::max(s1, 2.0 * r * std::cos(angle));
    slowest = std::min(-s1, 2.0 * r * std::cos(angle + 2.0 * M_PI / 3.0));
  }
  double s2() const { return s1 > 0.0 ? s1_s2 / s1 : 0.0; }
  double largest_of_j(double c) const { return std::max(c * slowest, c * fastest); }
};

template <class Effect>
double modulus_now(const Material& material, const typename Effect::Params& params,
                   const Stretches& now) {
  const Lame constants = lame(material);
  const double mu = constants.mu, lambda = constants.lambda;
  const double s2 = now.s2(), trace = now.s1 + s2 + now.s3;
  const double squares = now.s1 * now.s1;
  const double trace_e = 0.5 * (squares + s2 * s2 + now.s3 * now.s3 - 3.0);  // of Green's strain
  using Law = law_of<Effect>;
  if constexpr (std::is_same_v<Law, NeoHookean>) {
    const double own = Effect::lame_at(material, params).neo_hookean_lambda();
    return mu + now.largest_of_j(own * (now.j - 1.0) - mu) + own * now.s1_s2 * now.s1_s2;
  } else if constexpr (std::is_same_v<Effect, GroupedVolume>) {
    const double own = GroupedVolume::of_groups(constants);
    if (params.strain == VolumeStrain::linear) return own;
    if (params.strain == VolumeStrain::green) return own * (squares + std::max(0.0, trace_e));
    return now.largest_of_j(own * (now.j - 1.0)) + own * now.s1_s2 * now.s1_s2;
  } else if constexpr (std::is_same_v<Effect, Volume>) {
    return now.largest_of_j(lambda * (now.j - 1.0)) + lambda * now.s1_s2 * now.s1_s2;
  } else if constexpr (std::is_same_v<Law, MooneyRivlin> || std::is_same_v<Law, Ogden>) {
    const auto [k, own] = Law::moduli(Effect::lame_at(material, params), params);
    const auto shape = Law::template shape<double>(params);
    const double pressure = k * Law::stress_at_rest(shape);
    return 0.5 * k * Law::largest_curvature(shape, now.s1, s2, now.s3) +
           now.largest_of_j(own * (now.j - 1.0) - pressure) + own * now.s1_s2 * now.s1_s2;
  } else if constexpr (std::is_same_v<Law, StVK>) {
    const Lame own = Effect::lame_at(material, params);
    return (own.lambda + 2.0 * own.mu) * squares +
           std::max(0.0, own.lambda * trace_e + own.mu * (squares - 1.0));
  } else if constexpr (std::is_same_v<Effect, Corotational>) {
    const double turning = std::max(0.0, lambda * (trace - 3.0) - 2.0 * mu);
    const double least = std::max(1e-3, s2 + now.s3);
    return lambda + 2.0 * mu + 2.0 * turning / least;
  } else {
    return Effect::explicit_modulus(material, params);
  }
}

template <class Effect>
concept Elastic = requires {
  &Effect::explicit_modulus;
};

template <class Effect>
bool acts_on(const typename Effect::Params& params, std::size_t tet) {
  if constexpr (requires { Effect::acts_on(params, tet); }) return Effect::acts_on(params, tet);
  return true;
}

// The square of the Courant number that no tet exceeds, tet by tet.
std::vector<double> bounds(const Model& model, const Scene& scene, const State& state) {
  std::vector<double> squared(model.tet_count());
  const double dt = scene.time.substep_s();
  parallel_ranges(model.tet_count(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      const Stretches now(gradient_of(model, state, t));
      const Material material = model.material(t);
      double modulus = 0.0;
      Effects::for_each([&]<class Effect, std::size_t i>() {
        if constexpr (Elastic<Effect>) {
          for (const auto& params : std::get<i>(scene.effects)) {
            if (acts_on<Effect>(params, t)) modulus += modulus_now<Effect>(material, params, now);
          }
        }
      });
      squared[t] = dt * dt * modulus / material.density * squared_gradients(model.rest_inverse[t]);
    }
  });
  return squared;
}

// Adds the elastic forces of an effect at u + step d, times `weight`, N. The history of a branch is
// that of this state.
template <class Effect>
void add_elastic(const Prepared<Effect, double>& effect, const State& state, const VertexField& d,
                 double step, double weight, VertexField& forces) {
  constexpr int arity = Effect::arity;
  for (std::size_t e = 0; e < effect.rest.size(); ++e) {
    Vec3<double> u[arity], moved[arity], force[arity];
    for (int i = 0; i < arity; ++i) {
      u[i] = state.u[effect.vertices[e][i]];
      moved[i] = step * d[effect.vertices[e][i]];
    }
    double history[std::max(1, history_of<Effect>)] = {};
    if constexpr (history_of < Effect >> 0) Effect::update_history(effect.rest[e], u, history);
    element_force<Effect>(effect.rest[e], history, u, moved, force);
    for (int i = 0; i < arity; ++i) forces[effect.vertices[e][i]] += weight * force[i];
  }
}

template <class Effect>
using Slot = Prepared<Effect, double>;

// The largest eigenvalue of the tangent over the lumped masses, 1/s2. Begins at random around the
// tets whose bounds are largest, where the fastest mode is.
double fastest_mode(const Model& model, const Scene& scene, const State& state,
                    const std::vector<double>& bounds) {
  Effects::Slots<Slot> forces;
  // Steps longer than any relaxation: the history of a branch is where it is.
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (Elastic<Effect>) {
      for (const auto& params : std::get<i>(scene.effects)) {
        std::get<i>(forces).emplace_back(model, params, HUGE_VAL);
      }
    }
  });
  const double largest = *std::ranges::max_element(bounds);
  const double step = 1e-7 * model.size();
  VertexField way(model.vertex_count());
  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const double weight = std::pow(bounds[t] / largest, 4.0);
    for (const int v : model.tets[t]) {
      way[v] += weight * Vec3<double>{any(random), any(random), any(random)};
    }
  }
  double eigenvalue = 0.0;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    double longest = 0.0;
    for (std::size_t v = 0; v < way.size(); ++v) {
      if (model.fixed[v]) way[v] = {};
      longest = std::max(longest, norm(way[v]));
    }
    if (!(longest > 0.0) || !std::isfinite(longest)) break;
    for (auto& w : way) w = (1.0 / longest) * w;
    VertexField change(way.size());
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Elastic<Effect>) {
        for (const auto& effect : std::get<i>(forces)) {
          add_elastic<Effect>(effect, state, way, step, -0.5 / step, change);
          add_elastic<Effect>(effect, state, way, -step, 0.5 / step, change);
        }
      }
    });
    double work = 0.0, inertia = 0.0;
    for (std::size_t v = 0; v < way.size(); ++v) {
      if (model.fixed[v]) continue;
      work += dot(way[v], change[v]);
      inertia += model.mass[v] * dot(way[v], way[v]);
      way[v] = (1.0 / model.mass[v]) * change[v];
    }
    const double before = eigenvalue;
    eigenvalue = std::max(eigenvalue, work / inertia);
    if (iteration > 8 && eigenvalue - before < settled * eigenvalue) break;
  }
  return eigenvalue;
}

}  // namespace

ExplicitLimit explicit_limit(const Model& model, const Scene& scene, const State& state) {
  ExplicitLimit limit;
  const std::vector<double> squared = bounds(model, scene, state);
  limit.courant = std::sqrt(*std::ranges::max_element(squared));
  if (limit.courant > 1.0) {
    limit.courant =
        0.5 * scene.time.substep_s() * std::sqrt(fastest_mode(model, scene, state, squared));
    limit.exact = true;
  }
  const double needed = scene.time.substeps * limit.courant / courant_limit;
  limit.substeps_needed = std::max(1.0, std::ceil(needed * (1.0 - 1e-12)));
  return limit;
}

}  // namespace viscera::sim
