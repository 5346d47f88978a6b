// Model of FEBio 4: nodes, tet4 or tet10 domains by label, materials, supports and loads, which
// grow over ten steps. FEBio takes a body force by mass and against its direction: gravity is
// written with the other sign. What differs from node to node is a map of values.
#include <span>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/markup.hpp"
#include "sim/base/refusal.hpp"
#include "sim/base/tet_face.hpp"
#include "stages/mesh/export_text.hpp"
#include "stages/simulate/exchange/static_problem.hpp"

namespace viscera {
namespace {

using namespace export_text;
using Field = std::map<int, sim::Vec3<double>>;  // by node

constexpr const char* axes = "xyz";

double component(const sim::Vec3<double>& v, int axis) {
  return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

void put_materials(Buffer& text, const StaticProblem& problem) {
  put(text, "  <Material>\n");
  int id = 0;
  for (const auto& [label, part] : problem.labels) {
    const sim::Material& m = part.material;
    put(text,
        "    <material id=\"{}\" name=\"{}\" type=\"{}\">\n      <density>{:.9g}</density>\n"
        "      <E>{:.9g}</E>\n      <v>{:.9g}</v>\n    </material>\n",
        ++id, escaped_markup(part.name),
        problem.law == ElasticLaw::neo_hookean ? "neo-Hookean" : "isotropic elastic",
        t_mm3_per_kg_m3 * m.density, mpa_per_pa * m.youngs_modulus, m.poisson_ratio);
  }
  put(text, "  </Material>\n");
}

void put_nodes_of(Buffer& text, const char* set, const Field& field) {
  if (field.empty()) return;
  const char* before = "";
  put(text, "    <NodeSet name=\"{}\">", set);
  for (const auto& [node, value] : field) {
    put(text, "{}{}", before, node + 1);
    before = ",";
  }
  put(text, "</NodeSet>\n");
}

// The faces by their pressure, MPa: one surface each.
std::map<double, std::vector<StaticProblem::PushedFace>> surfaces_of(const StaticProblem& problem) {
  std::map<double, std::vector<StaticProblem::PushedFace>> surfaces;
  for (const auto& face : problem.pushed) surfaces[face.pressure].push_back(face);
  return surfaces;
}

// The nodes of a face: its corners and, of ten nodes, the middles of the edges between them.
std::vector<int> nodes_of(const StaticProblem& problem, const StaticProblem::PushedFace& face) {
  constexpr int middle_of[4][4] = {{0, 4, 6, 7}, {4, 0, 5, 8}, {6, 5, 0, 9}, {7, 8, 9, 0}};
  const auto& element = problem.elements[face.element];
  const auto corners = sim::face_of_tet({0, 1, 2, 3}, face.opposite);
  std::vector<int> nodes;
  for (const int c : corners) nodes.push_back(element[c]);
  for (int i = 0; problem.element_nodes == 10 && i < 3; ++i)
    nodes.push_back(element[middle_of[corners[i]][corners[(i + 1) % 3]]]);
  return nodes;
}

void put_row(Buffer& text, const char* tag, std::size_t id, std::span<const int> nodes) {
  put(text, "      <{} id=\"{}\">", tag, id);
  for (std::size_t i = 0; i < nodes.size(); ++i) put(text, "{}{}", i ? "," : "", nodes[i] + 1);
  put(text, "</{}>\n", tag);
}

void put_mesh(Buffer& text, const StaticProblem& problem) {
  put(text, "  <Mesh>\n    <Nodes name=\"all\">\n");
  for (std::size_t i = 0; i < problem.nodes.size(); ++i) {
    const auto& x = problem.nodes[i];
    put(text, "      <node id=\"{}\">{:.12g},{:.12g},{:.12g}</node>\n", i + 1, x[0], x[1], x[2]);
  }
  put(text, "    </Nodes>\n");
  const auto n = static_cast<std::size_t>(problem.element_nodes);
  for (const auto& [label, part] : problem.labels) {
    put(text, "    <Elements type=\"tet{}\" name=\"{}\">\n", n, escaped_markup(part.name));
    for (const int e : part.elements)
      put_row(text, "elem", static_cast<std::size_t>(e) + 1, {problem.elements[e].data(), n});
    put(text, "    </Elements>\n");
  }
  put_nodes_of(text, "held", problem.held);
  put_nodes_of(text, "loaded", problem.forces);
  int surface = 0;
  for (const auto& [pressure, faces] : surfaces_of(problem)) {
    put(text, "    <Surface name=\"pushed_{}\">\n", ++surface);
    std::size_t id = 0;
    for (const auto& face : faces)
      put_row(text, n == 4 ? "tri3" : "tri6", ++id, nodes_of(problem, face));
    put(text, "    </Surface>\n");
  }
  put(text, "  </Mesh>\n  <MeshDomains>\n");
  for (const auto& [label, part] : problem.labels)
    put(text, "    <SolidDomain name=\"{0}\" mat=\"{0}\"/>\n", escaped_markup(part.name));
  put(text, "  </MeshDomains>\n");
}

void put_maps(Buffer& text, const char* set, const char* map, const Field& field) {
  for (int axis = 0; axis < 3 && !field.empty(); ++axis) {
    put(text, "    <NodeData name=\"{}_{}\" node_set=\"{}\" data_type=\"scalar\">\n", map,
        axes[axis], set);
    std::size_t place = 0;
    for (const auto& [node, value] : field)
      put(text, "      <node lid=\"{}\">{:.12g}</node>\n", ++place, component(value, axis));
    put(text, "    </NodeData>\n");
  }
}

void put_supports(Buffer& text, const StaticProblem& problem) {
  put(text, "  <Boundary>\n");
  for (int axis = 0; axis < 3 && !problem.held.empty(); ++axis) {
    put(text,
        "    <bc name=\"held_{0}\" type=\"prescribed displacement\" node_set=\"held\">\n"
        "      <dof>{0}</dof>\n      <value lc=\"1\" type=\"map\">displacement_{0}</value>\n"
        "      <relative>0</relative>\n    </bc>\n",
        axes[axis]);
  }
  put(text, "  </Boundary>\n");
}

void put_loads(Buffer& text, const StaticProblem& problem) {
  put(text, "  <Loads>\n");
  for (int axis = 0; axis < 3 && !problem.forces.empty(); ++axis) {
    put(text,
        "    <nodal_load name=\"force_{0}\" type=\"nodal_load\" node_set=\"loaded\">\n"
        "      <dof>{0}</dof>\n      <scale lc=\"1\" type=\"map\">force_{0}</scale>\n"
        "      <relative>0</relative>\n    </nodal_load>\n",
        axes[axis]);
  }
  int surface = 0;
  for (const auto& [pressure, faces] : surfaces_of(problem)) {
    ++surface;
    put(text,
        "    <surface_load name=\"pressure_{0}\" type=\"pressure\" surface=\"pushed_{0}\">\n"
        "      <pressure lc=\"1\">{1:.12g}</pressure>\n      <linear>0</linear>\n"
        "      <symmetric_stiffness>1</symmetric_stiffness>\n    </surface_load>\n",
        surface, pressure);
  }
  const sim::Vec3<double>& g = problem.gravity;
  if (norm(g) > 0.0) {
    put(text,
        "    <body_load name=\"gravity\" type=\"body force\">\n"
        "      <force lc=\"1\">{:.12g},{:.12g},{:.12g}</force>\n    </body_load>\n",
        -g.x, -g.y, -g.z);
  }
  put(text,
      "  </Loads>\n  <LoadData>\n    <load_controller id=\"1\" type=\"loadcurve\">\n"
      "      <interpolate>LINEAR</interpolate>\n      <extend>CONSTANT</extend>\n"
      "      <points><pt>0,0</pt><pt>1,1</pt></points>\n    </load_controller>\n"
      "  </LoadData>\n");
}

void check(const StaticProblem& problem) {
  const auto refuse = [](const char* found, const char* remedy) {
    throw sim::Refusal(sim::Refusal::Cause::scene, "formats", found,
                       "what the file of FEBio holds of a scene", remedy);
  };
  if (!problem.beds.empty()) refuse("feb with effects.spring", "formats: [inp]");
  if (problem.law == ElasticLaw::linear)
    refuse("feb with effects.linear", "stvk, or formats: [inp]");
  if (problem.law == ElasticLaw::mooney_rivlin || problem.law == ElasticLaw::ogden)
    refuse("feb with effects.mooney_rivlin or ogden", "neo_hookean, or formats: [inp]");
}

}  // namespace

void write_scene_feb(const std::filesystem::path& path, const StaticProblem& problem) {
  check(problem);
  Buffer text;
  put(text,
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<!-- viscera: body at rest, supports and loads at the end of a scene; LPS mm. Units mm, N, "
      "t, s: MPa and t/mm3. Beyond small strains laws of the same name differ between programs. "
      "-->\n"
      "<febio_spec version=\"4.0\">\n  <Module type=\"solid\"/>\n  <Control>\n"
      "    <analysis>STATIC</analysis>\n    <time_steps>10</time_steps>\n"
      "    <step_size>0.1</step_size>\n    <solver type=\"solid\"/>\n  </Control>\n");
  put_materials(text, problem);
  put_mesh(text, problem);
  put(text, "  <MeshData>\n");
  put_maps(text, "held", "displacement", problem.held);
  put_maps(text, "loaded", "force", problem.forces);
  put(text, "  </MeshData>\n");
  put_supports(text, problem);
  put_loads(text, problem);
  put(text,
      "  <Output>\n    <plotfile type=\"febio\">\n      <var type=\"displacement\"/>\n"
      "      <var type=\"stress\"/>\n    </plotfile>\n  </Output>\n</febio_spec>\n");
  write_atomically(path, {text.data(), text.size()});
}

}  // namespace viscera
