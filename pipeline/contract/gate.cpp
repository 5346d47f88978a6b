#include "pipeline/contract/gate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "pipeline/base/json_value.hpp"

namespace viscera {
namespace {

// In the manifest, and in a message.
constexpr std::size_t kept_places = 100, shown_places = 3;

std::string quantity_text(double value, const std::string& unit) {
  if (std::isnan(value)) return "none";
  return unit == "1" ? fmt::format("{:.6g}", value) : fmt::format("{:.6g} {}", value, unit);
}

std::string where_text(const Gate& gate) {
  std::string text = gate.where;
  const std::size_t shown = std::min(shown_places, gate.at.size());
  for (std::size_t i = 0; i < shown; ++i) {
    const auto& [x, y, z] = gate.at[i];
    const char* joint = i > 0 ? ", " : text.empty() ? "at " : "; at ";
    text += fmt::format("{}({:.1f}, {:.1f}, {:.1f}) mm", joint, x, y, z);
  }
  if (gate.at.size() > shown) text += fmt::format(" and {} more", gate.at.size() - shown);
  return text;
}

}  // namespace

GateInfo::GateInfo(std::string name_, std::string comparison_, std::string unit_,
                   std::string meaning_, std::string remedy_)
    : name(std::move(name_)),
      comparison(std::move(comparison_)),
      unit(std::move(unit_)),
      meaning(std::move(meaning_)),
      remedy(std::move(remedy_)) {
  const bool complete = !name.empty() && !unit.empty() && !meaning.empty() && !remedy.empty();
  if (complete && (comparison == ">=" || comparison == "<=")) return;
  throw std::invalid_argument(fmt::format(
      "gate '{}': name, comparison (>= or <=), unit, meaning and remedy must be given", name));
}

Json to_json(const GateInfo& info) {
  return {{"name", info.name},
          {"comparison", info.comparison},
          {"unit", info.unit},
          {"meaning", info.meaning},
          {"remedy", info.remedy}};
}

Gate judged(const GateInfo& info, double value, double limit, GateDetails details) {
  if (details.at.size() > kept_places) details.at.resize(kept_places);
  return {.name = details.of.empty() ? info.name : details.of + "." + info.name,
          .value = value,
          .comparison = info.comparison,
          .limit = limit,
          .unit = info.unit,
          .meaning = info.meaning,
          .remedy = details.remedy.empty() ? info.remedy : std::move(details.remedy),
          .where = std::move(details.where),
          .at = std::move(details.at)};
}

bool is_declared(const Gate& gate, const std::vector<GateInfo>& declared) {
  return std::ranges::any_of(declared, [&gate](const GateInfo& info) {
    return gate.comparison == info.comparison &&
           (gate.name == info.name || gate.name.ends_with("." + info.name));
  });
}

std::string failure_message(const Gate& gate) {
  std::string text =
      fmt::format("gate {}: {}, required {} {}", gate.name, quantity_text(gate.value, gate.unit),
                  gate.comparison, quantity_text(gate.limit, gate.unit));
  const auto add = [&text](const char* head, const std::string& words) {
    if (!words.empty()) text += fmt::format("\n  {:<9}{}", head, words);
  };
  add("means:", gate.meaning);
  add("where:", where_text(gate));
  add("remedy:", gate.remedy);
  return text;
}

Json to_json(const Gate& gate) {
  Json json{{"name", gate.name},       {"value", gate.value},  {"comparison", gate.comparison},
            {"limit", gate.limit},     {"unit", gate.unit},    {"passed", gate.passed()},
            {"meaning", gate.meaning}, {"remedy", gate.remedy}};
  if (!gate.where.empty()) json["where"] = gate.where;
  if (!gate.at.empty()) json["at"] = gate.at;
  return json;
}

Gate gate_from_json(const JsonValue& json) {
  // A gate on a metric that is not finite is written as null and cannot have passed.
  const auto number = [&json](const char* member) {
    const auto value = json.find(member);
    return value ? value->number() : std::numeric_limits<double>::quiet_NaN();
  };
  const auto text = [&json](const char* member) {
    const auto value = json.find(member);
    return value ? value->text() : "";
  };
  Gate gate{.name = json["name"].text(),
            .value = number("value"),
            .comparison = json["comparison"].text(),
            .limit = number("limit"),
            .unit = json["unit"].text(),
            .meaning = text("meaning"),
            .remedy = text("remedy"),
            .where = text("where")};
  if (const auto places = json.find("at")) {
    for (const auto& place : places->items()) {
      gate.at.push_back({place[0].number(), place[1].number(), place[2].number()});
    }
  }
  return gate;
}

}  // namespace viscera
