// When a run rests: every condition has held for the scene's rest.hold.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "sim/measures/balance.hpp"

namespace viscera {

enum class RestCondition {
  loads,     // no effect changes by itself any more, and the schedule has come to its end
  tets,      // none is inverted
  speed,     // no vertex is as fast as rest.speed
  residual,  // the force that equilibrium lacks is at most rest.residual of the loads
};
inline constexpr int rest_conditions = 4;

const char* name_of(RestCondition condition);

// Which of them hold.
struct RestCourse {
  std::array<double, rest_conditions> since_s = {-1.0, -1.0, -1.0,
                                                 -1.0};  // negative: does not hold
  std::optional<sim::Imbalance> imbalance;  // of the last frame, where it was asked for

  // Whether a condition holds in the frame at this time.
  void note(RestCondition condition, bool holds, double time_s);
  bool holds(RestCondition condition) const { return since_of(condition) >= 0.0; }
  double since_of(RestCondition condition) const { return since_s[static_cast<int>(condition)]; }
  // Since when all hold; negative: they do not.
  double since() const;
  // The one that came last, of several in the same frame the first.
  RestCondition last() const;
  // Names of those that do not hold.
  std::vector<std::string> missing() const;
};

}  // namespace viscera
