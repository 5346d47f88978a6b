// What a user asks of a running simulation, between two of its frames, and as a line of JSON:
//
//   {"frame": 12, "grab": 341}                       take hold of the flesh around a vertex
//   {"frame": 13, "drag": [0, 5, 12.5]}              lead it so far from where it was grabbed, mm
//   {"frame": 20, "release": true}
//   {"frame": 21, "tool": [10, -40, 180]}            the ball's centre, mm, reached within a frame
//   {"frame": 30, "lift": true}                      takes the ball away
//   {"frame": 31, "change": {"materials.liver.E": "7 kPa"}}   values of the scene, by their names
//   {"frame": 40, "drop": true}                      from the start, with the values as they are
//   {"frame": 50, "reset": true}                     from the start, with the scene's own values
//
// `frame` counts the frames simulated before it. Positions are LPS.
#pragma once

#include <variant>

#include "pipeline/base/json_value.hpp"
#include "sim/base/math.hpp"

namespace viscera::live {

using Point = sim::Vec3<double>;

struct Grab {
  int vertex;
};
struct Drag {
  Point by_mm;
};
struct Release {};
struct MoveTool {
  Point to_mm;
};
struct LiftTool {};
struct Change {
  Json values;
};
struct Drop {};
struct Reset {};

using Command = std::variant<Grab, Drag, Release, MoveTool, LiftTool, Change, Drop, Reset>;

Json to_json(const Command& command);

// Throws Error(bad_input).
Command command_from_json(const JsonValue& json);

}  // namespace viscera::live
