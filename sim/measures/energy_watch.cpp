#include "sim/measures/energy_watch.hpp"

#include <algorithm>
#include <sstream>

#include "sim/measures/balance.hpp"
#include "sim/measures/element_forces.hpp"

namespace viscera::sim {
namespace {

constexpr double min_watched_strain = 1e-3;  // of the whole body: what is less is not judged

// Constraints whose potential the diagnostics do not count: beds and branches.
template <class Effect>
constexpr bool stores_apart = [] {
  if constexpr (is_constraint<Effect>) return !requires {
      &Effect::energy;
    };
  return false;
}();

// m/s, of the obstacles and of the vertices that are led.
double led_speed(const Scene& scene, double time_s) {
  double most = 0.0;
  for (const auto& path : scene.params<Prescribed>()) {
    constexpr double steepest = 1.5;  // of the smooth ramp, over its mean
    const double min_s = scene.time.substep_s();
    if (time_s < path.start || time_s > path.start + path.duration + scene.time.frame_s) continue;
    most = std::max(
        most, steepest * norm(path.displacement - path.from) / std::max(path.duration, min_s));
  }
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (std::is_base_of_v<Travel, typename Effect::Params>) {
      for (const auto& it : std::get<i>(scene.effects)) most = std::max(most, norm(it.velocity));
    }
  });
  return most;
}

}  // namespace

EnergyWatch::EnergyWatch(const Model& model, const Scene& scene, Method method)
    : model_(model), scene_(scene), loads_end_s_(loads_end(scene.effects)) {
  closed_ = method != Method::pbd && !scene.has<Grip>() && !scene.has<ShapeMatching>();
  Effects::for_each([&]<class Effect, std::size_t i>() {
    for (const auto& params : std::get<i>(scene.effects)) {
      if constexpr (is_load<Effect> || stores_apart<Effect>) {
        std::get<i>(on_).emplace_back(model, params, scene.time.substep_s());
        has_loads_ |= is_load<Effect>;
      }
    }
  });
  double stiffness = 0.0, fastest = 0.0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Material material = model.material(t);
    const Lame constants = lame(material);
    stiffness += model.volume[t] * material.youngs_modulus;
    fastest = std::max(fastest, (constants.lambda + 2.0 * constants.mu) / material.density);
  }
  min_energy_ = 0.5 * stiffness * min_watched_strain * min_watched_strain;
  wave_speed_ = std::sqrt(fastest);
}

double EnergyWatch::stored(const State& now) const {
  double sum = 0.0;
  const auto known = history_of_elements(on_, now);
  auto history = known.value_or(std::span<const double>());
  for_each_slot<EffectKind::element>(on_, [&]<class Effect>(const auto& effect) {
    if constexpr (stores_apart<Effect>) {
      if (history_of < Effect >> 0 && !known) return;
      constexpr int arity = Effect::arity;
      for (std::size_t e = 0; e < effect.vertices.size(); ++e) {
        Vec3<double> u[arity];
        const Vec3<double> none[arity] = {};
        for (int i = 0; i < arity; ++i) u[i] = now.u[effect.vertices[e][i]];
        Evaluation<double, Effect::rows, arity> c;
        evaluate_element<Effect>(effect.rest[e], history.data() + e * history_of<Effect>, u, none,
                                 c);
        for (int row = 0; row < Effect::rows; ++row) {
          sum += 0.5 * c.stiffness[row] * c.value[row] * c.value[row];
        }
      }
      history = history.subspan(effect.vertices.size() * history_of<Effect>);
    }
  });
  return sum;
}

// By Gauss's rule of five points, exactly: a pressure's force is of degree 2 in the places.
EnergyWatch::Work EnergyWatch::work(const State& before, const State& now) const {
  const double root = 2.0 * std::sqrt(10.0 / 7.0), more = 13.0 * std::sqrt(70.0);
  const double at[] = {0.0, std::sqrt(5.0 - root) / 3.0, std::sqrt(5.0 + root) / 3.0};
  const double weight[] = {128.0 / 225.0, (322.0 + more) / 900.0, (322.0 - more) / 900.0};
  const double apart_s = static_cast<double>(now.step - before.step) * scene_.time.substep_s();
  const std::size_t n = now.u.size();
  // Along cubics that begin and end with `begin` and `end`, m over the frame.
  const auto along = [&](const VertexField& begin, const VertexField& end) {
    double sum = 0.0;
    for_each_slot<EffectKind::element>(on_, [&]<class Effect>(const auto& effect) {
      if constexpr (is_load<Effect>) {
        for (int point = -2; point <= 2; ++point) {
          const double s = 0.5 + 0.5 * (point < 0 ? -at[-point] : at[point]);
          VertexField u(n), rate(n), force(n);
          for (std::size_t i = 0; i < n; ++i) {
            const Vec3<double> way = now.u[i] - before.u[i];
            const Vec3<double> square = 3.0 * way - 2.0 * begin[i] - end[i],
                               cube = begin[i] + end[i] - 2.0 * way;
            u[i] = before.u[i] + s * (begin[i] + s * (square + s * cube));
            rate[i] = begin[i] + s * (2.0 * square + 3.0 * s * cube);
          }
          add_forces<Effect>(effect, {}, u, {}, force);
          for (std::size_t i = 0; i < n; ++i)
            sum += 0.5 * weight[std::abs(point)] * dot(force[i], rate[i]);
        }
      }
    });
    return sum;
  };
  VertexField begin(n), end(n), way(n);
  for (std::size_t i = 0; i < n; ++i) {
    begin[i] = apart_s * before.v[i], end[i] = apart_s * now.v[i];
    way[i] = now.u[i] - before.u[i];
  }
  const double curved = along(begin, end);
  return {curved, std::abs(curved - along(way, way))};
}

std::string EnergyWatch::too_fast(const Diagnostics& sums, double time_s,
                                  const Course& course) const {
  double acceleration = 0.0;
  for (const auto& gravity : scene_.params<Gravity>()) {
    acceleration += norm(Gravity::vector(gravity));
  }
  const double limit = speed_factor * (wave_speed_ + led_speed(scene_, time_s) +
                                       std::sqrt(2.0 * acceleration * course.displacement));
  if (sums.max_speed <= limit) return "";
  std::ostringstream text;
  text << "a speed of " << sums.max_speed << " m/s, where loads and strain waves account for "
       << limit << " m/s at most";
  return text.str();
}

std::string EnergyWatch::judge(const State* before, const State& now, const Diagnostics& sums,
                               double time_s, Course& course) const {
  course.displacement = std::max(course.displacement, sums.max_displacement);
  if (!scene_.has<Grip>()) {
    if (std::string problem = too_fast(sums, time_s, course); !problem.empty()) return problem;
  }
  const double rounding = 1e-6 * scene_.time.frame_s;
  if (!closed_ || time_s < loads_end_s_ - rounding) return "";
  const double apart = stored(now);
  if (course.begun && before && has_loads_) {
    const Work more = work(*before, now);
    course.work += more.sum, course.doubt += more.doubt;
  }
  const double energy = sums.total() + apart - course.work;
  const double motion = sums.kinetic + sums.elastic + apart;
  if (!course.begun) {
    course.begun = true;
    course.least = energy;
    course.motion = motion;
  }
  course.least = std::min(course.least, energy);
  course.motion = std::max(course.motion, motion);
  const double rise = energy - course.least;
  if (rise <= energy_share * course.motion + course.doubt + min_energy_) return "";
  std::ostringstream text;
  text << "a mechanical energy that rose by " << rise
       << " J, though nothing in the scene gives any";
  return text.str();
}

}  // namespace viscera::sim
