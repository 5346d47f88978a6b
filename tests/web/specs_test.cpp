// The specs in configs/ hold: every stage, param, role and case of theirs is one that there is.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "pipeline/contract/atomic_file.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

// How many specs of a folder plan with this option; each that does not is a failure.
int specs_that_plan(const fs::path& specs, const std::string& option, const fs::path& folder) {
  int count = 0;
  for (const auto& entry : fs::directory_iterator(specs)) {
    const std::string text =
        entry.path().extension() == ".yaml" ? read_file(entry.path()) : std::string();
    if (text.find("\n  " + option.substr(0, option.find('=')) + ":") == std::string::npos) continue;
    const std::string command =
        fmt::format("'{}' run '{}' --dry-run --out '{}' --set '{}' >'{}'", VISCERA_ENGINE,
                    entry.path().string(), folder.string(), option, (folder / "plan").string());
    EXPECT_EQ(std::system(command.c_str()), 0) << entry.path();
    EXPECT_NE(read_file(folder / "plan").find(": would run"), std::string::npos) << entry.path();
    ++count;
  }
  return count;
}

TEST(Specs, OfTheProjectAllPlan) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const std::string input = "input=sample_data/phantom.nrrd";
  EXPECT_GE(specs_that_plan("configs", input, folder.path()), 7);
  EXPECT_EQ(specs_that_plan("configs/gpu", input, folder.path()), 1);
}

TEST(Specs, OfTheGpuBundlePlanOnTheMeshesThatItMakes) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const std::string made = read_file("configs/gpu/meshes.yaml");
  for (const char* mesh : {"16mm", "8mm", "5.5mm", "3.5mm"}) {
    EXPECT_NE(made.find(fmt::format("\n  {}:", mesh)), std::string::npos) << mesh;
    write_atomically(folder.path() / (std::string(mesh) + ".vtu"), "<VTKFile/>\n");
  }
  EXPECT_EQ(specs_that_plan("configs/gpu", "meshes=" + folder.path().string(), folder.path()), 2);
}

}  // namespace
}  // namespace viscera
