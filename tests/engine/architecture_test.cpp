// The direction of dependency: stages -> sim and contract, engine -> contract, sim -> nothing but
// the standard library (Eigen in the FEM solver, CUDA in its backends).
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "pipeline/contract/atomic_file.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

struct Include {
  std::string file;    // relative to the root, with line
  std::string header;  // between the quotes or brackets
  bool own = false;    // in quotes
};

bool starts_with_any(const std::string& text, const std::vector<std::string>& starts) {
  return std::any_of(starts.begin(), starts.end(),
                     [&text](const std::string& start) { return text.starts_with(start); });
}

bool is_source(const fs::path& path) {
  const std::vector<std::string> kinds = {".cpp", ".hpp", ".cu", ".cuh"};
  return std::count(kinds.begin(), kinds.end(), path.extension().string()) > 0;
}

std::vector<Include> includes_of(const std::string& text, const std::string& file) {
  std::vector<Include> includes;
  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    std::erase(line, ' ');
    if (!line.starts_with("#include")) continue;
    const auto open = line.find_first_of("<\"");
    const auto close = line.find_first_of(">\"", open + 1);
    if (close == std::string::npos) continue;
    includes.push_back({file + ":" + std::to_string(number),
                        line.substr(open + 1, close - open - 1), line[open] == '"'});
  }
  return includes;
}

std::vector<Include> all_includes() {
  std::vector<Include> all;
  for (const char* room : {"pipeline", "stages", "sim", "sample_data"}) {
    for (const auto& entry : fs::recursive_directory_iterator(room)) {
      if (!entry.is_regular_file() || !is_source(entry.path())) continue;
      std::ifstream file(entry.path());
      const std::string text(std::istreambuf_iterator<char>(file), {});
      const auto found = includes_of(text, entry.path().string());
      all.insert(all.end(), found.begin(), found.end());
    }
  }
  return all;
}

struct Room {
  std::string folder;
  std::vector<std::string> may;  // include, besides itself
};

// What a file may include from this repository: the first folder that it stands in counts.
std::vector<std::string> may_include(const std::string& file) {
  const std::string contract = "pipeline/contract/", engine = "pipeline/engine/",
                    common = "stages/common/", tets = "stages/tetmesh/";
  static const std::vector<Room> rooms = {
      {contract, {}},
      {engine + "spec/", {contract}},
      {engine + "store/", {contract}},
      {engine + "programs/", {contract, engine + "store/"}},
      {engine + "plan/", {contract, engine + "spec/", engine + "store/", engine + "programs/"}},
      {engine + "run/",
       {contract, engine + "spec/", engine + "store/", engine + "programs/", engine + "plan/"}},
      {"pipeline/schema/", {contract}},
      {"pipeline/", {}},
      {"sim/", {}},
      {"sample_data/", {common, contract}},
      {common, {"sim/", contract}},
      {"stages/live/", {"stages/simulate/", common, "sim/", contract}},  // a tool on its library
      {tets + "generate/", {common, "sim/", contract}},
      {tets + "quality/", {common, "sim/", contract}},
      {tets + "exchange/", {tets + "quality/", common, "sim/", contract}},
      {tets + "improve/", {tets + "generate/", tets + "quality/", common, "sim/", contract}}};
  for (const Room& room : rooms) {
    if (!file.starts_with(room.folder)) continue;
    std::vector<std::string> may = room.may;
    may.push_back(room.folder);
    return may;
  }
  const auto end = file.find('/', std::string("stages/").size());
  return {file.substr(0, end + 1), common, "sim/", contract};
}

// Libraries that a file of sim/ may use; elsewhere any library is a matter of CMake.
bool sim_may_use(const std::string& file, const std::string& header) {
  const bool standard = header.find_first_of("/.") == std::string::npos;
  if (standard) return true;
  if (file.starts_with("sim/backend/")) {
    return starts_with_any(header, {"cuda", "cooperative_groups", "cub/"});
  }
  return file.starts_with("sim/solvers/fem") && header.starts_with("Eigen/");
}

std::string verdict(const Include& include) {
  if (include.own && !starts_with_any(include.header, may_include(include.file))) {
    return include.file + " must not include " + include.header;
  }
  if (!include.own && include.file.starts_with("sim/") &&
      !sim_may_use(include.file, include.header)) {
    return include.file + " must not use <" + include.header + ">";
  }
  return "";
}

