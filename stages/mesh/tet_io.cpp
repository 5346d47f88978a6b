#include "stages/mesh/tet_io.hpp"

#include <fmt/format.h>
#include <vtkCell.h>
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkDoubleArray.h>
#include <vtkFieldData.h>
#include <vtkFloatArray.h>
#include <vtkGenericCell.h>
#include <vtkIdList.h>
#include <vtkIntArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>
#include <vtkUnstructuredGrid.h>
#include <vtkVersion.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <vtkXMLUnstructuredGridWriter.h>

#include <cmath>
#include <limits>
#include <set>
#include <string_view>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "stages/mesh/label_names_vtk.hpp"
#include "stages/mesh/vtk_messages.hpp"
#include "stages/mesh/vtk_xml.hpp"

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

// Whether cells of a type are faces, edges or points; VTK makes none of a type that it does not
// know. By the type alone: the cell itself may name points that are not there.
bool is_without_volume(int type) {
  const auto cell = vtkSmartPointer<vtkCell>::Take(vtkGenericCell::InstantiateCell(type));
  return cell && cell->GetCellDimension() < 3;
}

// Cells without volume are passed over in a mesh made elsewhere; other cells are never understood.
void read_tets(const std::filesystem::path& path, vtkUnstructuredGrid& grid, bool foreign,
               TetMesh& mesh, std::vector<vtkIdType>& cells) {
  const auto count = grid.GetNumberOfCells();
  std::size_t others = 0;
  vtkIdType first_other = 0;
  for (vtkIdType c = 0; c < count; ++c) {
    if (grid.GetCellType(c) == VTK_TETRA) {
      cells.push_back(c);
    } else if (!foreign || !is_without_volume(grid.GetCellType(c))) {
      if (others++ == 0) first_other = c;
    }
  }
  if (others > 0) {
    throw bad_mesh(path, "Cells",
                   fmt::format("{} cells of other kinds, first cell {} of VTK type {}", others,
                               first_other, grid.GetCellType(first_other)),
                   "linear tetrahedra only (VTK type 10)");
  }
  if (cells.empty()) throw bad_mesh(path, "Cells", "no tetrahedra", "at least one tetrahedron");
  vtkNew<vtkIdList> ids;
  for (const vtkIdType c : cells) {
    grid.GetCellPoints(c, ids);
    if (ids->GetNumberOfIds() != 4) {
      throw bad_mesh(path, "Cells", fmt::format("cell {} has {} points", c, ids->GetNumberOfIds()),
                     "4 points a tetrahedron");
    }
    auto& tet = mesh.tets.emplace_back();
    for (vtkIdType k = 0; k < 4; ++k) {
      const vtkIdType id = ids->GetId(k);
      if (id < 0 || id >= grid.GetNumberOfPoints()) {
        throw bad_mesh(path, "Cells", fmt::format("cell {} names point {}", c, id),
                       fmt::format("points 0 to {}", grid.GetNumberOfPoints() - 1));
      }
      tet[static_cast<std::size_t>(k)] = static_cast<int>(id);
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

constexpr std::string_view region_prefix = "region ";

// Our own name comes first; the others are those of meshio and MMG.
constexpr const char* label_arrays[] = {"label", "gmsh:physical", "medit:ref", "CellEntityIds"};

void read_labels(const std::filesystem::path& path, vtkUnstructuredGrid& grid, bool foreign,
                 const std::vector<vtkIdType>& cells, ForeignMesh& read) {
  TetMesh& mesh = read.mesh;
  vtkDataArray* labels = nullptr;
  for (const char* name : label_arrays) {
    if (labels != nullptr || (!foreign && name != label_arrays[0])) continue;
    labels = grid.GetCellData()->GetArray(name);
    if (labels != nullptr) read.labels_from = name;
  }
  if (labels == nullptr && foreign) {
    mesh.labels.assign(mesh.tets.size(), 1);
  } else if (labels == nullptr || labels->GetNumberOfComponents() != 1) {
    throw bad_mesh(path, "CellData/label", "missing, or not one number per cell",
                   "an integer cell array 'label': the material of each tet");
  }
  for (std::size_t t = 0; labels != nullptr && t < cells.size(); ++t) {
    const double value = labels->GetComponent(cells[t], 0);
    if (!(value >= 0.0 && value <= 65535.0) || value != std::floor(value)) {
      throw bad_mesh(path, "CellData/" + read.labels_from,
                     fmt::format("cell {} has {}", cells[t], value), "whole numbers, 0 to 65535");
    }
    mesh.labels.push_back(static_cast<int>(value));
  }
  const auto names = label_names_from(path, *grid.GetFieldData());
  for (const int label : std::set<int>(mesh.labels.begin(), mesh.labels.end())) {
    const auto named = names.find(label);
    mesh.label_names[label] = named == names.end() ? fmt::format("label_{}", label) : named->second;
  }
}

std::vector<char> region_from(const std::filesystem::path& path, vtkUnstructuredGrid& grid,
                              vtkDataArray& array, const std::vector<vtkIdType>& cells) {
  const std::string field = std::string("CellData/") + array.GetName();
  if (array.GetNumberOfTuples() != grid.GetNumberOfCells()) {
    throw bad_mesh(path, field, fmt::format("{} numbers", array.GetNumberOfTuples()),
                   fmt::format("one for each of {} cells", grid.GetNumberOfCells()));
  }
  std::vector<char> inside;
  for (const vtkIdType c : cells) {
    const double value = array.GetComponent(c, 0);
    if (value != 0.0 && value != 1.0) {
      throw bad_mesh(path, field, fmt::format("cell {} has {}", c, value), "1 inside, 0 outside");
    }
    inside.push_back(value == 1.0);
  }
  return inside;
}

// Numbers of cells by name: `take(name, array)`.
template <class Take>
void for_each_cell_number(vtkUnstructuredGrid& grid, const Take& take) {
  auto* data = grid.GetCellData();
  for (int a = 0; a < data->GetNumberOfArrays(); ++a) {
    auto* array = data->GetArray(a);
    if (array == nullptr || array->GetName() == nullptr) continue;
    if (array->GetNumberOfComponents() == 1) take(std::string(array->GetName()), *array);
  }
}

void read_regions(const std::filesystem::path& path, vtkUnstructuredGrid& grid,
                  const std::vector<vtkIdType>& cells, TetMesh& mesh) {
  for_each_cell_number(grid, [&](const std::string& name, vtkDataArray& array) {
    if (name.starts_with(region_prefix))
      mesh.regions[name.substr(region_prefix.size())] = region_from(path, grid, array, cells);
  });
}

void read_cell_data(vtkUnstructuredGrid& grid, TetMesh& mesh) {
  for_each_cell_number(grid, [&](const std::string& name, vtkDataArray& array) {
    if (name == "label" || name.starts_with(region_prefix)) return;
    auto& values = mesh.cell_data[name];
    for (vtkIdType t = 0; t < array.GetNumberOfTuples(); ++t)
      values.push_back(static_cast<float>(array.GetComponent(t, 0)));
  });
}

void read_numbers(vtkFieldData& data, TetMesh& mesh) {
  for (int a = 0; a < data.GetNumberOfArrays(); ++a) {
    auto* array = data.GetArray(a);
    if (array == nullptr || array->GetName() == nullptr || array->GetNumberOfValues() != 1)
      continue;
    if (array->GetName() != std::string_view(label_ids))
      mesh.numbers[array->GetName()] = array->GetComponent(0, 0);
  }
}

vtkSmartPointer<vtkUnstructuredGrid> read_grid(const std::filesystem::path& path) {
  auto read =
      read_vtk_xml<vtkUnstructuredGrid, vtkXMLUnstructuredGridReader, vtkXMLUnstructuredGridWriter>(
          path, "a VTK XML unstructured grid");
  if (!read.data) throw bad_mesh(path, read.field, read.found, "a whole .vtu file");
  return read.data;
}

template <class Array, class Value>
void add_array(vtkUnstructuredGrid& grid, const std::string& name,
               const std::vector<Value>& values) {
  vtkNew<Array> array;
  array->SetName(name.c_str());
  for (const Value value : values) array->InsertNextValue(value);
  grid.GetCellData()->AddArray(array);
}

void add_field(vtkFieldData& data, const FieldArray& field) {
  const int count = static_cast<int>(field.components.size());
  vtkNew<vtkFloatArray> array;
  array->SetName(field.name.c_str());
  array->SetNumberOfComponents(count);
  for (int k = 0; k < count; ++k) {
    if (!field.components[k].empty()) array->SetComponentName(k, field.components[k].c_str());
  }
  for (const float value : field.values) array->InsertNextValue(value);
  data.AddArray(array);
}

ForeignMesh read_as_it_stands(const std::filesystem::path& path, vtkUnstructuredGrid& grid,
                              bool foreign) {
  ForeignMesh read;
  std::vector<vtkIdType> cells;
  read_points(path, grid, read.mesh);
  read_tets(path, grid, foreign, read.mesh, cells);
  read.cells_skipped = static_cast<std::size_t>(grid.GetNumberOfCells()) - cells.size();
  read_labels(path, grid, foreign, cells, read);
  read_regions(path, grid, cells, read.mesh);
  return read;
}

}  // namespace

TetMesh read_vtu(const std::filesystem::path& path) {
  const auto grid = read_grid(path);
  TetMesh mesh = read_as_it_stands(path, *grid, false).mesh;
  orient(path, mesh);
  read_cell_data(*grid, mesh);
  read_numbers(*grid->GetFieldData(), mesh);
  return mesh;
}

ForeignMesh read_foreign_vtu(const std::filesystem::path& path) {
  return read_as_it_stands(path, *read_grid(path), true);
}

void write_vtu(const std::filesystem::path& path, const TetMesh& mesh,
               const std::vector<FieldArray>& at_points, const std::vector<FieldArray>& in_tets) {
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
  for (const auto& [name, inside] : mesh.regions)
    add_array<vtkUnsignedCharArray>(*grid, std::string(region_prefix) + name, inside);
  for (const auto& [name, values] : mesh.cell_data) add_array<vtkFloatArray>(*grid, name, values);
  for (const auto& field : in_tets) add_field(*grid->GetCellData(), field);
  for (const auto& field : at_points) add_field(*grid->GetPointData(), field);
  label_names_to(*grid->GetFieldData(), mesh.label_names);
  for (const auto& [name, number] : mesh.numbers) {
    vtkNew<vtkDoubleArray> array;
    array->SetName(name.c_str());
    array->InsertNextValue(number);
    grid->GetFieldData()->AddArray(array);
  }

  const VtkMessages messages;
  vtkNew<vtkXMLUnstructuredGridWriter> writer;
  writer->SetFileName(path.c_str());
  writer->SetInputData(grid);
  writer->SetCompressorTypeToZLib();
  writer->EncodeAppendedDataOff();
  if (writer->Write() == 0 || !messages.first().empty()) {
    throw Error(ExitCode::usage,
                {.where = path.string(),
                 .found = "cannot be written: " + write_problem(*writer, messages),
                 .remedy = "check the folder's permissions and the space left on the disk"});
  }
}

std::string vtk_version() {
  return vtkVersion::GetVTKVersion();
}

}  // namespace viscera
