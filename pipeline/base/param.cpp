#include "pipeline/base/param.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/base/units.hpp"
#include "pipeline/base/yaml_file.hpp"

namespace viscera {
namespace {

constexpr std::array type_names = {"boolean", "integer", "real", "text", "list", "map"};

std::string name_of(ParamType type) {
  return type_names[static_cast<std::size_t>(type)];
}

std::string range_text(const Param& param) {
  const std::string unit = param.unit == "1" ? "" : " " + param.unit;
  if (param.lo && param.hi) return fmt::format("{:g} to {:g}{}", *param.lo, *param.hi, unit);
  if (param.lo) return fmt::format("at least {:g}{}", *param.lo, unit);
  if (param.hi) return fmt::format("at most {:g}{}", *param.hi, unit);
  return "any finite number" + unit;
}

std::string joined(const std::vector<std::string>& choices) {
  std::string all;
  for (const auto& choice : choices) all += (all.empty() ? "" : " | ") + choice;
  return all;
}

bool is_choice(const Param& param, const Json& given) {
  return given.is_string() && std::ranges::count(param.choices, given.get<std::string>()) > 0;
}

std::string allowed_text(const Param& param) {
  switch (param.type) {
    case ParamType::boolean:
      return "true or false";
    case ParamType::integer:
      return joined(param.choices) + (param.choices.empty() ? "" : " | ") + "a whole number, " +
             range_text(param);
    case ParamType::real:
      return range_text(param);
    case ParamType::list:
      return "a list, [a, b]";
    case ParamType::map:
      return "a map, {name: value}";
    case ParamType::text:
      break;
  }
  return param.choices.empty() ? "a text" : joined(param.choices);
}

Json scalar_from_text(const std::string& text) {
  if (text == "null" || text == "~" || text.empty()) return nullptr;
  if (text == "true" || text == "false") return text == "true";
  const char* end = text.data() + text.size();
  std::int64_t whole = 0;
  if (auto [rest, failure] = std::from_chars(text.data(), end, whole);
      failure == std::errc{} && rest == end) {
    return whole;
  }
  double number = 0.0;
  if (auto [rest, failure] = std::from_chars(text.data(), end, number);
      failure == std::errc{} && rest == end && std::isfinite(number)) {
    return number;
  }
  return text;
}

// Of a number with a point, as 16.0: JSON knows no other numbers.
bool is_whole(const Json& value) {
  constexpr double exact = 9007199254740992.0;  // 2^53, up to which every whole number is a double
  if (!value.is_number_float()) return false;
  const double number = value.get<double>();
  return std::abs(number) <= exact && std::floor(number) == number;
}

Json from_yaml(const YAML::Node& node) {
  switch (node.Type()) {
    case YAML::NodeType::Scalar:
      return node.Tag() == "!" ? Json(node.Scalar()) : scalar_from_text(node.Scalar());
    case YAML::NodeType::Sequence: {
      Json list = Json::array();
      for (const auto& item : node) list.push_back(from_yaml(item));
      return list;
    }
    case YAML::NodeType::Map: {
      Json map = Json::object();
      for (const auto& item : node) map[item.first.Scalar()] = from_yaml(item.second);
      return map;
    }
    default:
      return nullptr;
  }
}

// Of a map: a value that its stage would refuse is refused where its line is known.
void check_entry(const Param& map, const Json& value, const std::string& where,
                 const std::string& field) {
  if (map.entry.empty()) return;
  if (map.entry.front().name.empty()) {
    resolve_required(map.entry.front(), value, where, field);
    return;
  }
  if (value.is_object()) {
    resolve(map.entry, value, where, field + ".");
    return;
  }
  std::vector<std::string> names;
  for (const auto& param : map.entry) names.push_back(param.name);
  throw Error(ExitCode::bad_config,
              {.where = where,
               .field = field,
               .found = value.dump(),
               .allowed = fmt::format("a map, {{name: value}}, of {}", fmt::join(names, ", "))});
}

}  // namespace

bool is_thread_count(const Param& param) {
  return param.name == "threads" && param.type == ParamType::integer && !param.in_key;
}

Param quantity(const char* name, Json fallback, const char* unit, double lo, double hi,
               const char* doc) {
  return {.name = name,
          .type = ParamType::real,
          .fallback = std::move(fallback),
          .unit = unit,
          .lo = lo,
          .hi = hi,
          .doc = doc};
}

Json to_json(const Param& param) {
  Json json{{"name", param.name}, {"type", name_of(param.type)}, {"default", param.fallback}};
  if (param.type == ParamType::real) json["unit"] = param.unit;
  if (param.lo) json["min"] = *param.lo;
  if (param.hi) json["max"] = *param.hi;
  if (!param.choices.empty()) json["choices"] = param.choices;
  for (const auto& one : param.entry) json["entry"].push_back(to_json(one));
  json["doc"] = param.doc;
  json["in_key"] = param.in_key;
  return json;
}

Param param_from_json(const JsonValue& json) {
  const JsonValue type_name = json["type"];
  const auto type = std::find(type_names.begin(), type_names.end(), type_name.text());
  if (type == type_names.end()) {
    throw type_name.refused(fmt::format("{}", fmt::join(type_names, ", ")));
  }
  Param param{.name = json["name"].text(),
              .type = static_cast<ParamType>(type - type_names.begin()),
              .fallback = json["default"].raw()};
  if (const auto unit = json.find("unit")) param.unit = unit->text();
  if (const auto least = json.find("min")) param.lo = least->number();
  if (const auto most = json.find("max")) param.hi = most->number();
  if (const auto choices = json.find("choices")) param.choices = choices->texts();
  if (const auto entry = json.find("entry")) {
    for (const auto& one : entry->items()) param.entry.push_back(param_from_json(one));
  }
  if (const auto doc = json.find("doc")) param.doc = doc->text();
  if (const auto in_key = json.find("in_key")) param.in_key = in_key->flag();
  return param;
}

Json value_from_text(const std::string& text) {
  if (!is_yaml_text(text)) {
    throw Error(ExitCode::bad_config,
                {.where = "command line",
                 .field = "--set",
                 .found = "a value that is not UTF-8, or has control characters",
                 .allowed = "UTF-8 text",
                 .remedy = "type it in a terminal whose text is UTF-8"});
  }
  try {
    // Only flow lists, maps and quoted texts need the YAML reader; a bare "a: b" is a text.
    const bool flow = text.starts_with('{') || text.starts_with('[') || text.starts_with('"');
    if (flow) return from_yaml(YAML::Load(text));
  } catch (const YAML::Exception& e) {
    throw Error(ExitCode::bad_config, {.where = "command line",
                                       .field = "--set",
                                       .found = fmt::format("'{:.100}': {}", text, e.msg),
                                       .allowed = "a scalar, [a, b] or {name: value}"});
  }
  return scalar_from_text(text);
}

Json resolve_value(const Param& param, const Json& given, const std::string& where,
                   const std::string& field) {
  const auto fail = [&]() -> Error {
    std::string remedy;
    if (given.is_string() && !param.choices.empty()) {
      remedy = suggest(given.get<std::string>(), param.choices);
    }
    return Error(ExitCode::bad_config, {.where = where,
                                        .field = field,
                                        .found = given.dump(),
                                        .allowed = allowed_text(param),
                                        .remedy = remedy});
  };
  const auto in_range = [&](double value) {
    return std::isfinite(value) && !(param.lo && value < *param.lo) &&
           !(param.hi && value > *param.hi);
  };
  if (given.is_null() && param.fallback.is_null()) return nullptr;
  switch (param.type) {
    case ParamType::boolean:
      if (given.is_boolean()) return given;
      break;
    case ParamType::integer:
      if (is_choice(param, given)) return given;
      if (given.is_number_integer() && in_range(given.get<double>())) return given;
      if (is_whole(given) && in_range(given.get<double>())) return given.get<std::int64_t>();
      break;
    case ParamType::real: {
      if (!given.is_number() && !given.is_string()) break;
      const std::string text = given.is_string() ? given.get<std::string>() : given.dump();
      const double value = parse_quantity(text, param.unit, where, field);
      if (in_range(value)) return value;
      break;
    }
    case ParamType::text: {
      if (given.is_object() || given.is_array() || given.is_null()) break;
      const std::string text = given.is_string() ? given.get<std::string>() : given.dump();
      if (param.choices.empty() || std::count(param.choices.begin(), param.choices.end(), text)) {
        return text;
      }
      break;
    }
    case ParamType::list:
      if (given.is_array()) return given;
      break;
    case ParamType::map:
      if (!given.is_object()) break;
      for (const auto& [name, value] : given.items()) {
        check_entry(param, value, where, field + "." + name);
      }
      return given;
  }
  throw fail();
}

Json resolve_required(const Param& param, const Json& given, const std::string& where,
                      const std::string& field) {
  if (!given.is_null()) return resolve_value(param, given, where, field);
  throw Error(ExitCode::bad_config, {.where = where,
                                     .field = field,
                                     .found = "no value, or one of another kind",
                                     .allowed = allowed_text(param)});
}

Json resolve(const std::vector<Param>& declared, const Json& given, const std::string& where,
             const std::string& prefix) {
  std::vector<std::string> names;
  for (const auto& param : declared) names.push_back(param.name);
  for (const auto& [name, value] : given.items()) {
    if (std::count(names.begin(), names.end(), name)) continue;
    throw Error(ExitCode::bad_config, {.where = where,
                                       .field = prefix + name,
                                       .found = "unknown parameter",
                                       .remedy = suggest(name, names)});
  }
  Json resolved = Json::object();
  for (const auto& param : declared) {
    const bool present = given.contains(param.name);
    resolved[param.name] = resolve_value(param, present ? given[param.name] : param.fallback,
                                         present ? where : "default", prefix + param.name);
  }
  return resolved;
}

}  // namespace viscera
