// The specs in configs/ hold: every stage, param, role and case of theirs is one that there is.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "pipeline/contract/atomic_file.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

TEST(Specs, OfTheProjectAllPlan) {
  const TemporaryFolder folder(fs::temp_directory_path());
  int specs = 0;
  for (const auto& entry : fs::directory_iterator("configs")) {
    if (entry.path().extension() != ".yaml") continue;
    const std::string command =
        fmt::format("'{}' run '{}' --dry-run --out '{}' --set input=sample_data/phantom.nrrd >'{}'",
                    VISCERA_ENGINE, entry.path().string(), folder.path().string(),
                    (folder.path() / "plan").string());
    EXPECT_EQ(std::system(command.c_str()), 0) << entry.path();
    EXPECT_NE(read_file(folder.path() / "plan").find("simulate: would run"), std::string::npos);
    ++specs;
  }
  EXPECT_GE(specs, 7);
}

}  // namespace
}  // namespace viscera
