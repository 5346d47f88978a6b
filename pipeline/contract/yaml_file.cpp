#include "pipeline/contract/yaml_file.hpp"

#include <fmt/format.h>

#include <set>
#include <sstream>

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/error.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

std::string place(const fs::path& path, const YAML::Mark& mark) {
  if (mark.is_null()) return path.string();
  return fmt::format("{}:{}:{}", path.string(), mark.line + 1, mark.column + 1);
}

// "{volume: ${input}}" is not YAML: inside {} and [] a plain text may not hold braces.
std::string remedy_at(const fs::path& path, const YAML::Mark& mark) {
  std::istringstream lines(read_file(path));
  std::string line;
  for (int i = 0; i <= mark.line && std::getline(lines, line);) ++i;
  if (line.find("${") == std::string::npos) {
    return "check quotes, brackets and indentation there";
  }
  return "inside {} and [] write \"${name}\" with quotes, or give it a line of its own";
}

class Checker {
 public:
  explicit Checker(const fs::path& path) : path_(path) {}

  void check(const YAML::Node& node, int depth) {
    if (depth > max_yaml_depth) {
      fail(node, "", "nested too deeply", fmt::format("{} levels", max_yaml_depth));
    }
    if (++nodes_ > max_yaml_nodes) {
      fail(node, "", "too many values, aliases counted each time",
           fmt::format("{} values", max_yaml_nodes));
    }
    if (node.IsSequence()) {
      for (const auto& item : node) check(item, depth + 1);
    }
    if (node.IsMap()) check_map(node, depth);
  }

 private:
  void check_map(const YAML::Node& map, int depth) {
    std::set<std::string> keys;
    for (const auto& item : map) {
      if (!item.first.IsScalar()) fail(item.first, "key", "a list or map", "a plain name");
      const std::string& key = item.first.Scalar();
      if (!keys.insert(key).second) fail(item.first, key, "given twice", "each key once");
      check(item.second, depth + 1);
    }
  }

  [[noreturn]] void fail(const YAML::Node& node, const std::string& field, const std::string& found,
                         const std::string& allowed) const {
    throw Error(
        ExitCode::bad_config,
        {.where = place(path_, node.Mark()), .field = field, .found = found, .allowed = allowed});
  }

  const fs::path& path_;
  int nodes_ = 0;
};

}  // namespace

std::string place_of(const fs::path& path, const YAML::Node& node) {
  return place(path, node.Mark());
}

YAML::Node load_yaml(const fs::path& path) {
  const auto fail = [&path](const std::string& found, const std::string& remedy) {
    return Error(ExitCode::bad_config, {.where = path.string(), .found = found, .remedy = remedy});
  };
  std::error_code failure;
  if (!fs::is_regular_file(path, failure)) {
    throw fail("no such file", "give the path of a spec, for example configs/demo.yaml");
  }
  if (fs::file_size(path, failure) > max_yaml_bytes) {
    throw fail("larger than 1 MiB", "a spec holds settings; name data files in 'in:'");
  }
  try {
    const auto documents = YAML::LoadAll(read_file(path));
    if (documents.size() != 1) {
      throw fail(fmt::format("{} YAML documents", documents.size()), "keep one document");
    }
    Checker(path).check(documents.front(), 0);
    return documents.front();
  } catch (const YAML::Exception& e) {
    throw Error(ExitCode::bad_config, {.where = place(path, e.mark),
                                       .found = e.msg,
                                       .allowed = "YAML 1.2",
                                       .remedy = remedy_at(path, e.mark)});
  }
}

}  // namespace viscera
