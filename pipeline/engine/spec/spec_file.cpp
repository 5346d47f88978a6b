#include "pipeline/engine/spec/spec_file.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "pipeline/base/yaml_file.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

const std::vector<std::string> known_keys = {"viscera", "include", "vars",  "stages", "cases",
                                             "sweep",   "rounds",  "adapt", "gather"};

void check_keys(const SpecFile& file) {
  for (const auto& item : file.root) {
    const std::string& key = item.first.Scalar();
    if (std::ranges::count(known_keys, key)) continue;
    throw Error(ExitCode::bad_config, {.where = place_of(file.path, item.first),
                                       .field = key,
                                       .found = "unknown key",
                                       .remedy = suggest(key, known_keys)});
  }
}

void check_schema(const SpecFile& file) {
  const YAML::Node schema = file.root["viscera"];
  if (schema && schema.IsScalar() && schema.Scalar() == "1") return;
  throw spec_error(file.path, schema ? schema : file.root, "viscera",
                   schema && schema.IsScalar() ? "'" + schema.Scalar() + "'" : "missing",
                   "viscera: 1, the version of the spec's schema");
}

class Loader {
 public:
  explicit Loader(const fs::path& first) : first_(first) {}

  void load(const fs::path& path) {
    const fs::path canonical = fs::weakly_canonical(fs::absolute(path));
    const SpecFile file{path, load_yaml(path)};
    expect_map(path, file.root, "spec", "viscera: 1, vars: and stages:");
    check_keys(file);
    check_schema(file);
    seen_.push_back(canonical);
    open_.push_back(canonical);
    if (const YAML::Node names = file.root["include"]) {
      for (const YAML::Node& name : list_of(file, names)) include(file, name);
    }
    open_.pop_back();
    files_.push_back(file);
  }

  std::vector<SpecFile> files() && { return std::move(files_); }

 private:
  static std::vector<YAML::Node> list_of(const SpecFile& file, const YAML::Node& names) {
    if (names.IsScalar()) return {names};
    if (names.IsSequence()) return {names.begin(), names.end()};
    throw spec_error(file.path, names, "include", "neither a file's name nor a list of them",
                     "include: FILE.yaml, or include: [ONE.yaml, TWO.yaml]");
  }

  void include(const SpecFile& file, const YAML::Node& name) {
    const fs::path folder = file.path.parent_path();
    if (!name.IsScalar() || name.Scalar().empty() ||
        !is_beside(first_, (folder.lexically_relative(first_.parent_path()) / name.Scalar()))) {
      throw spec_error(file.path, name, "include",
                       name.IsScalar() ? "'" + name.Scalar() + "'" : "not a file's name",
                       "a spec in the folder of the spec that is run, or below");
    }
    const fs::path path = (folder / name.Scalar()).lexically_normal();
    const fs::path canonical = fs::weakly_canonical(fs::absolute(path));
    if (std::ranges::count(open_, canonical)) {
      throw spec_error(file.path, name, "include", "a circle: " + path.string() + " is being read",
                       "files that do not include one another");
    }
    if (std::ranges::count(seen_, canonical)) return;
    if (seen_.size() == max_spec_files) {
      throw spec_error(file.path, name, "include", "one file more",
                       fmt::format("at most {} files", max_spec_files));
    }
    if (!fs::is_regular_file(path)) {
      throw spec_error(file.path, name, "include", "no such file: " + path.string(),
                       "a file's name, relative to the file that includes it");
    }
    load(path);
  }

  const fs::path& first_;
  std::vector<SpecFile> files_;
  std::vector<fs::path> seen_, open_;  // canonical; open: being read
};

}  // namespace

std::vector<SpecFile> load_spec_files(const fs::path& path) {
  Loader loader(path);
  loader.load(path);
  return std::move(loader).files();
}

Error spec_error(const fs::path& path, const YAML::Node& node, const std::string& field,
                 const std::string& found, const std::string& allowed) {
  return Error(ExitCode::bad_config,
               {.where = place_of(path, node), .field = field, .found = found, .allowed = allowed});
}

void expect_map(const fs::path& path, const YAML::Node& node, const std::string& field,
                const std::string& allowed) {
  if (!node.IsMap()) throw spec_error(path, node, field, "not a map", allowed);
}

bool is_beside(const fs::path& path, const std::string& name) {
  std::error_code failure;  // of a name that no file can have
  const fs::path folder = fs::weakly_canonical(fs::absolute(path).parent_path());
  const fs::path relative = fs::weakly_canonical(folder / name, failure).lexically_relative(folder);
  return !failure && !relative.empty() && *relative.begin() != "..";
}

}  // namespace viscera::engine
