// Runs viscera-simulate on a cube of 5 cm in a folder of its own.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/json_value.hpp"
#include "stages/simulate/stage.hpp"
#include "tests/simulate/cube.hpp"

namespace viscera {

namespace fs = std::filesystem;

inline const char* const drop_scene = R"(scene: 1
materials:
  liver: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3, damping: 20 ms}
effects:
  neo_hookean:
  gravity: {acceleration: 9.8 m/s2}
  ground: {clearance: 5 mm, friction: 0.3}
  viscosity:
time: {frame_rate: 60 Hz, substeps: 32, end: 4 s}
rest: {speed: 5 mm/s, hold: 0.1 s}
expect:
  inverted_max: {max: 0}
)";

class Simulate : public testing::Test {
 protected:
  Simulate() : folder_(fs::temp_directory_path()) { write_cube(path("mesh.vtu"), 3); }

  fs::path path(const std::string& name) const { return folder_.path() / name; }

  // On the CPU where `extra` names no device.
  std::vector<std::string> command_line(const std::vector<std::string>& extra,
                                        const std::string& out) const {
    std::vector<std::string> words = {"viscera-simulate",
                                      "--in",
                                      "mesh=" + path("mesh.vtu").string(),
                                      "--in",
                                      "scene=" + path("scene.yaml").string(),
                                      "--out",
                                      path(out).string()};
    const auto names_device = [](const std::string& word) { return word.starts_with("device="); };
    if (std::ranges::none_of(extra, names_device))
      words.insert(words.end(), {"--set", "device=cpu"});
    words.insert(words.end(), extra.begin(), extra.end());
    return words;
  }

  // Exit code of `viscera-simulate` with this scene; its messages are in `errors`.
  int run(const std::string& scene, std::vector<std::string> extra = {},
          const std::string& out = "out") {
    write_atomically(path("scene.yaml"), scene);
    std::vector<std::string> words = command_line(extra, out);
    std::vector<char*> argv;
    for (auto& word : words) argv.push_back(word.data());
    testing::internal::CaptureStderr();
    testing::internal::CaptureStdout();
    const int code = stage_main(static_cast<int>(argv.size()), argv.data(), simulate_stage());
    testing::internal::GetCapturedStdout();
    errors = testing::internal::GetCapturedStderr();
    return code;
  }

  Manifest manifest() const {
    const std::filesystem::path file = path("out") / "manifest.json";
    return manifest_from_json({Json::parse(read_file(file)), file.string()});
  }
  Json metric(const std::string& name) const {
    for (const auto& m : manifest().metrics) {
      if (m.name == name) return m.value;
    }
    return "absent";
  }

  std::string errors;

 private:
  TemporaryFolder folder_;
};

}  // namespace viscera
