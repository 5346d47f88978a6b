// A cube of 5 cm above the ground for the live simulator, in a folder of its own.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>

#include "pipeline/base/atomic_file.hpp"
#include "stages/live/session.hpp"
#include "stages/simulate/stage.hpp"
#include "tests/simulate/cube.hpp"

namespace viscera::live {

namespace fs = std::filesystem;

inline const char* const live_scene = R"(scene: 1
materials:
  liver: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3, damping: 20 ms}
effects:
  neo_hookean:
  gravity:
  ground: {clearance: 5 mm, friction: 0.3}
  viscosity:
time: {frame_rate: 60 Hz, substeps: 32}
)";

class Live : public testing::Test {
 protected:
  Live() : folder_(fs::temp_directory_path()) { write_mesh("mesh.vtu", 3); }

  fs::path path(const std::string& name) const { return folder_.path() / name; }

  void write_mesh(const std::string& name, int cells) const { write_cube(path(name), cells); }

  std::unique_ptr<World> make_world(const std::string& scene = live_scene,
                                    std::vector<std::string> set = {}) const {
    write_atomically(path("scene.yaml"), scene);
    set.push_back("device=cpu");
    return std::make_unique<World>(read_run(
        simulate_stage().info,
        {"mesh=" + path("mesh.vtu").string(), "scene=" + path("scene.yaml").string()}, set));
  }

  // The vertex of the cube that is highest and farthest to the left.
  static int top_corner(const World& world) {
    const auto& rest = world.body().rest;
    const auto height = [](const Point& x) { return x.x + x.y + x.z; };
    return static_cast<int>(std::ranges::max_element(rest, {}, height) - rest.begin());
  }

  // Until it has simulated so many frames.
  static void wait_for_frame(Session& session, std::uint64_t frame) {
    for (int glance = 0; glance < 5000 && session.look().frame < frame; ++glance) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    ASSERT_GE(session.look().frame, frame);
  }

 private:
  TemporaryFolder folder_;
};

}  // namespace viscera::live
