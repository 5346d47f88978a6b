#include "stages/tetmesh/exchange/export.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "pipeline/base/error.hpp"
#include "sim/base/tet_face.hpp"
#include "stages/mesh/export_text.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/mesh/tet_topology.hpp"

namespace viscera {
namespace {

std::string name_of(const TetMesh& mesh, int label) {
  const auto found = mesh.label_names.find(label);
  return found == mesh.label_names.end() ? fmt::format("label_{}", label) : found->second;
}

}  // namespace

std::vector<Patch> find_patches(const TetMesh& mesh) {
  std::map<std::array<int, 2>, Patch> patches;
  for_each_face(mesh, [&](const Face& face) {
    const int first = mesh.labels[face.tets[0]];
    const int second = face.tets[1] < 0 ? 0 : mesh.labels[face.tets[1]];
    if (first == second) return;
    const int side = face.tets[1] < 0 || first < second ? 0 : 1;
    const std::array<int, 2> labels{side == 0 ? first : second, side == 0 ? second : first};
    Patch& patch = patches[labels];
    if (patch.facets.empty()) {
      patch.inside = labels[0];
      patch.outside = labels[1];
      patch.name = labels[1] == 0 ? "surface_" + name_of(mesh, labels[0])
                                  : fmt::format("interface_{}_{}", name_of(mesh, labels[0]),
                                                name_of(mesh, labels[1]));
    }
    const int tet = face.tets[side], opposite = face.opposite[side];
    patch.facets.push_back({tet, opposite, sim::face_of_tet(mesh.tets[tet], opposite)});
  });
  std::vector<Patch> list;
  for (auto& [labels, patch] : patches) list.push_back(std::move(patch));
  return list;
}

TetExport prepare_export(const TetMesh& mesh, std::map<int, Elastic> materials) {
  TetExport body{.mesh = mesh, .patches = find_patches(mesh), .materials = std::move(materials)};
  for (const int label : std::set<int>(mesh.labels.begin(), mesh.labels.end()))
    body.names[label] = name_of(mesh, label);
  return body;
}

std::vector<int> TetExport::tets_of(int label) const {
  std::vector<int> tets;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    if (mesh.labels[t] == label) tets.push_back(static_cast<int>(t));
  return tets;
}

const std::vector<TetFormat>& tet_formats() {
  static const std::vector<TetFormat> table{
      {"vtu", "mesh.vtu", "tets, cell array label, quality per tet, LPS mm",
       [](const std::filesystem::path& path, const TetExport& body) {
         write_vtu(path, body.mesh);
       }},
      {"msh", "mesh.msh", "Gmsh 4.1: a physical volume per label, a physical surface per patch",
       write_msh},
      {"inp", "mesh.inp", "Abaqus and CalculiX: C3D4, a set and section per label, mm-N-t-s",
       write_inp},
      {"feb", "mesh.feb", "FEBio 4: a domain and neo-Hookean material per label, mm-N-t-s",
       write_feb}};
  return table;
}

std::vector<TetFormat> chosen_formats(const Json& formats) {
  Json asked = formats;
  asked.push_back(tet_formats().front().name);
  return export_text::asked_formats(asked, tet_formats());
}

std::map<int, Elastic> read_materials(const Json& given, const std::map<int, std::string>& names) {
  std::map<int, Elastic> materials;
  for (const auto& [name, values] : given.items()) {
    const auto label = std::find_if(names.begin(), names.end(), [&key = name](const auto& entry) {
      return entry.second == key;
    });
    if (label == names.end()) {
      std::vector<std::string> known;
      for (const auto& [id, text] : names) known.push_back(text);
      throw Error(ExitCode::bad_config,
                  {.where = "parameters",
                   .field = "materials." + name,
                   .found = "no label of that name",
                   .allowed = "{E: 5 kPa, nu: 0.45, density: 1060 kg/m3} by label name",
                   .remedy = suggest(name, known)});
    }
    const Json m = resolve(elastic_params(), values, "parameters", "materials." + name + ".");
    for (const char* key : {"E", "nu", "density"}) {
      if (!m[key].is_null()) continue;
      throw Error(ExitCode::bad_config, {.where = "parameters",
                                         .field = fmt::format("materials.{}.{}", name, key),
                                         .found = "missing",
                                         .allowed = "E, nu and density"});
    }
    materials[label->first] = {m["E"], m["nu"], m["density"]};
  }
  return materials;
}

}  // namespace viscera
