#include "stages/tetmesh/exchange/hxt.hpp"

#include <gmsh.h>

#include "pipeline/base/error.hpp"
#include "stages/mesh/tet_topology.hpp"
#include "stages/tetmesh/exchange/export.hpp"
#include "stages/tetmesh/exchange/gmsh_session.hpp"
#include "stages/tetmesh/exchange/import.hpp"

namespace viscera {
namespace {

constexpr double hxt = 10.0;  // Mesh.Algorithm3D

// HXT tells volumes by the surfaces around them, so these must differ: every connected part of a
// label is a volume of its own, and every connected sheet of a patch a surface.
std::vector<Patch> connected_sheets(const std::vector<Patch>& patches) {
  std::vector<Patch> sheets;
  for (const auto& patch : patches) {
    std::vector<std::array<int, 3>> triangles;
    for (const auto& facet : patch.facets) triangles.push_back(facet.corners);
    const std::size_t first = sheets.size();
    const auto sheet_of = find_sheets(triangles);
    for (std::size_t f = 0; f < sheet_of.size(); ++f) {
      const std::size_t sheet = first + static_cast<std::size_t>(sheet_of[f]);
      if (sheet == sheets.size()) sheets.push_back({patch.name, patch.inside, patch.outside, {}});
      sheets[sheet].facets.push_back(patch.facets[f]);
    }
  }
  return sheets;
}

void add_boundary(const TetExport& body) {
  add_surfaces(body);
  for (const auto& [label, name] : body.names) {
    std::vector<int> surfaces;
    for (std::size_t p = 0; p < body.patches.size(); ++p)
      if (body.patches[p].inside == label || body.patches[p].outside == label)
        surfaces.push_back(static_cast<int>(p) + 1);
    gmsh::model::geo::addSurfaceLoop(surfaces, label);
    gmsh::model::geo::addVolume({label}, label);
  }
  gmsh::model::geo::synchronize();
}

}  // namespace

TetMesh fill_with_hxt(const TetMesh& mesh) {
  TetMesh parts = mesh;
  std::map<int, int> label_of;  // of each part
  parts.labels = find_label_parts(mesh);
  for (std::size_t t = 0; t < parts.labels.size(); ++t)
    label_of.emplace(++parts.labels[t], mesh.labels[t]);
  TetExport body = prepare_export(parts, {});
  body.patches = connected_sheets(body.patches);
  TetMesh filled;
  try {
    with_gmsh([&] {
      add_boundary(body);
      gmsh::option::setNumber("Mesh.Algorithm3D", hxt);
      gmsh::option::setNumber("Mesh.MeshSizeExtendFromBoundary", 1);
      gmsh::model::mesh::generate(3);
      filled = current_gmsh_mesh("gmsh HXT").mesh;
    });
  } catch (const std::exception& e) {
    throw Error(ExitCode::bad_input, {.where = "mesher",
                                      .found = std::string("hxt gave up: ") + e.what(),
                                      .remedy = "use mesher: cgal, or another cell size"});
  }
  for (int& part : filled.labels) part = label_of.at(part);
  filled.label_names = mesh.label_names;
  repair(filled, "gmsh HXT");
  return filled;
}

}  // namespace viscera
