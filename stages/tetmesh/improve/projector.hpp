// What holds a vertex on its surface while it is moved. LPS mm.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "stages/mesh/vec.hpp"

namespace viscera {

// A place on every interface that was asked for, and the unit normals there: one on a surface, two
// on a curve where three materials meet, three where a point cannot move.
struct Contact {
  Vec point;
  std::vector<Vec> normals;
};

// The place near `point` where all these labels meet (ascending, 0 is outside the body; at least
// two of them), or nothing when there is none near or more of them than the projector handles.
using Projector = std::function<std::optional<Contact>(const Vec& point, const std::vector<int>&)>;

}  // namespace viscera
