// FEBio 4 model: nodes, one tet4 domain and one neo-Hookean material per label, tri3 surfaces per
// patch. Units mm, N, t, s, hence MPa and t/mm3. A label whose material was not given gets one
// without E and v, which FEBio refuses, instead of invented constants.
#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/markup.hpp"
#include "stages/mesh/export_text.hpp"
#include "stages/tetmesh/exchange/export.hpp"

namespace viscera {
namespace {

using namespace export_text;

void put_feb_materials(Buffer& text, const TetExport& body,
                       const std::map<int, std::string>& names) {
  put(text, "  <Material>\n");
  int id = 0;
  for (const auto& [label, name] : names) {
    put(text, "    <material id=\"{}\" name=\"{}\" type=\"neo-Hookean\">\n", ++id, name);
    const auto known = body.materials.find(label);
    if (known == body.materials.end()) {
      put(text, "      <!-- not given: density, E, v -->\n");
    } else {
      const Elastic& m = known->second;
      put(text, "      <density>{:.9g}</density>\n      <E>{:.9g}</E>\n      <v>{:.9g}</v>\n",
          m.density * t_mm3_per_kg_m3, m.youngs_modulus * mpa_per_pa, m.poisson_ratio);
    }
    put(text, "    </material>\n");
  }
  put(text, "  </Material>\n");
}

void put_mesh(Buffer& text, const TetExport& body, const std::map<int, std::string>& names) {
  const TetMesh& mesh = body.mesh;
  put(text, "  <Mesh>\n    <Nodes name=\"all\">\n");
  for (std::size_t p = 0; p < mesh.points.size(); ++p) {
    const auto& x = mesh.points[p];
    put(text, "      <node id=\"{}\">{:.12g},{:.12g},{:.12g}</node>\n", p + 1, x[0], x[1], x[2]);
  }
  put(text, "    </Nodes>\n");
  for (const auto& [label, name] : names) {
    put(text, "    <Elements type=\"tet4\" name=\"{}\">\n", name);
    for (const int t : body.tets_of(label)) {
      const auto& tet = mesh.tets[t];
      put(text, "      <elem id=\"{}\">{},{},{},{}</elem>\n", t + 1, tet[0] + 1, tet[1] + 1,
          tet[2] + 1, tet[3] + 1);
    }
    put(text, "    </Elements>\n");
  }
  for (const auto& patch : body.patches) {
    put(text, "    <Surface name=\"{}\">\n", escaped_markup(patch.name));
    std::size_t id = 0;
    for (const auto& facet : patch.facets) {
      const auto& c = facet.corners;
      put(text, "      <tri3 id=\"{}\">{},{},{}</tri3>\n", ++id, c[0] + 1, c[1] + 1, c[2] + 1);
    }
    put(text, "    </Surface>\n");
  }
  put(text, "  </Mesh>\n");
}

}  // namespace

void write_feb(const std::filesystem::path& path, const TetExport& body) {
  auto names = body.names;
  for (auto& [label, name] : names) name = escaped_markup(name);
  Buffer text;
  put(text,
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<!-- viscera tetrahedral mesh: LPS mm. Units mm, N, t, s: MPa and t/mm3. -->\n"
      "<febio_spec version=\"4.0\">\n  <Module type=\"solid\"/>\n");
  put_feb_materials(text, body, names);
  put_mesh(text, body, names);
  put(text, "  <MeshDomains>\n");
  for (const auto& [label, name] : names)
    put(text, "    <SolidDomain name=\"{0}\" mat=\"{0}\"/>\n", name);
  put(text, "  </MeshDomains>\n</febio_spec>\n");
  write_atomically(path, {text.data(), text.size()});
}

}  // namespace viscera
