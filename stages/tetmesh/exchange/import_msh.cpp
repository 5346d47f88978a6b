// MSH files of any version that the gmsh library reads: all linear tets, their labels the physical
// volumes, or, where a file has none, the volumes themselves.
#include <fmt/format.h>
#include <gmsh.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <set>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/param.hpp"
#include "pipeline/base/trial_read.hpp"
#include "pipeline/contract/label_name.hpp"
#include "stages/tetmesh/exchange/gmsh_session.hpp"
#include "stages/tetmesh/exchange/import.hpp"

namespace viscera {
namespace {

Error bad_msh(const std::filesystem::path& path, std::string field, std::string found,
              std::string allowed) {
  return Error(ExitCode::bad_input, {.where = path.string(),
                                     .field = std::move(field),
                                     .found = std::move(found),
                                     .allowed = std::move(allowed),
                                     .remedy = "write the mesh again, for example with gmsh"});
}

// gmsh takes a file that does not begin like a mesh for a script, and runs it: shell commands too.
void refuse_scripts(const std::filesystem::path& path) {
  std::string begin(16, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(begin.data(), static_cast<std::streamsize>(begin.size()));
  for (const char* word : {"$MeshFormat", "$Comments", "$NOD"})
    if (begin.starts_with(word)) return;
  throw bad_msh(path, "", "a file that does not begin as a mesh of gmsh does",
                "$MeshFormat, $Comments or $NOD as its first word");
}

// Node tags are any positive numbers: the points in their ascending order.
std::map<std::size_t, int> read_nodes(const std::filesystem::path& path, TetMesh& mesh) {
  std::vector<std::size_t> tags;
  std::vector<double> places, unused;
  gmsh::model::mesh::getNodes(tags, places, unused, -1, -1, false, false);
  std::map<std::size_t, std::size_t> order;
  for (std::size_t n = 0; n < tags.size(); ++n) order[tags[n]] = n;
  std::map<std::size_t, int> index;
  for (const auto& [tag, n] : order) {
    index[tag] = static_cast<int>(mesh.points.size());
    mesh.points.push_back({places[3 * n], places[3 * n + 1], places[3 * n + 2]});
    for (const double x : mesh.points.back()) {
      if (std::isfinite(x)) continue;
      throw bad_msh(path, "Nodes", fmt::format("node {} is not finite", tag),
                    "finite coordinates in mm");
    }
  }
  return index;
}

// Volume entity to label, and the labels' names.
std::map<int, int> read_groups(const std::filesystem::path& path, TetMesh& mesh,
                               std::string& labels_from) {
  gmsh::vectorpair groups, volumes;
  gmsh::model::getPhysicalGroups(groups, 3);
  gmsh::model::getEntities(volumes, 3);
  std::map<int, int> label_of;
  labels_from = groups.empty() ? "volumes" : "physical volumes";
  for (const auto& [dimension, entity] : volumes) label_of[entity] = groups.empty() ? entity : 0;
  for (const auto& [dimension, group] : groups) {
    std::vector<int> entities;
    gmsh::model::getEntitiesForPhysicalGroup(3, group, entities);
    for (const int entity : entities) label_of[entity] = group;
    std::string& name = mesh.label_names[group];
    gmsh::model::getPhysicalName(3, group, name);
    if (!name.empty()) check_label_name(name, ExitCode::bad_input, path.string(), "PhysicalNames");
  }
  return label_of;
}

struct NumberedTet {
  std::size_t tag;
  std::array<int, 4> corners;
  int label;
};

void read_volume(const std::filesystem::path& path, const std::map<std::size_t, int>& index,
                 int entity, int label, std::vector<NumberedTet>& tets) {
  std::vector<int> types;
  std::vector<std::vector<std::size_t>> elements, corners;
  gmsh::model::mesh::getElements(types, elements, corners, 3, entity);
  for (std::size_t k = 0; k < types.size(); ++k) {
    if (types[k] != gmsh_tet) {
      throw bad_msh(
          path, "Elements",
          fmt::format("{} elements of type {} in volume {}", elements[k].size(), types[k], entity),
          "linear tetrahedra only (type 4)");
    }
    for (std::size_t e = 0; e < elements[k].size(); ++e) {
      NumberedTet tet{elements[k][e], {}, label};
      for (std::size_t c = 0; c < 4; ++c) {
        const auto found = index.find(corners[k][4 * e + c]);
        if (found == index.end()) {
          throw bad_msh(path, "Elements",
                        fmt::format("element {} names node {}", tet.tag, corners[k][4 * e + c]),
                        "nodes of the file");
        }
        tet.corners[c] = found->second;
      }
      tets.push_back(tet);
    }
  }
}

std::size_t count_cells_without_volume() {
  std::size_t count = 0;
  for (int dimension = 0; dimension < 3; ++dimension) {
    std::vector<int> types;
    std::vector<std::vector<std::size_t>> elements, corners;
    gmsh::model::mesh::getElements(types, elements, corners, dimension);
    for (const auto& list : elements) count += list.size();
  }
  return count;
}

}  // namespace

ForeignMesh current_gmsh_mesh(const std::filesystem::path& path) {
  ForeignMesh read;
  const auto index = read_nodes(path, read.mesh);
  std::vector<NumberedTet> tets;
  for (const auto& [entity, label] : read_groups(path, read.mesh, read.labels_from)) {
    const std::size_t before = tets.size();
    read_volume(path, index, entity, label, tets);
    if (tets.size() == before || (label >= 0 && label <= max_label)) continue;
    throw bad_msh(path, read.labels_from, fmt::format("number {}", label),
                  fmt::format("0 to {}", max_label));
  }
  if (tets.empty()) throw bad_msh(path, "Elements", "no tetrahedra", "at least one tetrahedron");
  std::stable_sort(tets.begin(), tets.end(),
                   [](const auto& a, const auto& b) { return a.tag < b.tag; });
  for (const auto& tet : tets) {
    read.mesh.tets.push_back(tet.corners);
    read.mesh.labels.push_back(tet.label);
  }
  auto names = std::move(read.mesh.label_names);
  read.mesh.label_names.clear();
  for (const int label : std::set<int>(read.mesh.labels.begin(), read.mesh.labels.end()))
    read.mesh.label_names[label] =
        names[label].empty() ? fmt::format("label_{}", label) : names[label];
  read.cells_skipped = count_cells_without_volume();
  return read;
}

namespace {

// Arrays as they lie in memory: both ends are one program.
template <class Element>
Json packed(const std::vector<Element>& list) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(list.data());
  return Json::binary({bytes, bytes + list.size() * sizeof(Element)});
}

template <class Element>
std::vector<Element> unpacked(const Json& json) {
  const auto& bytes = json.get_binary();
  std::vector<Element> list(bytes.size() / sizeof(Element));
  if (!list.empty()) std::memcpy(list.data(), bytes.data(), bytes.size());
  return list;
}

// What read_in_child hands over.
std::string to_bytes(const ForeignMesh& read) {
  std::string bytes;
  Json::to_cbor(Json{{"points", packed(read.mesh.points)},
                     {"tets", packed(read.mesh.tets)},
                     {"labels", packed(read.mesh.labels)},
                     {"label_names", read.mesh.label_names},
                     {"labels_from", read.labels_from},
                     {"cells_skipped", read.cells_skipped}},
                bytes);
  return bytes;
}

ForeignMesh from_bytes(const std::string& bytes) {
  const Json json = Json::from_cbor(bytes);
  ForeignMesh read;
  read.mesh.points = unpacked<std::array<double, 3>>(json["points"]);
  read.mesh.tets = unpacked<std::array<int, 4>>(json["tets"]);
  read.mesh.labels = unpacked<int>(json["labels"]);
  read.mesh.label_names = json["label_names"].get<std::map<int, std::string>>();
  read.labels_from = json["labels_from"];
  read.cells_skipped = json["cells_skipped"];
  return read;
}

}  // namespace

ForeignMesh read_foreign_msh(const std::filesystem::path& path) {
  refuse_scripts(path);
  // Of a file NAME gmsh runs NAME.opt as a script too, so it is given another name, without one.
  const TemporaryFolder alone(std::filesystem::temp_directory_path());
  const auto known_as = alone.path() / "mesh.msh";
  std::filesystem::create_symlink(std::filesystem::absolute(path), known_as);
  const auto read = [&] {
    std::string bytes;
    with_gmsh([&] {
      gmsh::merge(known_as.string());
      bytes = to_bytes(current_gmsh_mesh(path));
    });
    return bytes;
  };
  try {
    const ChildReading handed = read_in_child(path, read);
    if (!handed.broken.empty()) throw bad_msh(path, "", handed.broken, "a whole .msh file");
    return from_bytes(handed.result);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {
    throw bad_msh(path, "", e.what(), "a whole .msh file");
  }
}

}  // namespace viscera
