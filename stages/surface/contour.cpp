#include "stages/surface/contour.hpp"

#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkIdTypeArray.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>

#include <algorithm>
#include <cmath>

namespace viscera {
namespace {

constexpr double beside_level = 0.004;
constexpr int rounds = 16;  // of the search for the level
constexpr double longest_step = 0.05;
constexpr double close_enough = 1e-5;  // of the volume

// Values near the level are rounded to one side of it, up or down so that what this adds to the
// volume and takes from it cancels.
Field beside(const Field& field, double level) {
  Field moved = field;
  double owed = 0.0;
  for (float& value : moved) {
    const double off = value - level;
    if (std::abs(off) >= beside_level) continue;
    const double rounded = owed + off >= 0.0 ? beside_level : -beside_level;
    owed += off - rounded;
    value = static_cast<float>(level + rounded);
  }
  return moved;
}

// Where the volume of voxels above the level is `volume`, and how fast it falls there.
struct Guess {
  double level = 0.5, slope = 1.0;  // slope: mm3 per unit of level
};

Guess guess_level(const Mask& mask, const Field& field) {
  constexpr int bins = 1024;
  std::vector<std::size_t> counts(bins + 1);
  for (const float value : field)
    ++counts[static_cast<std::size_t>(std::clamp(value, 0.0f, 1.0f) * bins)];
  std::size_t above = 0;
  int bin = bins;
  while (bin > 0 && above + counts[bin] < mask.voxels) above += counts[bin--];
  constexpr int window = bins / 50;
  std::size_t near = 0;
  for (int b = std::max(1, bin - window); b <= std::min(bins, bin + window); ++b) near += counts[b];
  const double width = static_cast<double>(2 * window + 1) / bins;
  const double slope = static_cast<double>(near) * mask.frame.voxel_volume() / width;
  return {std::clamp((bin + 0.5) / bins, 0.02, 0.98), std::max(slope, 1e-9)};
}

MatchedSurface without_small_shells(SurfaceMesh surface, int label, double min_volume) {
  MatchedSurface result;
  const auto shells = find_shells(surface);
  double largest = 0.0;
  for (const auto& shell : shells) largest = std::max(largest, std::abs(shell.volume));
  SurfaceMesh kept{.points = surface.points};
  for (const auto& shell : shells) {
    if (std::abs(shell.volume) < std::min(min_volume, largest)) {
      ++result.dropped;
      result.dropped_volume += std::abs(shell.volume);
      result.dropped_at.push_back(shell.place);
      continue;
    }
    for (const int t : shell.triangles) kept.triangles.push_back(surface.triangles[t]);
  }
  kept.labels.assign(kept.triangles.size(), label);
  result.surface = result.dropped > 0 ? extract(kept, label) : std::move(surface);
  return result;
}

}  // namespace

SurfaceMesh contour(const Frame& frame, const Field& field, double level, int label) {
  Field moved = beside(field, level);
  vtkNew<vtkImageData> image;
  image->SetDimensions(frame.size.data());
  image->SetSpacing(frame.spacing.data());
  vtkNew<vtkFloatArray> values;
  values->SetArray(moved.data(), static_cast<vtkIdType>(moved.size()), 1);
  image->GetPointData()->SetScalars(values);
  vtkNew<vtkFlyingEdges3D> edges;
  edges->SetInputData(image);
  edges->SetValue(0, level);
  edges->ComputeNormalsOff();
  edges->ComputeGradientsOff();
  edges->ComputeScalarsOff();
  edges->Update();
  vtkPolyData& data = *edges->GetOutput();

  SurfaceMesh surface;
  surface.points.reserve(static_cast<std::size_t>(data.GetNumberOfPoints()));
  for (vtkIdType i = 0; i < data.GetNumberOfPoints(); ++i) {
    std::array<double, 3> p;
    data.GetPoint(i, p.data());
    surface.points.push_back(frame.to_lps(p));
  }
  const bool turned = frame.handedness() < 0.0;
  surface.triangles.reserve(static_cast<std::size_t>(data.GetNumberOfPolys()));
  vtkCellArray& polygons = *data.GetPolys();
  vtkIdType count = 0;
  const vtkIdType* ids = nullptr;
  for (vtkIdType t = 0; t < data.GetNumberOfPolys(); ++t) {
    polygons.GetCellAtId(t, count, ids);
    surface.triangles.push_back(
        {static_cast<int>(ids[0]), static_cast<int>(ids[1]), static_cast<int>(ids[2])});
    if (turned) std::swap(surface.triangles.back()[1], surface.triangles.back()[2]);
  }
  surface.labels.assign(surface.triangles.size(), label);
  return surface;
}

MatchedSurface match_volume(const Mask& mask, const Field& field, int label, double min_shell) {
  const double wanted = mask.volume();
  auto [level, slope] = guess_level(mask, field);
  double low = 0.0, high = 1.0;  // between these lies the level: the volume falls as it rises
  MatchedSurface best;
  double best_error = HUGE_VAL, last_level = 0.0, last_error = 0.0;
  for (int round = 0; round < rounds; ++round) {
    auto found = without_small_shells(contour(mask.frame, field, level, label), label, min_shell);
    found.level = level;
    const double error = enclosed_volume(found.surface) - wanted;
    if (std::abs(error) < std::abs(best_error)) {
      best = std::move(found);
      best_error = error;
    }
    if (std::abs(error) <= close_enough * wanted || high - low < 1e-6) break;
    (error > 0.0 ? low : high) = level;
    // The secant, unless shells that come and go make the volume jump.
    const double secant = round > 0 ? -(error - last_error) / (level - last_level) : slope;
    if (secant > 0.0) slope = secant;
    const double next = level + std::clamp(error / slope, -longest_step, longest_step);
    last_level = level;
    last_error = error;
    level = next > low && next < high ? next : 0.5 * (low + high);
  }
  return best;
}

MatchedSurface discrete(const Mask& mask, int label, double min_shell) {
  const Field field(mask.inside.begin(), mask.inside.end());
  return without_small_shells(contour(mask.frame, field, 0.5, label), label, min_shell);
}

}  // namespace viscera
