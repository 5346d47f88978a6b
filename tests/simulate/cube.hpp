// A cube of 5 cm whose middle is 5 cm above z = 0, and scenes to change word by word.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>

#include "stages/mesh/tet_io.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera {

// Of 6 cells^3 tets, all of them liver.
inline void write_cube(const std::filesystem::path& file, int cells) {
  const sim::Model model = sim::make_cube(cells);
  TetMesh mesh{.tets = model.tets,
               .labels = std::vector<int>(model.tet_count(), 7),
               .label_names = {{7, "liver"}}};
  for (const auto& x : model.rest) {
    mesh.points.push_back({1e3 * x.x, 1e3 * x.y, 1e3 * x.z + 50.0});
  }
  write_vtu(file, mesh);
}

// The scene with its first `old` replaced.
inline std::string with(std::string scene, const std::string& old, const std::string& replacement) {
  const auto at = scene.find(old);
  EXPECT_NE(at, std::string::npos) << old;
  return scene.replace(at, old.size(), replacement);
}

}  // namespace viscera
