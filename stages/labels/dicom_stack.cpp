#include "stages/labels/dicom_stack.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "stages/image/image_header.hpp"

namespace viscera {
namespace {

constexpr double even = 0.1;  // of the distance between planes: what rounded positions may be off
constexpr std::uint64_t max_voxels = std::uint64_t{1} << 29;

Error mixed(const DicomPlane& plane, const char* field, const DicomPlane& first) {
  return bad_image(plane.file, field, "differs from that of " + first.file.filename().string(),
                   "planes of one series", "keep one mask's files in a folder");
}

std::array<double, 3> normal_of(const DicomPlane& p) {
  const auto& o = p.orientation;
  return {o[1] * o[5] - o[2] * o[4], o[2] * o[3] - o[0] * o[5], o[0] * o[4] - o[1] * o[3]};
}

double dot(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

template <std::size_t N>
bool near(const std::array<double, N>& a, const std::array<double, N>& b, double tolerance) {
  for (std::size_t i = 0; i < N; ++i)
    if (!(std::abs(a[i] - b[i]) <= tolerance)) return false;
  return true;
}

void check_series(const std::vector<DicomPlane>& planes) {
  const DicomPlane& first = planes.front();
  int value = 0;
  for (const auto& plane : planes) {
    if (plane.series != first.series) throw mixed(plane, "SeriesInstanceUID", first);
    if (plane.size != first.size) throw mixed(plane, "Rows, Columns", first);
    if (!near(plane.spacing, first.spacing, 1e-4)) throw mixed(plane, "PixelSpacing", first);
    if (!near(plane.orientation, first.orientation, 1e-4))
      throw mixed(plane, "ImageOrientationPatient", first);
    if (plane.value != 0 && value != 0 && plane.value != value) {
      throw bad_image(plane.file, "PixelData", fmt::format("values {} and {}", value, plane.value),
                      "a mask: one value beside 0 in all planes", "give masks, not the CT");
    }
    value = std::max(value, plane.value);
  }
}

// Distance between planes: as the file says, else the smallest one between two of them.
double step_of(const std::vector<DicomPlane>& planes, const std::vector<double>& depths,
               bool gaps) {
  double step = planes.front().depth_spacing;
  if (step > 0.0 && gaps) return step;
  std::vector<double> between;
  for (std::size_t p = 1; p < depths.size(); ++p)
    if (depths[p] - depths[p - 1] > (gaps ? 1e-3 : 0.0))
      between.push_back(depths[p] - depths[p - 1]);
  if (between.empty()) {
    throw bad_image(planes.front().file, "ImagePositionPatient",
                    planes.size() == 1 ? "a single plane" : "all planes in one place",
                    "at least two planes, one above the other", "give the whole series");
  }
  const auto middle = between.begin() + static_cast<std::ptrdiff_t>(between.size() / 2);
  std::nth_element(between.begin(), middle, between.end());
  return gaps ? *std::min_element(between.begin(), between.end()) : *middle;
}

}  // namespace

DicomStack stack_planes(std::vector<DicomPlane> planes, bool gaps) {
  check_series(planes);
  const auto normal = normal_of(planes.front());
  std::stable_sort(planes.begin(), planes.end(), [&](const DicomPlane& a, const DicomPlane& b) {
    return dot(a.position, normal) < dot(b.position, normal);
  });
  const DicomPlane& first = planes.front();
  std::vector<double> depths;
  for (const auto& plane : planes) depths.push_back(dot(plane.position, normal));
  const double step = step_of(planes, depths, gaps);

  DicomStack stack;
  Frame& frame = stack.frame;
  const double reach = depths.back() - depths.front();
  const double levels = gaps ? std::round(reach / step) + 1.0 : static_cast<double>(planes.size());
  const double voxels = levels * first.size[0] * first.size[1];
  if (!(voxels <= static_cast<double>(max_voxels))) {
    throw bad_image(planes.back().file, "ImagePositionPatient",
                    fmt::format("{} planes of {:.3g} mm", levels, step),
                    fmt::format("at most {} voxels", max_voxels), "give one series a folder");
  }
  frame.size = {first.size[0], first.size[1], static_cast<int>(levels)};
  frame.spacing = {first.spacing[1], first.spacing[0],
                   levels > 1.0 ? reach / (levels - 1.0) : step};
  frame.origin = first.position;
  for (int r = 0; r < 3; ++r) {
    frame.direction[3 * r] = first.orientation[r];
    frame.direction[3 * r + 1] = first.orientation[3 + r];
    frame.direction[3 * r + 2] = normal[r];
  }
  for (std::size_t p = 0; p < planes.size(); ++p) {
    auto& plane = planes[p];
    const auto refuse = [&plane](const std::string& found, const char* allowed) {
      throw bad_image(plane.file, "ImagePositionPatient", found, allowed,
                      "give the whole series, each plane once");
    };
    const double level = gaps ? (depths[p] - depths[0]) / step : static_cast<double>(p);
    if (gaps && std::abs(level - std::round(level)) > even)
      refuse(fmt::format("{:.3g} distances above the first plane", level), "whole distances");
    if (!gaps && p > 0) {
      const double gap = (depths[p] - depths[p - 1]) / step;
      const std::string before = planes[p - 1].file.filename().string();
      if (gap < even) refuse("the place of " + before, "one plane in each place");
      if (gap > 1.0 + even || gap < 1.0 - even) {
        refuse(fmt::format("{:.3g} mm above {}, others {:.3g} mm: planes are missing", gap * step,
                           before, step),
               "planes at even distances");
      }
    }
    std::array<double, 3> aside = plane.position;
    for (int a = 0; a < 3; ++a) aside[a] -= first.position[a] + normal[a] * (depths[p] - depths[0]);
    if (std::sqrt(dot(aside, aside)) > 0.1 * std::min(first.spacing[0], first.spacing[1]))
      refuse("sheared against the first plane (a tilted gantry)", "planes above each other");
    const int k = static_cast<int>(std::lround(level));
    const auto base = static_cast<std::uint32_t>(frame.index(0, 0, k));
    auto& runs = stack.masks[plane.segment];
    for (const Run& run : plane.runs) runs.push_back({base + run.begin, run.count});
    stack.values.insert(stack.values.end(), plane.values.begin(), plane.values.end());
    std::vector<float>().swap(plane.values);  // a CT need not be held twice
  }
  return stack;
}

}  // namespace viscera
