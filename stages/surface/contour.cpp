#include "stages/surface/contour.hpp"

#include <vtkCellArray.h>
#include <vtkCellArrayIterator.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkGenericCell.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <vtkStaticCellLocator.h>

#include <cmath>

namespace viscera {
namespace {

vtkNew<vtkImageData> as_image(const Frame& frame, const Field& field) {
  vtkNew<vtkImageData> image;
  image->SetDimensions(frame.size.data());
  image->SetSpacing(frame.spacing.data());
  vtkNew<vtkFloatArray> values;
  // VTK only reads the array, though its interface asks for a pointer to change.
  values->SetArray(const_cast<float*>(field.data()), static_cast<vtkIdType>(field.size()), 1);
  image->GetPointData()->SetScalars(values);
  return image;
}

vtkNew<vtkPolyData> as_poly_data(const SurfaceMesh& surface) {
  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  for (const auto& point : surface.points) points->InsertNextPoint(point.data());
  vtkNew<vtkCellArray> triangles;
  for (const auto& t : surface.triangles) {
    const vtkIdType ids[3] = {t[0], t[1], t[2]};
    triangles->InsertNextCell(3, ids);
  }
  vtkNew<vtkPolyData> data;
  data->SetPoints(points);
  data->SetPolys(triangles);
  return data;
}

}  // namespace

SurfaceMesh contour(const Frame& frame, const Field& field, double level, int label) {
  const auto image = as_image(frame, field);
  vtkNew<vtkFlyingEdges3D> edges;
  edges->SetInputData(image);
  edges->SetValue(0, level);
  edges->ComputeNormalsOff();
  edges->ComputeGradientsOff();
  edges->ComputeScalarsOff();
  edges->Update();
  vtkPolyData& data = *edges->GetOutput();

  SurfaceMesh surface;
  for (vtkIdType i = 0; i < data.GetNumberOfPoints(); ++i) {
    std::array<double, 3> p;
    data.GetPoint(i, p.data());
    surface.points.push_back(frame.to_lps(p));
  }
  const auto walk = vtk::TakeSmartPointer(data.GetPolys()->NewIterator());
  for (walk->GoToFirstCell(); !walk->IsDoneWithTraversal(); walk->GoToNextCell()) {
    vtkIdType count = 0;
    const vtkIdType* ids = nullptr;
    walk->GetCurrentCell(count, ids);
    surface.triangles.push_back(
        {static_cast<int>(ids[0]), static_cast<int>(ids[1]), static_cast<int>(ids[2])});
  }
  surface.labels.assign(surface.triangles.size(), label);
  if (check(surface).volume < 0.0)
    for (auto& t : surface.triangles) std::swap(t[1], t[2]);
  return surface;
}

Distance distance_from_voxels(const Frame& frame, const std::vector<std::uint8_t>& mask,
                              const SurfaceMesh& surface) {
  const auto data = as_poly_data(surface);
  vtkNew<vtkStaticCellLocator> locator;
  locator->SetDataSet(data);
  locator->BuildLocator();
  vtkNew<vtkGenericCell> cell;
  Distance result;
  double sum = 0.0;
  std::size_t faces = 0;
  const std::array<std::size_t, 3> step{1, static_cast<std::size_t>(frame.size[0]),
                                        frame.index(0, 0, 1)};
  for (int k = 0; k < frame.size[2]; ++k)
    for (int j = 0; j < frame.size[1]; ++j)
      for (int i = 0; i < frame.size[0]; ++i)
        for (int a = 0; a < 3; ++a) {
          const std::array<int, 3> at{i, j, k};
          const std::size_t v = frame.index(i, j, k);
          if (at[a] + 1 == frame.size[a] || mask[v] == mask[v + step[a]]) continue;
          std::array<double, 3> p;
          for (int c = 0; c < 3; ++c) p[c] = (at[c] + (c == a ? 0.5 : 0.0)) * frame.spacing[c];
          p = frame.to_lps(p);
          double closest[3], squared = 0.0;
          vtkIdType id = 0;
          int sub = 0;
          locator->FindClosestPoint(p.data(), closest, cell, id, sub, squared);
          sum += squared;
          ++faces;
          if (std::sqrt(squared) <= result.max) continue;
          result.max = std::sqrt(squared);
          result.place = p;
        }
  result.rms = faces > 0 ? std::sqrt(sum / static_cast<double>(faces)) : 0.0;
  return result;
}

}  // namespace viscera
