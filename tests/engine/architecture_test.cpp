// The direction of dependency, folder by folder, and that no folder grows beyond what a reader
// takes in. sim/ uses nothing but the standard library (Eigen in the FEM solver and stress, CUDA in
// its backend).
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "pipeline/base/atomic_file.hpp"

namespace viscera::engine {
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
  for (const char* top : {"pipeline", "stages", "sim", "sample_data"}) {
    for (const auto& entry : fs::recursive_directory_iterator(top)) {
      if (!entry.is_regular_file() || !is_source(entry.path())) continue;
      std::ifstream file(entry.path());
      const std::string text(std::istreambuf_iterator<char>(file), {});
      const auto found = includes_of(text, entry.path().string());
      all.insert(all.end(), found.begin(), found.end());
    }
  }
  return all;
}

struct Folder {
  std::string name;
  std::vector<std::string> may;  // include, besides itself; "stages/report/*": with all below it
};

// What the files of a folder may include from this repository: the first folder that they stand
// in, or below, counts.
const std::vector<Folder> folders = {
    {"pipeline/base", {}},
    {"pipeline/contract", {"pipeline/base"}},
    {"pipeline/engine/spec", {"pipeline/base"}},
    {"pipeline/engine/store", {"pipeline/base", "pipeline/contract"}},
    {"pipeline/engine/programs", {"pipeline/base", "pipeline/contract", "pipeline/engine/store"}},
    {"pipeline/engine/plan",
     {"pipeline/base", "pipeline/engine/spec", "pipeline/engine/store",
      "pipeline/engine/programs"}},
    {"pipeline/engine/run",
     {"pipeline/base", "pipeline/contract", "pipeline/engine/spec", "pipeline/engine/store",
      "pipeline/engine/programs", "pipeline/engine/plan"}},
    {"pipeline/record",
     {"pipeline/base", "pipeline/contract", "pipeline/engine/store", "pipeline/engine/programs"}},
    {"pipeline/schema", {"pipeline/contract"}},
    {"pipeline/python",
     {"pipeline/base", "stages/mesh", "stages/image", "stages/labels", "stages/surface",
      "stages/tetmesh", "stages/simulate/*", "stages/program", "stages/report", "sim",
      "sim/measures", "sim/model", "sim/scene", "sim/solvers", "sim/stress"}},
    {"pipeline", {"pipeline/*"}},

    {"sim/base", {}},
    {"sim/model", {"sim/base"}},
    {"sim/effects/laws", {"sim/base", "sim/model", "sim/effects"}},
    {"sim/effects", {"sim/base", "sim/model"}},
    {"sim/scene", {"sim/base", "sim/model", "sim/effects/*"}},
    {"sim/solvers/xpbd", {"sim/base", "sim/model", "sim/effects/*", "sim/scene", "sim/solvers"}},
    {"sim/solvers/fem",
     {"sim/base", "sim/model", "sim/effects/*", "sim/scene", "sim/solvers", "sim/solvers/xpbd"}},
    {"sim/solvers", {"sim/base", "sim/model", "sim/scene"}},
    {"sim/step", {"sim/effects", "sim/solvers"}},
    {"sim/measures", {"sim/base", "sim/model", "sim/scene", "sim/solvers", "sim/solvers/xpbd"}},
    {"sim/backend/cpu",
     {"sim/base", "sim/model", "sim/scene", "sim/solvers", "sim/solvers/xpbd", "sim/step",
      "sim/backend"}},
    {"sim/backend/cuda",
     {"sim/base", "sim/model", "sim/scene", "sim/solvers", "sim/solvers/xpbd", "sim/step",
      "sim/backend"}},
    {"sim/backend",
     {"sim/base", "sim/model", "sim/effects", "sim/solvers", "sim/solvers/xpbd", "sim/measures"}},
    {"sim/stress", {"sim/base", "sim/model", "sim/scene", "sim/measures", "sim/solvers/fem"}},
    {"sim", {"sim/*"}},

    {"stages/image", {"pipeline/base", "pipeline/contract", "sim/base"}},
    {"stages/mesh", {"pipeline/base", "pipeline/contract", "sim/base"}},
    {"stages/trajectory", {"pipeline/base", "pipeline/contract", "stages/mesh"}},
    {"stages/tetmesh/generate", {"pipeline/base", "stages/image", "stages/mesh"}},
    {"stages/tetmesh/quality", {"pipeline/base", "stages/image", "stages/mesh"}},
    {"stages/tetmesh/exchange", {"pipeline/base", "pipeline/contract", "sim/base", "stages/mesh"}},
    {"stages/tetmesh/improve",
     {"pipeline/base", "sim/base", "stages/mesh", "stages/tetmesh/generate",
      "stages/tetmesh/quality"}},
    {"stages/tetmesh/mesher",
     {"pipeline/base", "stages/image", "stages/mesh", "stages/tetmesh/generate",
      "stages/tetmesh/improve", "stages/tetmesh/quality", "stages/tetmesh/exchange"}},
    {"stages/program", {"pipeline/base", "pipeline/contract"}},
    {"stages/labels", {"pipeline/base", "pipeline/contract", "stages/program", "stages/image"}},
    {"stages/surface",
     {"pipeline/base", "sim/base", "stages/program", "stages/image", "stages/mesh"}},
    {"stages/tetmesh",
     {"pipeline/base", "pipeline/contract", "sim/measures", "stages/program", "stages/image",
      "stages/mesh", "stages/tetmesh/*"}},
    {"stages/simulate/scene", {"pipeline/base", "stages/mesh", "sim/*"}},
    {"stages/simulate/exchange",
     {"pipeline/base", "stages/mesh", "stages/simulate/scene", "sim/*"}},
    {"stages/simulate/files",
     {"pipeline/base", "stages/image", "stages/mesh", "stages/trajectory", "sim/*"}},
    {"stages/simulate",
     {"pipeline/base", "pipeline/contract", "stages/program", "stages/image", "stages/mesh",
      "stages/trajectory", "stages/simulate/*", "sim/*"}},
    {"stages/live/window", {"pipeline/base", "stages/live", "stages/simulate"}},
    {"stages/live", {"pipeline/base", "stages/simulate/*", "stages/trajectory", "sim/*"}},
    {"stages/report/compare",
     {"pipeline/base", "sim/base", "stages/program", "stages/trajectory", "stages/report"}},
    {"stages/report/cohort", {"pipeline/base", "stages/program", "stages/report"}},
    {"stages/report",
     {"pipeline/base", "pipeline/contract", "sim/base", "sim/model", "stages/program",
      "stages/image", "stages/mesh", "stages/trajectory"}},
    {"sample_data", {"stages/image"}}};

