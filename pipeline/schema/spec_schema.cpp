#include "pipeline/schema/spec_schema.hpp"

#include <fmt/format.h>

namespace viscera {
namespace {

constexpr const char* number_pattern = R"([-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?)";

Json reference(const std::string& name) {
  return {{"$ref", "#/definitions/" + name}};
}

Json any_of(std::vector<Json> choices) {
  return {{"anyOf", std::move(choices)}};
}

Json number_schema(const Param& param, const char* type) {
  Json schema{{"type", type}};
  if (param.lo) schema["minimum"] = *param.lo;
  if (param.hi) schema["maximum"] = *param.hi;
  return schema;
}

// A number, for YAML readers that take 1e-3 for a text too; with its unit unless it has none.
Json real_schema(const Param& param) {
  const Json text{
      {"type", "string"},
      {"pattern", fmt::format("^{}{}$", number_pattern, param.unit == "1" ? "" : R"(\s*\S.*)")}};
  return param.unit == "1" ? any_of({number_schema(param, "number"), text}) : text;
}

Json type_schema(const Param& param);

Json value_schema(const Param& param) {
  std::vector<Json> choices = {type_schema(param), reference("variable")};
  if (param.fallback.is_null() && !param.name.empty()) choices.push_back({{"type", "null"}});
  Json schema = any_of(std::move(choices));
  schema["description"] =
      param.unit == "1" ? param.doc : fmt::format("{} [{}]", param.doc, param.unit);
  return schema;
}

// With what is known of the values.
Json map_schema(const std::vector<Param>& entry) {
  if (entry.empty()) return {{"type", "object"}};
  if (entry.front().name.empty())
    return {{"type", "object"}, {"additionalProperties", value_schema(entry.front())}};
  Json properties = Json::object();
  for (const auto& param : entry) properties[param.name] = value_schema(param);
  return {{"type", "object"},
          {"additionalProperties",
           {{"type", "object"},
            {"properties", std::move(properties)},
            {"additionalProperties", false}}}};
}

Json type_schema(const Param& param) {
  switch (param.type) {
    case ParamType::boolean:
      return {{"type", "boolean"}};
    case ParamType::integer:
      return number_schema(param, "integer");
    case ParamType::real:
      return real_schema(param);
    case ParamType::list:
      return {{"type", "array"}};
    case ParamType::map:
      return map_schema(param.entry);
    case ParamType::text:
      break;
  }
  if (!param.choices.empty()) return {{"enum", param.choices}};
  return {{"type", Json::array({"string", "number", "boolean"})}};
}

Json param_schema(const Param& param) {
  Json schema = value_schema(param);
  schema["default"] = param.fallback;
  return schema;
}

Json stage_schema(const StageInfo& stage) {
  Json roles = Json::object(), properties = Json::object();
  for (const auto& input : stage.inputs) {
    Json role =
        any_of({{{"type", "string"}}, {{"type", "array"}, {"items", {{"type", "string"}}}}});
    role["description"] = input.doc;
    roles[input.role] = std::move(role);
  }
  properties["in"] = {{"type", "object"}, {"properties", roles}, {"additionalProperties", false}};
  for (const auto& param : stage.params) properties[param.name] = param_schema(param);
  return {{"description", stage.doc},
          {"type", Json::array({"object", "null"})},
          {"properties", std::move(properties)},
          {"additionalProperties", false}};
}

Json map_of(Json properties, Json others) {
  return {{"type", "object"},
          {"minProperties", 1},
          {"properties", std::move(properties)},
          {"additionalProperties", std::move(others)}};
}

// What a case sets: variables, and STAGE.PARAM; in a sweep also as a list of values.
Json settings_schema(const std::vector<StageInfo>& stages, bool sweep) {
  const auto listed = [sweep](Json one) {
    if (!sweep) return one;
    Json many{{"type", "array"}, {"minItems", 1}, {"items", one}};
    return any_of({std::move(one), std::move(many)});
  };
  Json names = Json::object();
  for (const auto& stage : stages) {
    for (const auto& param : stage.params)
      names[stage.name + "." + param.name] =
          listed(reference(fmt::format("{}/properties/{}", stage.name, param.name)));
  }
  return {{"type", "object"},
          {"properties", std::move(names)},
          {"patternProperties", {{"^[^.]+$", listed(reference("plain"))}}},
          {"additionalProperties", false}};
}

Json definitions_of(const std::vector<StageInfo>& stages) {
  Json all{{"variable", {{"type", "string"}, {"pattern", R"(\$\{)"}}},
           {"plain", {{"type", Json::array({"string", "number", "boolean"})}}},
           {"case", settings_schema(stages, false)},
           {"sweep", settings_schema(stages, true)}};
  for (const auto& stage : stages) all[stage.name] = stage_schema(stage);
  return all;
}

}  // namespace

Json spec_schema(const std::vector<StageInfo>& stages) {
  Json references = Json::object();
  for (const auto& stage : stages) references[stage.name] = reference(stage.name);
  const Json value = any_of({reference("plain"), {{"type", "null"}}});
  const Json table{{"type", "string"}, {"description", "a table of cases (.csv) beside the spec"}};
  const Json one_case = any_of({reference("case"), {{"type", "null"}}});
  const Json sweeps{{"type", "array"}, {"minItems", 1}, {"items", reference("sweep")}};
  const Json files{{"type", "array"}, {"items", {{"type", "string"}}}};
  Json properties{
      {"viscera", {{"const", 1}}},
      {"include", any_of({{{"type", "string"}}, files})},
      {"vars", {{"type", Json::array({"object", "null"})}, {"additionalProperties", value}}},
      {"stages", map_of(references, false)},
      {"cases", any_of({table, map_of(Json::object(), one_case)})},
      {"sweep", any_of({reference("sweep"), sweeps})},
      {"rounds", {{"type", "integer"}, {"minimum", 1}}},
      {"adapt", {{"type", "object"}}},
      {"gather", map_of(references, false)}};
  return {{"$schema", "http://json-schema.org/draft-07/schema#"},
          {"title", "A run of viscera"},
          {"type", "object"},
          {"required", Json::array({"viscera"})},
          {"anyOf", Json::array({{{"required", Json::array({"stages"})}},
                                 {{"required", Json::array({"include"})}}})},
          {"properties", std::move(properties)},
          {"additionalProperties", false},
          {"definitions", definitions_of(stages)}};
}

}  // namespace viscera
