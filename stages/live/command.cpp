#include "stages/live/command.hpp"

#include "pipeline/contract/error.hpp"

namespace viscera::live {
namespace {

Json to_list(const Point& p) {
  return {p.x, p.y, p.z};
}

Point point_from(const Json& json) {
  const auto numbers = json.get<std::array<double, 3>>();
  return {numbers[0], numbers[1], numbers[2]};
}

struct ToJson {
  Json operator()(const Grab& c) const { return {{"grab", c.vertex}}; }
  Json operator()(const Drag& c) const { return {{"drag", to_list(c.by_mm)}}; }
  Json operator()(const Release&) const { return {{"release", true}}; }
  Json operator()(const MoveTool& c) const { return {{"tool", to_list(c.to_mm)}}; }
  Json operator()(const LiftTool&) const { return {{"lift", true}}; }
  Json operator()(const Change& c) const { return {{"change", c.values}}; }
  Json operator()(const Drop&) const { return {{"drop", true}}; }
  Json operator()(const Reset&) const { return {{"reset", true}}; }
};

}  // namespace

Json to_json(const Command& command) {
  return std::visit(ToJson{}, command);
}

Command command_from_json(const Json& json, const std::string& where) {
  try {
    if (json.contains("grab")) return Grab{json["grab"].get<int>()};
    if (json.contains("drag")) return Drag{point_from(json["drag"])};
    if (json.contains("release")) return Release{};
    if (json.contains("tool")) return MoveTool{point_from(json["tool"])};
    if (json.contains("lift")) return LiftTool{};
    if (json.contains("change") && json["change"].is_object()) return Change{json["change"]};
    if (json.contains("drop")) return Drop{};
    if (json.contains("reset")) return Reset{};
  } catch (const Json::exception&) {
    // Said below.
  }
  throw Error(ExitCode::bad_input,
              {.where = where,
               .field = "command",
               .found = json.dump(),
               .allowed = "grab: VERTEX, drag: [x, y, z] mm, release, tool: [x, y, z] mm, lift, "
                          "change: {NAME: VALUE}, drop or reset",
               .remedy = "take a file that viscera-live wrote (--log-input)"});
}

}  // namespace viscera::live
