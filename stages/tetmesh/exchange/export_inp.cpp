// Abaqus input, as CalculiX reads it: nodes, C3D4 tets in one element set per label, and for every
// patch a node set and an element-face surface. Units mm, N, t, s, hence MPa and t/mm3. A label
// whose material was not given gets a section and a comment in place of the constants, so that a
// solver stops there instead of computing with invented ones.
#include <set>

#include "pipeline/base/atomic_file.hpp"
#include "stages/mesh/export_text.hpp"
#include "stages/tetmesh/exchange/export.hpp"

namespace viscera {
namespace {

using namespace export_text;

constexpr std::size_t ids_a_line = 12;

void put_inp_materials(Buffer& text, const TetExport& body,
                       const std::map<int, std::string>& names) {
  for (const auto& [label, name] : names) {
    put(text, "*MATERIAL, NAME={}\n", name);
    const auto known = body.materials.find(label);
    if (known == body.materials.end()) {
      put(text, "** no constants were given for {}: add *ELASTIC and *DENSITY here\n", name);
    } else {
      const Elastic& m = known->second;
      put(text, "*ELASTIC\n{:.9g}, {:.9g}\n*DENSITY\n{:.9g}\n", m.youngs_modulus * mpa_per_pa,
          m.poisson_ratio, m.density * t_mm3_per_kg_m3);
    }
    put(text, "*SOLID SECTION, ELSET={0}, MATERIAL={0}\n", name);
  }
}

void put_patch(Buffer& text, const Patch& patch, const std::string& name) {
  std::set<int> nodes;
  for (const auto& facet : patch.facets) nodes.insert(facet.corners.begin(), facet.corners.end());
  put(text, "*NSET, NSET=N_{}\n", name);
  std::size_t written = 0;
  for (const int node : nodes) {
    ++written;
    const bool last = written == nodes.size();
    put(text, "{}{}", node + 1, last || written % ids_a_line == 0 ? "\n" : ", ");
  }
  put(text, "*SURFACE, NAME={}, TYPE=ELEMENT\n", name);
  for (const auto& facet : patch.facets)
    put(text, "{}, S{}\n", facet.tet + 1, face_without[facet.opposite]);
}

}  // namespace

void write_inp(const std::filesystem::path& path, const TetExport& body) {
  const TetMesh& mesh = body.mesh;
  std::map<int, std::string> patch_names;
  for (std::size_t p = 0; p < body.patches.size(); ++p)
    patch_names[static_cast<int>(p)] = body.patches[p].name;
  patch_names = identifiers(patch_names);
  const auto names = identifiers(body.names);
  Buffer text;
  put(text,
      "** viscera tetrahedral mesh: LPS mm. Units mm, N, t, s: stress in MPa, density in t/mm3.\n"
      "** An element set per label; per patch a node set N_NAME and a surface NAME.\n*NODE\n");
  for (std::size_t p = 0; p < mesh.points.size(); ++p) {
    const auto& x = mesh.points[p];
    put(text, "{}, {:.12g}, {:.12g}, {:.12g}\n", p + 1, x[0], x[1], x[2]);
  }
  for (const auto& [label, name] : names) {
    put(text, "*ELEMENT, TYPE=C3D4, ELSET={}\n", name);
    for (const int t : body.tets_of(label)) {
      const auto& tet = mesh.tets[t];
      put(text, "{}, {}, {}, {}, {}\n", t + 1, tet[0] + 1, tet[1] + 1, tet[2] + 1, tet[3] + 1);
    }
  }
  for (std::size_t p = 0; p < body.patches.size(); ++p)
    put_patch(text, body.patches[p], patch_names.at(static_cast<int>(p)));
  put_inp_materials(text, body, names);
  write_atomically(path, {text.data(), text.size()});
}

}  // namespace viscera
