#include "pipeline/engine/programs/catalog.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/engine/programs/process.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

const std::string prefix = "viscera-";
const std::string window = "live";  // a program beside the stages that is none

Error no_declaration(const fs::path& executable, const std::string& found) {
  return Error(ExitCode::internal,
               {.where = executable.string() + " describe",
                .found = found,
                .allowed = "the stage's declaration as JSON",
                .remedy = "run it by hand to see what it does, and build it again"});
}

StageInfo read_declaration(const std::string& stage, const fs::path& executable,
                           const std::string& text) {
  const JsonText declaration(text, executable.string());
  StageInfo info;
  try {
    info = stage_info_from_json(declaration.root());
  } catch (const Error& e) {
    throw no_declaration(executable, e.problem().field + ": " + e.problem().found);
  }
  if (info.name == stage) return info;
  throw no_declaration(executable, "it calls itself '" + info.name + "'");
}

// What the executable prints, and nothing else, is its declaration.
std::string ask(const fs::path& executable, std::chrono::milliseconds patience) {
  const auto end = run_process(
      {executable.string(), "describe"}, [](std::string_view) { /* not its job */ }, patience);
  if (end.late) {
    const std::chrono::duration<double> waited = patience;
    throw no_declaration(executable, fmt::format("did not end within {:g} s", waited.count()));
  }
  if (end.signal != 0) throw no_declaration(executable, fmt::format("signal {}", end.signal));
  if (end.exit_code != 0)
    throw no_declaration(executable, fmt::format("exit code {}", end.exit_code));
  return end.output;
}

// When the system's packages last changed: a declaration holds the versions of shared libraries,
// which an upgrade replaces without touching the executable.
std::string packages_stamp() {
  struct stat info {};
  if (stat("/var/lib/dpkg/status", &info) != 0) return "none";
  return fmt::format("{}.{:09}", info.st_mtim.tv_sec, info.st_mtim.tv_nsec);
}

}  // namespace

std::vector<std::string> Catalog::names() const {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(programs_)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(prefix) && name != prefix + window) {
      names.push_back(name.substr(prefix.size()));
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

StageProgramFile Catalog::find(const std::string& stage, const std::string& where) {
  const fs::path executable = programs_ / (prefix + stage);
  if (!fs::is_regular_file(executable)) {
    const auto known = names();
    throw Error(ExitCode::bad_config,
                {.where = where,
                 .field = "stages",
                 .found = "unknown stage '" + stage + "'",
                 .allowed = "a stage with an executable " + executable.string(),
                 .remedy = known.empty() ? "build the stages" : suggest(stage, known)});
  }
  if (access(executable.c_str(), X_OK) != 0) {
    throw Error(ExitCode::usage, {.where = executable.string(),
                                  .found = "may not be executed",
                                  .allowed = "a program that you may run",
                                  .remedy = "chmod +x " + executable.string()});
  }
  const std::string sha256 = store_.digests().digest(executable);
  return {.info = describe(stage, executable, sha256), .executable = executable, .sha256 = sha256};
}

StageInfo Catalog::describe(const std::string& stage, const fs::path& executable,
                            const std::string& sha256) {
  const fs::path kept =
      store_.folder() / "describe" / fmt::format("{}-{}-{}.json", stage, sha256, packages_stamp());
  if (fs::exists(kept)) {
    try {
      return read_declaration(stage, executable, read_file(kept));
    } catch (const Error&) {
      // A damaged copy is asked for again.
    }
  }
  const std::string declaration = ask(executable, patience_);
  const StageInfo info = read_declaration(stage, executable, declaration);
  if (!store_.read_only()) write_atomically(kept, declaration);
  return info;
}

}  // namespace viscera::engine
