#include "stages/simulate/rest.hpp"

#include <algorithm>

namespace viscera {

const char* name_of(RestCondition condition) {
  switch (condition) {
    case RestCondition::loads:
      return "loads";
    case RestCondition::tets:
      return "inverted tets";
    case RestCondition::speed:
      return "speed";
    case RestCondition::residual:
      return "residual";
  }
  return "";
}

void RestCourse::note(RestCondition condition, bool holds, double time_s) {
  double& since = since_s[static_cast<int>(condition)];
  if (!holds) since = -1.0;
  if (holds && since < 0.0) since = time_s;
}

double RestCourse::since() const {
  return std::ranges::min(since_s) < 0.0 ? -1.0 : std::ranges::max(since_s);
}

RestCondition RestCourse::last() const {
  return static_cast<RestCondition>(std::ranges::max_element(since_s) - since_s.begin());
}

std::vector<std::string> RestCourse::missing() const {
  std::vector<std::string> names;
  for (int k = 0; k < rest_conditions; ++k) {
    const auto condition = static_cast<RestCondition>(k);
    if (!holds(condition)) names.emplace_back(name_of(condition));
  }
  return names;
}

}  // namespace viscera
