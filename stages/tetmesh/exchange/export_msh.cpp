// MSH 4.1 (binary, exact doubles) through the gmsh library: a discrete volume and a physical group
// per label, its tag the label's id; a discrete surface and a physical group per patch.
#include <gmsh.h>

#include <algorithm>

#include "pipeline/base/error.hpp"
#include "stages/tetmesh/exchange/export.hpp"
#include "stages/tetmesh/exchange/gmsh_session.hpp"

namespace viscera {
namespace {

using Tags = std::vector<std::size_t>;

std::string without_quotes(std::string name) {
  std::replace(name.begin(), name.end(), '"', '\'');
  return name;
}

// The nodes that no entity before has taken become this entity's own.
void add_nodes(const TetMesh& mesh, int dimension, int entity, const Tags& elements,
               std::vector<bool>& taken) {
  Tags tags;
  std::vector<double> places;
  for (const std::size_t tag : elements) {
    if (taken[tag - 1]) continue;
    taken[tag - 1] = true;
    tags.push_back(tag);
  }
  std::sort(tags.begin(), tags.end());
  for (const std::size_t tag : tags)
    places.insert(places.end(), mesh.points[tag - 1].begin(), mesh.points[tag - 1].end());
  if (!tags.empty()) gmsh::model::mesh::addNodes(dimension, entity, tags, places);
}

// The patches with their nodes; the nodes inside the volumes are left to be taken.
void put_surfaces(const TetExport& body, std::vector<bool>& taken) {
  std::size_t element = body.mesh.tets.size();
  for (std::size_t p = 0; p < body.patches.size(); ++p) {
    const int entity = static_cast<int>(p) + 1;
    Tags elements, corners;
    for (const auto& facet : body.patches[p].facets) {
      elements.push_back(++element);
      for (const int c : facet.corners) corners.push_back(static_cast<std::size_t>(c) + 1);
    }
    gmsh::model::addDiscreteEntity(2, entity);
    add_nodes(body.mesh, 2, entity, corners, taken);
    gmsh::model::mesh::addElementsByType(entity, gmsh_triangle, elements, corners);
    gmsh::model::addPhysicalGroup(2, {entity}, entity);
    gmsh::model::setPhysicalName(2, entity, without_quotes(body.patches[p].name));
  }
}

void add_volumes(const TetExport& body, std::vector<bool>& taken) {
  for (const auto& [label, name] : body.names) {
    std::vector<int> bounds;
    for (std::size_t p = 0; p < body.patches.size(); ++p)
      if (body.patches[p].inside == label || body.patches[p].outside == label)
        bounds.push_back(static_cast<int>(p) + 1);
    Tags elements, corners;
    for (const int t : body.tets_of(label)) {
      elements.push_back(static_cast<std::size_t>(t) + 1);
      for (const int c : body.mesh.tets[t]) corners.push_back(static_cast<std::size_t>(c) + 1);
    }
    gmsh::model::addDiscreteEntity(3, label, bounds);
    add_nodes(body.mesh, 3, label, corners, taken);
    gmsh::model::mesh::addElementsByType(label, gmsh_tet, elements, corners);
    gmsh::model::addPhysicalGroup(3, {label}, label);
    gmsh::model::setPhysicalName(3, label, without_quotes(name));
  }
}

}  // namespace

void add_surfaces(const TetExport& body) {
  std::vector<bool> taken(body.mesh.points.size());
  put_surfaces(body, taken);
}

void write_msh(const std::filesystem::path& path, const TetExport& body) {
  with_gmsh([&] {
    std::vector<bool> taken(body.mesh.points.size());
    put_surfaces(body, taken);
    add_volumes(body, taken);
    gmsh::option::setNumber("Mesh.MshFileVersion", 4.1);
    gmsh::option::setNumber("Mesh.Binary", 1);
    gmsh::write(path.string());
  });
}

}  // namespace viscera