TEST(Architecture, EveryIncludePointsTheRightWay) {
  const auto includes = all_includes();
  EXPECT_GT(includes.size(), 50u) << "run from the repository's root";
  for (const auto& include : includes) EXPECT_EQ(verdict(include), "");
}

TEST(Architecture, TheRulesNoticeAnArrowThatPointsTheWrongWay) {
  const auto refused = [](const std::string& file, const std::string& line) {
    return !verdict(includes_of(line, file).at(0)).empty();
  };
  EXPECT_TRUE(refused("sim/model.cpp", "#include \"pipeline/contract/error.hpp\""));
  EXPECT_TRUE(refused("sim/model.cpp", "#include <vtkPolyData.h>"));
  EXPECT_TRUE(refused("sim/model.cpp", "#include <yaml-cpp/yaml.h>"));
  EXPECT_TRUE(refused("sim/solvers/program.hpp", "#include <cuda_runtime.h>"));
  EXPECT_TRUE(refused("pipeline/contract/log.cpp", "#include \"pipeline/engine/spec/spec.hpp\""));
  EXPECT_TRUE(refused("pipeline/engine/spec/spec.cpp", "#  include \"stages/common/tet_io.hpp\""));
  EXPECT_TRUE(
      refused("pipeline/engine/store/store.cpp", "#include \"pipeline/engine/spec/spec.hpp\""));
  EXPECT_TRUE(
      refused("pipeline/engine/plan/key.cpp", "#include \"pipeline/engine/run/runner.hpp\""));
  EXPECT_FALSE(
      refused("pipeline/engine/run/runner.cpp", "#include \"pipeline/engine/plan/key.hpp\""));
  EXPECT_TRUE(refused("stages/tetmesh/generate/mesh.hpp", "#include \"stages/tetmesh/job.hpp\""));
  EXPECT_TRUE(refused("stages/labels/stage.cpp", "#include \"stages/surface/stage.hpp\""));
  EXPECT_TRUE(refused("stages/labels/stage.cpp", "#include \"pipeline/engine/spec/spec.hpp\""));
  EXPECT_TRUE(refused("stages/simulate/stage.cpp", "#include \"stages/live/world.hpp\""));
  EXPECT_FALSE(refused("stages/simulate/stage.cpp", "#include \"sim/model.hpp\""));
  EXPECT_FALSE(refused("sim/backend/cuda.cu", "#include <cuda_runtime.h>"));
  EXPECT_FALSE(refused("sim/solvers/fem.cpp", "#include <Eigen/Sparse>"));
}

// Calls `look(file, text)` for every C++ file that is no test.
template <class Look>
void for_each_source(Look look) {
  for (const char* room : {"pipeline", "stages", "sim", "sample_data"}) {
    for (const auto& entry : fs::recursive_directory_iterator(room)) {
      const fs::path& file = entry.path();
      if (file.extension() == ".cpp" || file.extension() == ".hpp") look(file, read_file(file));
    }
  }
}

// JsonValue bounds the depth and says the file and the place; the library's own access throws
// without either, or is undefined where nothing stands.
TEST(Architecture, JsonOfStrangersIsReadByTypeInOnePlace) {
  for_each_source([](const fs::path& file, const std::string& text) {
    if (file == "pipeline/contract/json_value.cpp") return;
    for (const char* use : {"Json::parse", "json::parse", "json::accept", "Json::exception",
                            "json::exception", ">> json"}) {
      EXPECT_EQ(text.find(use), std::string::npos) << file << " has " << use;
    }
    // What comes out of a JsonValue as it is goes on as it is.
    for (const char* use : {".raw().get", ".raw().at(", ".raw()[", ".raw().value("}) {
      EXPECT_EQ(text.find(use), std::string::npos) << file << " has " << use;
    }
  });
}

TEST(Architecture, OnlyTheBackendHoldsCuda) {
  for (const char* room : {"pipeline", "stages", "sim", "sample_data"}) {
    for (const auto& entry : fs::recursive_directory_iterator(room)) {
      const std::string kind = entry.path().extension().string();
      if (kind == ".cu" || kind == ".cuh") {
        EXPECT_TRUE(entry.path().string().starts_with("sim/backend/")) << entry.path();
      }
    }
  }
}

}  // namespace
}  // namespace viscera
