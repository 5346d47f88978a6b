#include "stages/mesh/surface_io.hpp"

#include <fmt/format.h>
#include <vtkCellArray.h>
#include <vtkCellArrayIterator.h>
#include <vtkCellData.h>
#include <vtkFieldData.h>
#include <vtkIntArray.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkXMLPolyDataReader.h>
#include <vtkXMLPolyDataWriter.h>

#include <cmath>

#include "pipeline/base/error.hpp"
#include "stages/mesh/label_names_vtk.hpp"
#include "stages/mesh/vtk_messages.hpp"
#include "stages/mesh/vtk_xml.hpp"

namespace viscera {
namespace {

Error bad_surface(const std::filesystem::path& path, std::string field, std::string found,
                  std::string allowed) {
  return Error(ExitCode::bad_input,
               {.where = path.string(),
                .field = std::move(field),
                .found = std::move(found),
                .allowed = std::move(allowed),
                .remedy = "write the surface again, for example with viscera-surface"});
}

void read_triangles(const std::filesystem::path& path, vtkPolyData& data, SurfaceMesh& surface) {
  if (data.GetNumberOfPolys() == 0 || data.GetNumberOfStrips() > 0 || data.GetNumberOfLines() > 0 ||
      data.GetNumberOfVerts() > 0) {
    throw bad_surface(path, "Polys", "no triangles, or lines, strips or vertices among them",
                      "triangles only");
  }
  auto* labels = data.GetCellData()->GetArray("label");
  const auto walk = vtk::TakeSmartPointer(data.GetPolys()->NewIterator());
  for (walk->GoToFirstCell(); !walk->IsDoneWithTraversal(); walk->GoToNextCell()) {
    vtkIdType count = 0;
    const vtkIdType* corners = nullptr;
    walk->GetCurrentCell(count, corners);
    std::array<int, 3> triangle{};
    for (vtkIdType c = 0; c < 3; ++c) {
      if (count != 3 || corners[c] < 0 || corners[c] >= data.GetNumberOfPoints()) {
        throw bad_surface(path, "Polys",
                          fmt::format("polygon {} has {} corners, or one that is no point",
                                      walk->GetCurrentCellId(), count),
                          "triangles only");
      }
      triangle[static_cast<std::size_t>(c)] = static_cast<int>(corners[c]);
    }
    const double label =
        labels == nullptr ? 1.0 : labels->GetComponent(walk->GetCurrentCellId(), 0);
    if (!(label >= 0.0 && label <= 65535.0) || label != std::floor(label)) {
      throw bad_surface(path, "CellData/label",
                        fmt::format("triangle {} has {}", walk->GetCurrentCellId(), label),
                        "whole numbers, 0 to 65535");
    }
    surface.triangles.push_back(triangle);
    surface.labels.push_back(static_cast<int>(label));
  }
}

}  // namespace

SurfaceMesh read_vtp(const std::filesystem::path& path) {
  const auto read = read_vtk_xml<vtkPolyData, vtkXMLPolyDataReader, vtkXMLPolyDataWriter>(
      path, "VTK XML poly data");
  if (!read.data) throw bad_surface(path, read.field, read.found, "a whole .vtp file");
  vtkPolyData& data = *read.data;
  SurfaceMesh surface;
  surface.points.resize(static_cast<std::size_t>(data.GetNumberOfPoints()));
  for (vtkIdType i = 0; i < data.GetNumberOfPoints(); ++i) {
    auto& point = surface.points[i];
    data.GetPoint(i, point.data());
    if (!std::isfinite(point[0]) || !std::isfinite(point[1]) || !std::isfinite(point[2])) {
      throw bad_surface(path, "Points", fmt::format("point {} is not finite", i),
                        "finite coordinates in mm");
    }
  }
  read_triangles(path, data, surface);
  const auto names = label_names_from(path, *data.GetFieldData());
  for (const int label : surface.labels) {
    const auto named = names.find(label);
    surface.label_names.emplace(
        label, named == names.end() ? fmt::format("label_{}", label) : named->second);
  }
  return surface;
}

void write_vtp(const std::filesystem::path& path, const SurfaceMesh& surface) {
  vtkNew<vtkPolyData> data;
  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  points->SetNumberOfPoints(static_cast<vtkIdType>(surface.points.size()));
  for (std::size_t i = 0; i < surface.points.size(); ++i)
    points->SetPoint(static_cast<vtkIdType>(i), surface.points[i].data());
  data->SetPoints(points);
  vtkNew<vtkCellArray> triangles;
  for (const auto& t : surface.triangles) {
    const vtkIdType ids[3] = {t[0], t[1], t[2]};
    triangles->InsertNextCell(3, ids);
  }
  data->SetPolys(triangles);
  vtkNew<vtkIntArray> labels;
  labels->SetName("label");
  for (const int label : surface.labels) labels->InsertNextValue(label);
  data->GetCellData()->SetScalars(labels);
  label_names_to(*data->GetFieldData(), surface.label_names);

  const VtkMessages messages;
  vtkNew<vtkXMLPolyDataWriter> writer;
  writer->SetFileName(path.c_str());
  writer->SetInputData(data);
  writer->SetCompressorTypeToZLib();
  writer->EncodeAppendedDataOff();
  if (writer->Write() == 0 || !messages.first().empty()) {
    throw Error(ExitCode::usage,
                {.where = path.string(),
                 .found = "cannot be written: " + write_problem(*writer, messages),
                 .remedy = "check the folder's permissions and the space left on the disk"});
  }
}

}  // namespace viscera
