// The stages there are: executables viscera-STAGE in one folder, each asked once what it declares
// (`describe`); the answer is kept by the executable's digest and the time of the last change to
// the system's packages (dpkg), whose versions a declaration holds.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include "pipeline/contract/manifest.hpp"
#include "pipeline/engine/store/store.hpp"

namespace viscera::engine {

struct StageProgramFile {
  StageInfo info;
  std::filesystem::path executable;
  std::string sha256;
};

class Catalog {
 public:
  // A declaration takes milliseconds; `patience` is enough for an executable and its libraries that
  // come from a slow network.
  Catalog(std::filesystem::path programs, Store& store,
          std::chrono::milliseconds patience = std::chrono::minutes(1))
      : programs_(std::move(programs)), store_(store), patience_(patience) {}

  // Throws Error(bad_config) naming `where` when there is no such stage, with the nearest one;
  // Error(usage) when its file may not be executed; Error(internal) when its declaration cannot be
  // read, or does not come.
  StageProgramFile find(const std::string& stage, const std::string& where);

  std::vector<std::string> names() const;  // of all stages there are, sorted

 private:
  StageInfo describe(const std::string& stage, const std::filesystem::path& executable,
                     const std::string& sha256);

  std::filesystem::path programs_;
  Store& store_;
  std::chrono::milliseconds patience_;
};

}  // namespace viscera::engine
