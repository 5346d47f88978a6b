#include "stages/common/tet_io.hpp"

#include <fmt/format.h>
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkFieldData.h>
#include <vtkFloatArray.h>
#include <vtkIdList.h>
#include <vtkIntArray.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkUnstructuredGrid.h>
#include <vtkVersion.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <vtkXMLUnstructuredGridWriter.h>

#include <cmath>
#include <limits>
#include <set>

#include "pipeline/contract/error.hpp"
#include "pipeline/contract/log.hpp"
#include "stages/common/label_names_vtk.hpp"
#include "stages/common/vtk_messages.hpp"

namespace viscera {
namespace {

Error bad_mesh(const std::filesystem::path& path, std::string field, std::string found,
               std::string allowed) {
  return Error(ExitCode::bad_input,
               {.where = path.string(),
                .field = std::move(field),
                .found = std::move(found),
                .allowed = std::move(allowed),
                .remedy = "write the mesh again, for example with viscera-tetmesh"});
}

void read_points(const std::filesystem::path& path, vtkUnstructuredGrid& grid, TetMesh& mesh) {
  const auto count = grid.GetNumberOfPoints();
  if (count > std::numeric_limits<int>::max()) {
    throw bad_mesh(path, "Points", fmt::format("{} points", count), "at most 2^31 - 1 points");
  }
  mesh.points.resize(static_cast<std::size_t>(count));
  for (vtkIdType i = 0; i < count; ++i) {
    auto& point = mesh.points[i];
    grid.GetPoint(i, point.data());
    if (!std::isfinite(point[0]) || !std::isfinite(point[1]) || !std::isfinite(point[2])) {
      throw bad_mesh(path, "Points", fmt::format("point {} is not finite", i),
                     "finite coordinates in mm");
    }
  }
}

void read_tets(const std::filesystem::path& path, vtkUnstructuredGrid& grid, TetMesh& mesh) {
  const auto count = grid.GetNumberOfCells();
  if (count == 0) throw bad_mesh(path, "Cells", "no cells", "at least one tetrahedron");
  mesh.tets.resize(static_cast<std::size_t>(count));
  vtkNew<vtkIdList> ids;
  for (vtkIdType c = 0; c < count; ++c) {
    if (grid.GetCellType(c) != VTK_TETRA) {
      throw bad_mesh(path, "Cells", fmt::format("cell {} has VTK type {}", c, grid.GetCellType(c)),
                     "linear tetrahedra only (VTK type 10)");
    }
    grid.GetCellPoints(c, ids);
    for (vtkIdType k = 0; k < 4; ++k) {
      const vtkIdType id = k < ids->GetNumberOfIds() ? ids->GetId(k) : -1;
      if (id < 0 || id >= grid.GetNumberOfPoints()) {
        throw bad_mesh(path, "Cells", fmt::format("cell {} names point {}", c, id),
                       fmt::format("points 0 to {}", grid.GetNumberOfPoints() - 1));
      }
      mesh.tets[c][static_cast<std::size_t>(k)] = static_cast<int>(id);
    }
  }
}

double six_volumes(const TetMesh& mesh, const std::array<int, 4>& tet) {
  const auto& o = mesh.points[tet[0]];
  double e[3][3];
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) e[i][k] = mesh.points[tet[i + 1]][k] - o[k];
  return e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
         e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
         e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
}

// Tools differ in the winding of a tetrahedron; a flat one is nobody's convention.
void orient(const std::filesystem::path& path, TetMesh& mesh) {
  std::size_t turned = 0, flat = 0, first_flat = 0;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    auto& tet = mesh.tets[t];
    const double volume = six_volumes(mesh, tet);
    if (volume < 0.0) {
      std::swap(tet[2], tet[3]);
      ++turned;
    } else if (!(volume > 0.0)) {
      if (flat++ == 0) first_flat = t;
    }
  }
  if (flat > 0) {
    throw bad_mesh(path, "Cells", fmt::format("{} tets without volume, first {}", flat, first_flat),
                   "tets of positive volume");
  }
  if (turned > 0) log::warn("{}: turned {} tets of negative orientation", path.string(), turned);
}

