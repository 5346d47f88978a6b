#include "sim/scene.hpp"

#include <string>

#include "sim/refusal.hpp"

namespace viscera::sim {
namespace {

void require(bool holds, const char* field, const std::string& found, const char* allowed) {
  if (!holds) throw Refusal(Refusal::Cause::scene, field, found, allowed);
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
