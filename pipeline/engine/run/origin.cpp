#include <fmt/format.h>

#include <iostream>
#include <set>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/contract/manifest.hpp"
#include "pipeline/engine/run/inspect.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

std::optional<Manifest> manifest_in(const fs::path& folder) {
  if (!fs::is_regular_file(folder / "manifest.json")) return std::nullopt;
  const JsonText manifest = read_json(folder / "manifest.json");
  try {
    return manifest_from_json(manifest.root());
  } catch (const Error&) {
    return std::nullopt;  // somebody else's file
  }
}

bool wrote(const Manifest& manifest, const std::string& sha256) {
  return std::any_of(manifest.outputs.begin(), manifest.outputs.end(),
                     [&sha256](const auto& output) { return output.sha256 == sha256; });
}

// The folder of the stage that wrote a file with this content: that of `beside`, or one below or
// beside it: the last stage's files also lie in the run's folder.
std::optional<fs::path> maker_of(const std::string& sha256, const fs::path& beside) {
  std::vector<fs::path> folders = {beside};
  for (const fs::path& parent : {beside, beside.parent_path()}) {
    if (!fs::is_directory(parent)) continue;
    for (const auto& entry : fs::directory_iterator(parent)) {
      if (entry.is_directory()) folders.push_back(entry.path());
    }
  }
  std::sort(folders.begin() + 1, folders.end());
  for (const auto& folder : folders) {
    const auto manifest = manifest_in(folder);
    if (manifest && wrote(*manifest, sha256)) return folder;
  }
  return std::nullopt;
}

class OriginPrinter {
 public:
  void print(const fs::path& folder, int depth) {
    const std::string indent(2 * depth, ' ');
    const Manifest manifest = *manifest_in(folder);
    std::cout << fmt::format("{}made by {} {} on {}, {} (exit {}), in {}\n", indent, manifest.stage,
                             manifest.version, manifest.device, manifest.started,
                             static_cast<int>(manifest.exit), folder.string());
    if (!shown_.insert(folder).second) return;  // its story stands above
    for (const auto& [name, value] : manifest.params.items()) {
      if (value.is_null()) continue;
      const auto unit = manifest.param_units.find(name);
      const bool has_unit = unit != manifest.param_units.end() && unit->second != "1";
      std::cout << fmt::format("{}  {} = {}{}\n", indent, name, value.dump(),
                               has_unit ? " " + unit->second : "");
    }
    for (const auto& [role, file] : manifest.inputs) {
      std::cout << fmt::format("{}  from {} {} ({:.12})\n", indent, role, file.path, file.sha256);
      const auto maker = maker_of(file.sha256, fs::path(file.path).parent_path());
      if (maker && *maker != folder) print(*maker, depth + 2);
    }
  }

 private:
  std::set<fs::path> shown_;
};

}  // namespace

void print_origin(const fs::path& file) {
  const auto fail = [&file](const std::string& found) {
    return Error(ExitCode::usage, {.where = file.string(),
                                   .field = "why",
                                   .found = found,
                                   .allowed = "a file that a run has laid out, or a spec",
                                   .remedy = "name a file below out/"});
  };
  if (!fs::is_regular_file(file)) throw fail("no such file");
  const std::string digest = sha256_file(file);
  const fs::path folder = file.has_parent_path() ? file.parent_path() : fs::path(".");
  const auto maker = maker_of(digest, folder);
  if (!maker)
    throw fail("no manifest there names a file of this content: changed, or not a result");
  std::cout << fmt::format("{} ({:.12})\n", file.string(), digest);
  OriginPrinter().print(*maker, 1);
  std::cout << std::flush;
}

}  // namespace viscera::engine
