#include "pipeline/base/yaml_file.hpp"

#include <fmt/format.h>
#include <yaml-cpp/eventhandler.h>

#include <algorithm>
#include <set>
#include <sstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"

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

// Reads past documents without keeping them.
struct Ignored final : YAML::EventHandler {
  using Mark = YAML::Mark;
  using Style = YAML::EmitterStyle::value;
  void OnDocumentStart(const Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const Mark&, YAML::anchor_t) override {}
  void OnAlias(const Mark&, YAML::anchor_t) override {}
  void OnScalar(const Mark&, const std::string&, YAML::anchor_t, const std::string&) override {}
  void OnSequenceStart(const Mark&, const std::string&, YAML::anchor_t, Style) override {}
  void OnSequenceEnd() override {}
  void OnMapStart(const Mark&, const std::string&, YAML::anchor_t, Style) override {}
  void OnMapEnd() override {}
};

// Whether there are 0, 1 or more. YAML::LoadAll never ends where one begins with a comma (0.7).
int count_documents(const std::string& text) {
  std::istringstream in(text);
  YAML::Parser parser(in);
  Ignored ignored;
  int count = 0;
  while (count < 2 && parser.HandleNextDocument(ignored)) ++count;
  return count;
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

bool is_yaml_text(const std::string& text) {
  const auto is_control = [](unsigned char c) {
    return (c < 0x20 && c != '\t' && c != '\n' && c != '\r') || c == 0x7f;
  };
  return is_utf8(text) && std::none_of(text.begin(), text.end(), is_control);
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
    const std::string text = read_file(path);
    // Its texts become JSON, which can hold no others.
    if (!is_yaml_text(text)) {
      throw fail("text that is not UTF-8, or has control characters", "save it as UTF-8 text");
    }
    const int documents = count_documents(text);
    if (documents != 1) {
      throw fail(documents == 0 ? "no YAML document" : "more than one YAML document",
                 "keep one document");
    }
    const YAML::Node document = YAML::Load(text);
    Checker(path).check(document, 0);
    return document;
  } catch (const YAML::Exception& e) {
    throw Error(ExitCode::bad_config, {.where = place(path, e.mark),
                                       .found = e.msg,
                                       .allowed = "YAML 1.2",
                                       .remedy = remedy_at(path, e.mark)});
  }
}

}  // namespace viscera