void read_labels(const std::filesystem::path& path, vtkUnstructuredGrid& grid, TetMesh& mesh) {
  auto* labels = grid.GetCellData()->GetArray("label");
  if (labels == nullptr || labels->GetNumberOfComponents() != 1) {
    throw bad_mesh(path, "CellData/label", "missing, or not one number per cell",
                   "an integer cell array 'label': the material of each tet");
  }
  mesh.labels.resize(mesh.tets.size());
  std::set<int> present;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const double value = labels->GetComponent(static_cast<vtkIdType>(t), 0);
    if (!(value >= 0.0 && value <= 65535.0) || value != std::floor(value)) {
      throw bad_mesh(path, "CellData/label", fmt::format("cell {} has {}", t, value),
                     "whole numbers from 0 to 65535");
    }
    mesh.labels[t] = static_cast<int>(value);
    present.insert(mesh.labels[t]);
  }
  const auto names = label_names_from(*grid.GetFieldData());
  for (const int label : present) {
    const auto named = names.find(label);
    mesh.label_names[label] = named == names.end() ? fmt::format("label_{}", label) : named->second;
  }
}

void read_cell_data(vtkUnstructuredGrid& grid, TetMesh& mesh) {
  auto* data = grid.GetCellData();
  for (int a = 0; a < data->GetNumberOfArrays(); ++a) {
    auto* array = data->GetArray(a);
    if (array == nullptr || array->GetName() == nullptr) continue;
    const std::string name = array->GetName();
    if (name == "label" || array->GetNumberOfComponents() != 1) continue;
    auto& values = mesh.cell_data[name];
    for (vtkIdType t = 0; t < array->GetNumberOfTuples(); ++t)
      values.push_back(static_cast<float>(array->GetComponent(t, 0)));
  }
}

}  // namespace

TetMesh read_vtu(const std::filesystem::path& path) {
  const VtkMessages messages;
  vtkNew<vtkXMLUnstructuredGridReader> reader;
  reader->SetFileName(path.c_str());
  const bool is_vtu = reader->CanReadFile(path.c_str()) != 0;
  if (is_vtu) reader->Update();
  vtkUnstructuredGrid* grid = is_vtu ? reader->GetOutput() : nullptr;
  if (grid == nullptr || reader->GetErrorCode() != 0 || !messages.first().empty()) {
    throw bad_mesh(
        path, "",
        messages.first().empty() ? "not readable as a VTK XML unstructured grid" : messages.first(),
        "a whole .vtu file");
  }
  TetMesh mesh;
  read_points(path, *grid, mesh);
  read_tets(path, *grid, mesh);
  orient(path, mesh);
  read_labels(path, *grid, mesh);
  read_cell_data(*grid, mesh);
  return mesh;
}

void write_vtu(const std::filesystem::path& path, const TetMesh& mesh) {
  vtkNew<vtkUnstructuredGrid> grid;
  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  points->SetNumberOfPoints(static_cast<vtkIdType>(mesh.points.size()));
  for (std::size_t i = 0; i < mesh.points.size(); ++i)
    points->SetPoint(static_cast<vtkIdType>(i), mesh.points[i].data());
  grid->SetPoints(points);
  vtkNew<vtkCellArray> cells;
  for (const auto& tet : mesh.tets) {
    const vtkIdType ids[4] = {tet[0], tet[1], tet[2], tet[3]};
    cells->InsertNextCell(4, ids);
  }
  grid->SetCells(VTK_TETRA, cells);
  vtkNew<vtkIntArray> labels;
  labels->SetName("label");
  for (const int label : mesh.labels) labels->InsertNextValue(label);
  grid->GetCellData()->SetScalars(labels);
  for (const auto& [name, values] : mesh.cell_data) {
    vtkNew<vtkFloatArray> array;
    array->SetName(name.c_str());
    for (const float value : values) array->InsertNextValue(value);
    grid->GetCellData()->AddArray(array);
  }
  label_names_to(*grid->GetFieldData(), mesh.label_names);

  const VtkMessages messages;
  vtkNew<vtkXMLUnstructuredGridWriter> writer;
  writer->SetFileName(path.c_str());
  writer->SetInputData(grid);
  writer->SetCompressorTypeToZLib();
  writer->EncodeAppendedDataOff();
  if (writer->Write() == 0 || !messages.first().empty()) {
    throw Error(ExitCode::usage,
                {.where = path.string(),
                 .found = "cannot be written: " + messages.first(),
                 .remedy = "check the folder's permissions and the space left on the disk"});
  }
}

std::string vtk_version() {
  return vtkVersion::GetVTKVersion();
}

}  // namespace viscera
