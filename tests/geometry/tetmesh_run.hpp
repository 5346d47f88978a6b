// viscera-tetmesh as a process would run it, in a folder of its own.
#pragma once

#include <gtest/gtest.h>

#include "pipeline/base/atomic_file.hpp"
#include "stages/image/image_io.hpp"
#include "stages/mesh/surface_io.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/tetmesh/stage.hpp"
#include "tests/geometry/shapes.hpp"

namespace viscera {

class Tetmesh : public ::testing::Test {
 protected:
  std::string write(const LabelImage& image) {
    write_nrrd(folder_.path() / "labels.nrrd", image);
    return "labels=" + (folder_.path() / "labels.nrrd").string();
  }
  std::string write(const SurfaceMesh& surface) {
    write_vtp(folder_.path() / "surface.vtp", surface);
    return "surface=" + (folder_.path() / "surface.vtp").string();
  }
  testing::Outcome run(const std::string& input, const std::vector<std::string>& settings = {},
                       const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments{"--in", input, "--out", out().string()};
    for (const auto& setting : settings) arguments.insert(arguments.end(), {"--set", setting});
    arguments.insert(arguments.end(), more.begin(), more.end());
    return testing::run_stage(tetmesh_stage(), arguments);
  }
  std::filesystem::path out() const { return folder_.path() / "out"; }
  TetMesh mesh() const { return read_vtu(out() / "mesh.vtu"); }
  TemporaryFolder folder_{std::filesystem::temp_directory_path()};
};

}  // namespace viscera
