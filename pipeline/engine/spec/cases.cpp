#include "pipeline/engine/spec/cases.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "pipeline/base/error.hpp"
#include "pipeline/base/yaml_file.hpp"
#include "pipeline/engine/spec/case_table.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

constexpr const char* sweep_example = "{substeps: [16, 32, 64]}, or a list of such maps";

class CaseReader {
 public:
  CaseReader(const fs::path& cases, const fs::path& sweep) : cases_(cases), sweep_(sweep) {}

  std::vector<Case> read(const YAML::Node& cases, const YAML::Node& sweep) {
    const std::vector<Case> named = cases ? read_named(cases) : std::vector<Case>{Case{}};
    const std::vector<Case> points = sweep ? read_points(sweep) : std::vector<Case>{Case{}};
    if (points.size() > max_cases / named.size()) {
      throw spec_error(sweep ? sweep_ : cases_, sweep ? sweep : cases, sweep ? "sweep" : "cases",
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
  static Case joined(Case one, const Case& point) {
    one.name += (one.name.empty() || point.name.empty() ? "" : ",") + point.name;
    if (one.where.empty()) one.where = point.where;
    one.settings.insert(one.settings.end(), point.settings.begin(), point.settings.end());
    return one;
  }

  void check_name(const std::string& name, const std::string& where) const {
    const bool plain = !name.empty() && name == folder_name(name);
    if (plain && std::string("-+=").find(name[0]) == std::string::npos) return;
    throw Error(ExitCode::bad_config,
                {.where = where,
                 .field = "cases",
                 .found = "'" + name.substr(0, max_case_name) + "'",
                 .allowed = "a name that can name a folder: letters, digits, _ - . + =; none of "
                            "- . + = at its beginning"});
  }

  // `cases: FILE.csv`, beside the spec or below: a spec that somebody sends reads nothing else.
  std::vector<Case> read_table(const YAML::Node& cases) const {
    if (cases.Scalar().empty() || !is_beside(cases_, cases.Scalar())) {
      throw spec_error(cases_, cases, "cases", "'" + cases.Scalar() + "'",
                       "a table (.csv) in the spec's folder or below");
    }
    std::vector<Case> named = read_case_table(cases_.parent_path() / cases.Scalar());
    if (named.size() > max_cases) {
      throw spec_error(cases_, cases, "cases", fmt::format("{} cases", named.size()),
                       fmt::format("at most {}", max_cases));
    }
    for (const auto& one : named) check_name(one.name, one.where);
    return named;
  }

  std::vector<Case> read_named(const YAML::Node& cases) const {
    if (cases.IsScalar()) return read_table(cases);
    const char* const allowed = "NAME: {VARIABLE or STAGE.PARAM: VALUE}, or a table's file name";
    if (!cases.IsMap() || cases.size() == 0) {
      throw spec_error(cases_, cases, "cases", "not a map", allowed);
    }
    std::vector<Case> named;
    for (const auto& item : cases) {
      Case one{.name = item.first.Scalar(), .where = place_of(cases_, item.first)};
      check_name(one.name, one.where);
      if (!item.second.IsNull() && !item.second.IsMap()) {
        throw spec_error(cases_, item.second, "cases." + one.name, "not a map", allowed);
      }
      for (const auto& setting : item.second) {
        one.settings.push_back(
            {setting.first.Scalar(), setting.second, place_of(cases_, setting.first), cases_});
      }
      named.push_back(std::move(one));
    }
    return named;
  }

  std::vector<Case> read_points(const YAML::Node& sweep) const {
    if (sweep.IsMap()) return product_of(sweep);
    if (!sweep.IsSequence() || sweep.size() == 0) {
      throw spec_error(sweep_, sweep, "sweep", "neither a map nor a list of maps", sweep_example);
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
    if (!axes.IsMap() || axes.size() == 0) {
      throw spec_error(sweep_, axes, "sweep", "not a map", sweep_example);
    }
    std::vector<Case> points = {Case{.where = place_of(sweep_, axes)}};
    for (const auto& axis : axes) {
      const std::string name = axis.first.Scalar();
      const bool list = axis.second.IsSequence();
      if (!axis.second.IsScalar() && !(list && axis.second.size() > 0)) {
        throw spec_error(sweep_, axis.second, "sweep." + name, "not a list of values",
                         sweep_example);
      }
      std::vector<Case> finer;
      for (const auto& point : points) {
        for (std::size_t i = 0; i < (list ? axis.second.size() : 1); ++i) {
          const YAML::Node value = list ? axis.second[i] : axis.second;
          finer.push_back(joined(point, point_at(axis.first, value)));
        }
        if (finer.size() > max_cases) {
          throw spec_error(sweep_, axis.second, "sweep." + name, "too many points",
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
            .settings = {{name, value, place_of(sweep_, value), sweep_}}};
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
      if (one.name.size() > max_case_name) {
        throw Error(ExitCode::bad_config,
                    {.where = one.where,
                     .field = "cases",
                     .found = fmt::format("'{}…', a name of {} bytes", one.name.substr(0, 40),
                                          one.name.size()),
                     .allowed = fmt::format("at most {} bytes", max_case_name),
                     .remedy = "name the cases shorter, or sweep fewer values at once"});
      }
      if (known.emplace(one.name, &one).second) continue;
      throw Error(ExitCode::bad_config, {.where = one.where,
                                         .field = "cases",
                                         .found = "two cases are called '" + one.name + "'",
                                         .allowed = "values that differ in letters and digits",
                                         .remedy = "name them under cases:"});
    }
  }

  const fs::path &cases_, &sweep_;
};

}  // namespace

std::vector<Case> read_cases(const SpecFile& cases, const SpecFile& sweep) {
  return CaseReader(cases.path, sweep.path).read(cases.root["cases"], sweep.root["sweep"]);
}

}  // namespace viscera::engine
