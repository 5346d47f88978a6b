#include "pipeline/engine/cases.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "pipeline/contract/error.hpp"
#include "pipeline/contract/yaml_file.hpp"
#include "pipeline/engine/case_table.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

constexpr const char* sweep_example = "{substeps: [16, 32, 64]}, or a list of such maps";

class CaseReader {
 public:
  explicit CaseReader(const fs::path& path) : path_(path) {}

  std::vector<Case> read(const YAML::Node& cases, const YAML::Node& sweep) {
    const std::vector<Case> named = cases ? read_named(cases) : std::vector<Case>{Case{}};
    const std::vector<Case> points = sweep ? read_points(sweep) : std::vector<Case>{Case{}};
    if (points.size() > max_cases / named.size()) {
      throw fail(sweep ? sweep : cases, sweep ? "sweep" : "cases",
                 fmt::format("{} cases", named.size() * points.size()),
                 fmt::format("at most {}", max_cases));
    }
    std::vector<Case> all;
    for (const auto& one : named) {
      for (const auto& point : points) all.push_back(joined(one, point));
    }
    check_names(all);
    return all;
  }

 private:
  Error fail(const YAML::Node& node, const std::string& field, const std::string& found,
             const std::string& allowed) const {
    return Error(
        ExitCode::bad_config,
        {.where = place_of(path_, node), .field = field, .found = found, .allowed = allowed});
  }

  static Case joined(Case one, const Case& point) {
    one.name += (one.name.empty() || point.name.empty() ? "" : ",") + point.name;
    if (one.where.empty()) one.where = point.where;
    one.settings.insert(one.settings.end(), point.settings.begin(), point.settings.end());
    return one;
  }

  void check_name(const std::string& name, const std::string& where) const {
    if (!name.empty() && name == folder_name(name)) return;
    throw Error(ExitCode::bad_config,
                {.where = where,
                 .field = "cases",
                 .found = "'" + name + "'",
                 .allowed = "a name that can name a folder: letters, digits, _ - . + ="});
  }

  // `cases: FILE.csv`, beside the spec or below: a spec that somebody sends reads nothing else.
  std::vector<Case> read_table(const YAML::Node& cases) const {
    const fs::path folder = fs::weakly_canonical(fs::absolute(path_).parent_path());
    const fs::path table = fs::weakly_canonical(folder / cases.Scalar());
    if (cases.Scalar().empty() || !is_within(table, folder)) {
      throw fail(cases, "cases", "'" + cases.Scalar() + "'",
                 "a table (.csv) in the spec's folder or below");
    }
    std::vector<Case> named = read_case_table(path_.parent_path() / cases.Scalar());
    if (named.size() > max_cases) {
      throw fail(cases, "cases", fmt::format("{} cases", named.size()),
                 fmt::format("at most {}", max_cases));
    }
    for (const auto& one : named) check_name(one.name, one.where);
    return named;
  }

  static bool is_within(const fs::path& path, const fs::path& folder) {
    const fs::path relative = path.lexically_relative(folder);
    return !relative.empty() && *relative.begin() != "..";
  }

  std::vector<Case> read_named(const YAML::Node& cases) const {
    if (cases.IsScalar()) return read_table(cases);
    const char* const allowed = "NAME: {VARIABLE or STAGE.PARAM: VALUE}, or a table's file name";
    if (!cases.IsMap() || cases.size() == 0) throw fail(cases, "cases", "not a map", allowed);
    std::vector<Case> named;
    for (const auto& item : cases) {
      Case one{.name = item.first.Scalar(), .where = place_of(path_, item.first)};
      check_name(one.name, one.where);
      if (!item.second.IsNull() && !item.second.IsMap()) {
        throw fail(item.second, "cases." + one.name, "not a map", allowed);
      }
      for (const auto& setting : item.second) {
        one.settings.push_back(
            {setting.first.Scalar(), setting.second, place_of(path_, setting.first)});
      }
      named.push_back(std::move(one));
    }
    return named;
  }

  std::vector<Case> read_points(const YAML::Node& sweep) const {
    if (sweep.IsMap()) return product_of(sweep);
    if (!sweep.IsSequence() || sweep.size() == 0) {
      throw fail(sweep, "sweep", "neither a map nor a list of maps", sweep_example);
    }
    std::vector<Case> points;
    for (const auto& part : sweep) {
      const std::vector<Case> more = product_of(part);
      points.insert(points.end(), more.begin(), more.end());
    }
    return points;
  }

  // Every value by every value; the last name varies fastest.
  std::vector<Case> product_of(const YAML::Node& axes) const {
    if (!axes.IsMap() || axes.size() == 0) throw fail(axes, "sweep", "not a map", sweep_example);
    std::vector<Case> points = {Case{.where = place_of(path_, axes)}};
    for (const auto& axis : axes) {
      const std::string name = axis.first.Scalar();
      const bool list = axis.second.IsSequence();
      if (!axis.second.IsScalar() && !(list && axis.second.size() > 0)) {
        throw fail(axis.second, "sweep." + name, "not a list of values", sweep_example);
      }
      std::vector<Case> finer;
      for (const auto& point : points) {
        for (std::size_t i = 0; i < (list ? axis.second.size() : 1); ++i) {
          const YAML::Node value = list ? axis.second[i] : axis.second;
          finer.push_back(joined(point, point_at(axis.first, value)));
        }
        if (finer.size() > max_cases) {
          throw fail(axis.second, "sweep." + name, "too many points",
                     fmt::format("at most {}", max_cases));
        }
      }
      points = std::move(finer);
    }
    return points;
  }

  Case point_at(const YAML::Node& key, const YAML::Node& value) const {
    const std::string name = key.Scalar(), short_name = name.substr(name.rfind('.') + 1);
    std::string text = "null";
    if (value.IsScalar()) text = value.Scalar();
    if (value.IsMap() || value.IsSequence()) {
      YAML::Emitter flow;
      flow << YAML::Flow << value;
      text = flow.c_str();
    }
    return {.name = short_name + "=" + folder_name(text),
            .settings = {{name, value, place_of(path_, value)}}};
  }

  static std::string folder_name(const std::string& text) {
    std::string name;
    for (const char c : text) {
      const bool plain = std::isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '_' ||
                         c == '-' || c == '+' || c == '=';
      if (plain && !(name.empty() && c == '.')) name += c;
    }
    return name;
  }

  void check_names(const std::vector<Case>& all) const {
    std::map<std::string, const Case*> known;
    for (const auto& one : all) {
      if (known.emplace(one.name, &one).second) continue;
      throw Error(ExitCode::bad_config, {.where = one.where,
                                         .field = "cases",
                                         .found = "two cases are called '" + one.name + "'",
                                         .allowed = "values that differ in letters and digits",
                                         .remedy = "name them under cases:"});
    }
  }

  const fs::path& path_;
};

}  // namespace

std::vector<Case> read_cases(const fs::path& path, const YAML::Node& cases,
                             const YAML::Node& sweep) {
  return CaseReader(path).read(cases, sweep);
}

}  // namespace viscera
