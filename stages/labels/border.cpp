#include "stages/labels/border.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <map>

#include "pipeline/base/log.hpp"

namespace viscera {
namespace {

// The side of the patient that the outward normal of a border face points at.
std::string side_name(const Frame& frame, int axis, bool high) {
  static constexpr const char* sides[3][2] = {
      {"right", "left"}, {"anterior", "posterior"}, {"inferior", "superior"}};
  int along = 0;
  for (int r = 1; r < 3; ++r) {
    if (std::abs(frame.direction[3 * r + axis]) > std::abs(frame.direction[3 * along + axis]))
      along = r;
  }
  return sides[along][(frame.direction[3 * along + axis] > 0.0) == high];
}

// The faces of one label on one side of the image.
struct Faces {
  std::size_t count = 0;
  std::array<double, 3> sum{};  // of the middles, voxel-mm
};

std::map<int, Faces> faces_on(const LabelImage& image, int axis, bool high) {
  const Frame& frame = image.frame;
  const int a = (axis + 1) % 3, b = (axis + 2) % 3;
  std::map<int, Faces> faces;
  std::array<int, 3> at{};
  at[axis] = high ? frame.size[axis] - 1 : 0;
  for (at[b] = 0; at[b] < frame.size[b]; ++at[b])
    for (at[a] = 0; at[a] < frame.size[a]; ++at[a]) {
      const int id = image.voxels[frame.index(at[0], at[1], at[2])];
      if (id == 0) continue;
      auto& [count, sum] = faces[id];
      ++count;
      for (int d = 0; d < 3; ++d) sum[d] += frame.spacing[d] * at[d];
      sum[axis] += (high ? 0.5 : -0.5) * frame.spacing[axis];
    }
  return faces;
}

// What one side of the image cuts off the whole body.
struct SideCut {
  double area_mm2 = 0.0;
  std::array<double, 3> centre{};  // LPS mm
};

std::map<std::string, SideCut> by_side(const std::vector<BorderCut>& cuts) {
  std::map<std::string, SideCut> sides;
  for (const BorderCut& cut : cuts) {
    auto& [area, centre] = sides[cut.side];
    area += cut.area_mm2;
    const double part = cut.area_mm2 / area;
    for (int d = 0; d < 3; ++d) centre[d] += part * (cut.centre[d] - centre[d]);
  }
  return sides;
}

std::string percent(double share) {
  return fmt::format("{:.{}f} %", 100.0 * share, share < 0.01 ? 2 : share < 0.1 ? 1 : 0);
}

void warn_of(const LabelImage& image, const std::vector<BorderCut>& cuts) {
  std::map<int, std::vector<std::string>> faces;
  for (const BorderCut& cut : cuts)
    faces[cut.label].push_back(fmt::format("{} {:.0f} mm2", cut.face, cut.area_mm2));
  for (const auto& [id, list] : faces) {
    log::warn("{} is cut by the border of the image: {}", image.names.at(id),
              fmt::join(list, ", "));
  }
}

}  // namespace

std::vector<BorderCut> find_border_cuts(const LabelImage& image) {
  const Frame& frame = image.frame;
  std::vector<BorderCut> cuts;
  for (int axis = 0; axis < 3; ++axis)
    for (const bool high : {false, true}) {
      const double face_mm2 = frame.spacing[(axis + 1) % 3] * frame.spacing[(axis + 2) % 3];
      const std::string side = side_name(frame, axis, high);
      for (auto& [id, faces] : faces_on(image, axis, high)) {
        for (double& x : faces.sum) x /= static_cast<double>(faces.count);
        cuts.push_back({.label = id,
                        .side = side,
                        .face = fmt::format("{} ({} = {})", side, "ijk"[axis],
                                            high ? frame.size[axis] - 1 : 0),
                        .area_mm2 = static_cast<double>(faces.count) * face_mm2,
                        .centre = frame.to_lps(faces.sum)});
      }
    }
  return cuts;
}

double surface_area(const LabelImage& body, double cut_mm2) {
  const auto& [size, spacing, origin, direction] = body.frame;
  double faces_mm2 = 0.0;
  for (int k = 0; k < size[2]; ++k)
    for (int j = 0; j < size[1]; ++j)
      for (int i = 0; i < size[0]; ++i) {
        if (body.voxels[body.frame.index(i, j, k)] == 0) continue;
        const std::array<int, 3> at{i, j, k};
        for (int axis = 0; axis < 3; ++axis)
          for (const int step : {-1, 1}) {
            auto next = at;
            next[axis] += step;
            const bool outside = next[axis] < 0 || next[axis] >= size[axis];
            if (!outside && body.voxels[body.frame.index(next[0], next[1], next[2])] != 0) continue;
            faces_mm2 += spacing[(axis + 1) % 3] * spacing[(axis + 2) % 3];
          }
      }
  return (faces_mm2 - cut_mm2) / 1.5 + cut_mm2;
}

GateInfo border_gate() {
  return {
      "border_area", "<=", "mm2",
      "The border of the image cuts the body: volume and mass lack what lies beyond it, and the "
      "cut is a surface that the body does not have.",
      "take an image that holds the whole body, or accept the cut as a flat cap with "
      "labels.border: accept, which the report then says in its first line"};
}

Param border_param() {
  return {.name = "border",
          .type = ParamType::text,
          .fallback = "refuse",
          .choices = {"refuse", "accept"},
          .doc =
              "a body that the border of the image cuts: refuse fails the gate border_area, "
              "accept takes the cut as a flat cap, of which the report's first line tells"};
}

void judge_border(StageRun& run, const LabelImage& body, const std::vector<BorderCut>& cuts) {
  warn_of(body, cuts);
  const auto sides = by_side(cuts);
  double cut_mm2 = 0.0;
  for (const auto& [side, cut] : sides) cut_mm2 += cut.area_mm2;
  const double body_mm2 = surface_area(body, cut_mm2);
  GateDetails details;
  std::vector<std::string> places, shares;
  Json list = Json::array();
  for (const auto& [side, cut] : sides) {
    const double share = cut.area_mm2 / body_mm2;
    places.push_back(
        fmt::format("{} side of the image, {} of the body's surface", side, percent(share)));
    shares.push_back(fmt::format("{} side ({} of its surface)", side, percent(share)));
    details.at.push_back(cut.centre);
    list.push_back(
        {{"side", side}, {"area_mm2", cut.area_mm2}, {"share", share}, {"at", cut.centre}});
  }
  details.where = fmt::format("{}", fmt::join(places, "; "));
  run.metric("border_area", cut_mm2, "mm2");
  run.metric("border_cuts", list);
  const bool accepted = run.param<std::string>("border") == "accept";
  run.gate(border_gate(), cut_mm2, accepted ? cut_mm2 : 0.0, std::move(details));
  if (!accepted || sides.empty()) return;
  run.caveat(fmt::format("The body is cut by the image's border at its {}: {} not anatomy.",
                         fmt::join(shares, " and its "),
                         sides.size() == 1 ? "this plane is" : "these planes are"));
}

}  // namespace viscera
