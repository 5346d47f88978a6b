#include "stages/program/estimate.hpp"

#include <numeric>
#include <utility>

namespace viscera {
namespace {

// The members of an expectation, by their names in JSON.
constexpr std::pair<const char*, std::map<std::string, double> Expected::*> maps[] = {
    {"label_ml", &Expected::label_ml}, {"region_share", &Expected::region_share}};
constexpr std::pair<const char*, double Expected::*> numbers[] = {
    {"voxels", &Expected::voxels},
    {"voxel_faces", &Expected::voxel_faces},
    {"tets", &Expected::tets},
    {"next_tets", &Expected::next_tets},
    {"trajectory_mb", &Expected::trajectory_mb}};

Json json_of(const Expected& expected) {
  Json json{{"extent_mm", expected.extent_mm}};
  for (const auto& [name, member] : maps) json[name] = Json(expected.*member);
  for (const auto& [name, member] : numbers) json[name] = expected.*member;
  return json;
}

}  // namespace

double Expected::body_ml() const {
  return std::accumulate(label_ml.begin(), label_ml.end(), 0.0,
                         [](double sum, const auto& label) { return sum + label.second; });
}

Json to_json(const Estimate& estimate) {
  return {{"wall_s", {estimate.wall_low_s, estimate.wall_high_s}},
          {"memory_mb", estimate.memory_mb},
          {"words", estimate.words},
          {"expected", json_of(estimate.expected)}};
}

Expected expected_from(const std::string& text) {
  if (text.empty()) return {};
  Expected expected;
  const JsonText json(text, "--expect");
  for (const auto& [name, member] : maps) {
    for (const auto& [key, value] : json.root()[name].members())
      (expected.*member)[key] = value.number();
  }
  for (std::size_t axis = 0; axis < 3; ++axis)
    expected.extent_mm[axis] = json.root()["extent_mm"][axis].number();
  for (const auto& [name, member] : numbers) expected.*member = json.root()[name].number();
  return expected;
}

}  // namespace viscera
