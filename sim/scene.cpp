#include "sim/scene.hpp"

#include <sstream>
#include <string>

#include "sim/refusal.hpp"

namespace viscera::sim {
namespace {

void require(bool holds, const char* field, const std::string& found, const char* allowed) {
  if (!holds) throw Refusal(Refusal::Cause::scene, field, found, allowed);
}

bool is_within(double value, double lo, double hi) {
  return value >= lo && value <= hi;  // false for NaN
}
bool is_within(const Vec3<double>& value, double lo, double hi) {
  return is_within(value.x, lo, hi) && is_within(value.y, lo, hi) && is_within(value.z, lo, hi);
}

std::string text_of(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}
std::string text_of(const Vec3<double>& v) {
  std::ostringstream text;
  text << '[' << v.x << ", " << v.y << ", " << v.z << ']';
  return text.str();
}

// Every parameter of every effect within the range that its field states.
template <class Effect>
void check_params(const typename Effect::Params& params) {
  const auto check = [&params](const auto& field) {
    if constexpr (requires { is_within(params.*field.member, field.lo, field.hi); }) {
      const auto& value = params.*field.member;
      if (is_within(value, field.lo, field.hi)) return;
      throw Refusal(Refusal::Cause::scene,
                    std::string("effects.") + Effect::name + "." + field.name, text_of(value),
                    text_of(field.lo) + " to " + text_of(field.hi) + " " + field.unit);
    }
  };
  std::apply([&check](const auto&... field) { (check(field), ...); }, Effect::fields());
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
  Effects::for_each([&scene]<class Effect, std::size_t i>() {
    for (const auto& params : std::get<i>(scene.effects)) check_params<Effect>(params);
  });
  for (const auto& gravity : scene.params<Gravity>()) {
    require(norm(gravity.direction) > 0.0, "effects.gravity.direction", "a vector of length 0",
            "a direction, for example [0, 0, -1]");
  }
  for (const auto& ground : scene.params<Ground>()) {
    require(norm(ground.normal) > 0.0, "effects.ground.normal", "a vector of length 0",
            "a direction, for example [0, 0, 1]");
  }
}

}  // namespace viscera::sim
