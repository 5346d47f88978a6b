#include "sim/scene.hpp"

#include <sstream>
#include <string>

#include "sim/refusal.hpp"

namespace viscera::sim {
namespace {

void require(bool holds, const std::string& field, const std::string& found,
             const std::string& allowed) {
  if (!holds) throw Refusal(Refusal::Cause::scene, field, found, allowed);
}

bool lies_within(double value, double lo, double hi) {
  return lo <= value && value <= hi;
}
bool lies_within(const Vec3<double>& v, double lo, double hi) {
  return lies_within(v.x, lo, hi) && lies_within(v.y, lo, hi) && lies_within(v.z, lo, hi);
}
std::string text(double value) {
  std::ostringstream out;
  out << value;
  return out.str();
}
std::string text(const Vec3<double>& v) {
  return std::string("[") + text(v.x) + ", " + text(v.y) + ", " + text(v.z) + "]";
}

// Also finds what is required and missing: it is not a number.
template <class Params>
void check_range(const Field<Params, std::string>&, const Params&, const std::string&) {}
template <class Params, class Value>
void check_range(const Field<Params, Value>& field, const Params& params,
                 const std::string& prefix) {
  const Value& value = params.*field.member;
  const std::string unit = field.unit == std::string("1") ? "" : std::string(" ") + field.unit;
  require(lies_within(value, field.lo, field.hi), prefix + field.name, text(value) + unit,
          text(field.lo) + " to " + text(field.hi) + unit + ": " + field.doc);
}

}  // namespace

void check_scene(const Scene& scene) {
  const auto& time = scene.time;
  require(time.frame_s > 0.0 && std::isfinite(time.frame_s), "time.frame",
          std::to_string(time.frame_s), "a positive time in s");
  require(time.substeps >= 1, "time.substeps", std::to_string(time.substeps), "1 or more");
  require(time.end_s > 0.0 && std::isfinite(time.end_s), "time.end", std::to_string(time.end_s),
          "a positive time in s");
  require(scene.rest.speed >= 0.0, "rest.speed", std::to_string(scene.rest.speed),
          "0 m/s or more (0: never at rest)");
  require(scene.rest.hold_s >= 0.0, "rest.hold", std::to_string(scene.rest.hold_s), "0 s or more");
  require(scene.rest.residual >= 0.0, "rest.residual", std::to_string(scene.rest.residual),
          "0 or more (0: never at rest)");
  Effects::for_each([&]<class Effect, std::size_t i>() {
    for (const auto& params : std::get<i>(scene.effects)) {
      const std::string prefix = std::string("effects.") + Effect::name + ".";
      std::apply([&](const auto&... field) { (check_range(field, params, prefix), ...); },
                 Effect::fields());
      if constexpr (requires { Effect::check(params); }) Effect::check(params);
    }
  });
}

}  // namespace viscera::sim