bool lies_in(const std::string& file, const std::string& folder) {
  if (folder.ends_with("/*")) return file.starts_with(folder.substr(0, folder.size() - 1));
  return fs::path(file).parent_path() == folder;
}

bool may_include(const std::string& file, const std::string& header) {
  const auto folder = std::find_if(folders.begin(), folders.end(), [&file](const Folder& one) {
    return file.starts_with(one.name + "/");
  });
  if (folder == folders.end()) return false;
  return lies_in(header, fs::path(file).parent_path().string()) ||
         std::any_of(folder->may.begin(), folder->may.end(),
                     [&header](const std::string& one) { return lies_in(header, one); });
}

// Libraries that a file of sim/ may use; elsewhere any library is a matter of CMake.
bool sim_may_use(const std::string& file, const std::string& header) {
  const bool standard = header.find_first_of("/.") == std::string::npos;
  if (standard) return true;
  if (file.starts_with("sim/backend/cuda/")) {
    return starts_with_any(header, {"cuda", "cooperative_groups", "cub/"});
  }
  return starts_with_any(file, {"sim/solvers/fem/", "sim/stress/"}) && header.starts_with("Eigen/");
}

std::string verdict(const Include& include) {
  const std::string file = include.file.substr(0, include.file.find(':'));
  if (include.own && !may_include(file, include.header)) {
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
  EXPECT_TRUE(refused("sim/model/model.cpp", "#include \"pipeline/base/error.hpp\""));
  EXPECT_TRUE(refused("sim/model/model.cpp", "#include <vtkPolyData.h>"));
  EXPECT_TRUE(refused("sim/model/model.cpp", "#include <yaml-cpp/yaml.h>"));
  EXPECT_TRUE(refused("sim/solvers/xpbd/program.hpp", "#include <cuda_runtime.h>"));
  EXPECT_TRUE(refused("pipeline/base/log.cpp", "#include \"pipeline/engine/spec/spec.hpp\""));
  EXPECT_TRUE(refused("pipeline/engine/spec/spec.cpp", "#  include \"stages/mesh/tet_io.hpp\""));
  EXPECT_TRUE(
      refused("pipeline/engine/store/store.cpp", "#include \"pipeline/engine/spec/spec.hpp\""));
  EXPECT_TRUE(
      refused("pipeline/engine/plan/key.cpp", "#include \"pipeline/engine/run/runner.hpp\""));
  EXPECT_FALSE(
      refused("pipeline/engine/run/runner.cpp", "#include \"pipeline/engine/plan/key.hpp\""));
  EXPECT_TRUE(refused("stages/tetmesh/generate/mesh.hpp", "#include \"stages/tetmesh/judge.hpp\""));
  EXPECT_TRUE(refused("sim/effects/load.hpp", "#include \"sim/effects/laws/linear.hpp\""));
  EXPECT_TRUE(refused("sim/solvers/options.hpp", "#include \"sim/backend/cpu/cpu.hpp\""));
  EXPECT_TRUE(refused("sim/model/model.cpp", "#include \"sim/effects/effect.hpp\""));
  EXPECT_TRUE(refused("stages/image/image_io.cpp", "#include \"stages/program/stage_main.hpp\""));
  EXPECT_TRUE(refused("stages/labels/stage.cpp", "#include \"stages/surface/stage.hpp\""));
  EXPECT_TRUE(refused("stages/labels/stage.cpp", "#include \"pipeline/engine/spec/spec.hpp\""));
  EXPECT_TRUE(refused("stages/simulate/stage.cpp", "#include \"stages/live/world.hpp\""));
  EXPECT_FALSE(refused("stages/simulate/stage.cpp", "#include \"sim/model/model.hpp\""));
  EXPECT_FALSE(refused("sim/backend/cuda/cuda.cu", "#include <cuda_runtime.h>"));
  EXPECT_FALSE(refused("sim/solvers/fem/fem.cpp", "#include <Eigen/Sparse>"));
}

// Calls `look(file, text)` for every C++ file that is no test.
template <class Look>
void for_each_source(Look look) {
  for (const char* top : {"pipeline", "stages", "sim", "sample_data"}) {
    for (const auto& entry : fs::recursive_directory_iterator(top)) {
      const fs::path& file = entry.path();
      if (file.extension() == ".cpp" || file.extension() == ".hpp") look(file, read_file(file));
    }
  }
}

// JsonValue bounds the depth and says the file and the place; the library's own access throws
// without either, or is undefined where nothing stands.
TEST(Architecture, JsonOfStrangersIsReadByTypeInOnePlace) {
  for_each_source([](const fs::path& file, const std::string& text) {
    if (file == "pipeline/base/json_value.cpp") return;
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

// No two folders of the table may include each other.
TEST(Architecture, NoTwoFoldersIncludeEachOther) {
  for (const Folder& one : folders) {
    for (const Folder& other : folders) {
      if (one.name == other.name) continue;
      EXPECT_FALSE(may_include(one.name + "/a.cpp", other.name + "/a.hpp") &&
                   may_include(other.name + "/a.cpp", one.name + "/a.hpp"))
          << one.name << " and " << other.name;
    }
  }
}

// A unit is a file of a name, with its header.
TEST(Architecture, NoFolderHasMoreThanEighteenUnits) {
  std::map<fs::path, std::set<std::string>> units;
  for (const char* top : {"pipeline", "stages", "sim", "sample_data", "tests"}) {
    for (const auto& entry : fs::recursive_directory_iterator(top)) {
      if (!is_source(entry.path())) continue;
      units[entry.path().parent_path()].insert(entry.path().stem().string());
    }
  }
  EXPECT_GT(units.size(), 30u);
  for (const auto& [folder, names] : units) EXPECT_LE(names.size(), 18u) << folder;
}

TEST(Architecture, OnlyTheBackendHoldsCuda) {
  for (const char* top : {"pipeline", "stages", "sim", "sample_data"}) {
    for (const auto& entry : fs::recursive_directory_iterator(top)) {
      const std::string kind = entry.path().extension().string();
      if (kind == ".cu" || kind == ".cuh") {
        EXPECT_TRUE(entry.path().string().starts_with("sim/backend/cuda/")) << entry.path();
      }
    }
  }
}

}  // namespace
}  // namespace viscera::engine
