#include "stages/live/command.hpp"

namespace viscera::live {
namespace {

Json to_list(const Point& p) {
  return {p.x, p.y, p.z};
}

Point point_from(const JsonValue& json) {
  const auto items = json.items();
  if (items.size() != 3) throw json.refused("three numbers, mm");
  return {items[0].number(), items[1].number(), items[2].number()};
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

Command command_from_json(const JsonValue& json) {
  if (const auto vertex = json.find("grab")) return Grab{vertex->whole<int>()};
  if (const auto by = json.find("drag")) return Drag{point_from(*by)};
  if (json.find("release")) return Release{};
  if (const auto to = json.find("tool")) return MoveTool{point_from(*to)};
  if (json.find("lift")) return LiftTool{};
  if (const auto values = json.find("change")) return Change{values->object()};
  if (json.find("drop")) return Drop{};
  if (json.find("reset")) return Reset{};
  throw json.refused(
      "a command that viscera-live wrote (--log-input): grab: VERTEX, drag: [x, y, z] mm, release, "
      "tool: [x, y, z] mm, lift, change: {NAME: VALUE}, drop or reset");
}

}  // namespace viscera::live
