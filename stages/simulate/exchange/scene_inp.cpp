// Input for CalculiX and Abaqus: nodes, C3D4 or C3D10 elements by label, materials, supports, and
// one static step with the loads. CalculiX's hyperelastic energies are those of J^(-1/3) F and
// (J - 1)^2 / D1. They have the tangent of ours at rest for mu = 2 (C10 + C01) = mu_1 and D1 = 2/K;
// beyond, the two part with the square of the change of volume.
#include "pipeline/base/atomic_file.hpp"
#include "stages/mesh/export_text.hpp"
#include "stages/simulate/exchange/static_problem.hpp"

namespace viscera {
namespace {

using namespace export_text;
using LabelNames = std::map<int, std::string>;

void put_elements(Buffer& text, const StaticProblem& problem, const LabelNames& names) {
  for (const auto& [label, part] : problem.labels) {
    put(text, "*ELEMENT, TYPE=C3D{}, ELSET={}\n", problem.element_nodes, names.at(label));
    for (const int e : part.elements) {
      put(text, "{}", e + 1);
      for (int i = 0; i < problem.element_nodes; ++i) put(text, ", {}", problem.elements[e][i] + 1);
      put(text, "\n");
    }
  }
}

void put_materials(Buffer& text, const StaticProblem& problem, const LabelNames& names) {
  for (const auto& [label, part] : problem.labels) {
    const sim::Material& m = part.material;
    put(text, "*MATERIAL, NAME={}\n", names.at(label));
    const double mu = mpa_per_pa * sim::lame(m).mu, shape = problem.law_shape;
    const double d1 = 6.0 * (1.0 - 2.0 * m.poisson_ratio) / (mpa_per_pa * m.youngs_modulus);
    if (problem.law == ElasticLaw::neo_hookean) {
      put(text, "*HYPERELASTIC, NEO HOOKE\n{:.9g}, {:.9g}\n", 0.5 * mu, d1);
    } else if (problem.law == ElasticLaw::mooney_rivlin) {
      put(text, "*HYPERELASTIC, MOONEY-RIVLIN\n{:.9g}, {:.9g}, {:.9g}\n", 0.5 * mu * (1.0 - shape),
          0.5 * mu * shape, d1);
    } else if (problem.law == ElasticLaw::ogden) {
      put(text, "*HYPERELASTIC, OGDEN\n{:.9g}, {:.9g}, {:.9g}\n", mu, shape, d1);
    } else {
      put(text, "*ELASTIC\n{:.9g}, {:.9g}\n", mpa_per_pa * m.youngs_modulus, m.poisson_ratio);
    }
    put(text, "*DENSITY\n{0:.9g}\n*SOLID SECTION, ELSET={1}, MATERIAL={1}\n",
        t_mm3_per_kg_m3 * m.density, names.at(label));
  }
}

// A spring to the ground for each node and axis. CalculiX takes "5e-05" there for no number: it
// wants a point.
void put_beds(Buffer& text, const StaticProblem& problem) {
  std::size_t element = problem.elements.size();
  for (const auto& [node, stiffness] : problem.beds) {
    for (int axis = 1; axis <= 3; ++axis) {
      put(text,
          "*ELEMENT, TYPE=SPRING1, ELSET=BED_{0}_{1}\n{2}, {0}\n"
          "*SPRING, ELSET=BED_{0}_{1}\n{1}\n{3:.8e}\n",
          node + 1, axis, ++element, stiffness);
    }
  }
}

void put_by_axis(Buffer& text, int node, const sim::Vec3<double>& value, bool is_displacement) {
  for (int axis = 0; axis < 3; ++axis) {
    const double own = axis == 0 ? value.x : axis == 1 ? value.y : value.z;
    if (is_displacement) {
      put(text, "{}, {}, {}, {:.12g}\n", node + 1, axis + 1, axis + 1, own);
    } else if (own != 0.0) {
      put(text, "{}, {}, {:.12g}\n", node + 1, axis + 1, own);
    }
  }
}

void put_loads(Buffer& text, const StaticProblem& problem, const LabelNames& names) {
  if (!problem.held.empty()) put(text, "*BOUNDARY\n");
  for (const auto& [node, displacement] : problem.held) put_by_axis(text, node, displacement, true);
  if (!problem.forces.empty()) put(text, "*CLOAD\n");
  for (const auto& [node, force] : problem.forces) put_by_axis(text, node, force, false);
  const double g = norm(problem.gravity);
  if (g > 0.0 || !problem.pushed.empty()) put(text, "*DLOAD\n");
  if (g > 0.0) {
    const sim::Vec3<double> along = (1.0 / g) * problem.gravity;
    for (const auto& [label, name] : names)
      put(text, "{}, GRAV, {:.12g}, {:.12g}, {:.12g}, {:.12g}\n", name, g, along.x, along.y,
          along.z);
  }
  for (const auto& face : problem.pushed)
    put(text, "{}, P{}, {:.12g}\n", face.element + 1, face_without[face.opposite], face.pressure);
}

}  // namespace

void write_scene_inp(const std::filesystem::path& path, const StaticProblem& problem) {
  LabelNames names;
  for (const auto& [label, part] : problem.labels) names[label] = part.name;
  names = identifiers(names);
  Buffer text;
  put(text,
      "** viscera: body at rest, supports and loads at the end of a scene; LPS mm. Units mm, N, t, "
      "s: stress in MPa, density in t/mm3.\n"
      "** Beyond small strains laws of the same name differ between programs.\n*NODE, NSET=ALL\n");
  for (std::size_t i = 0; i < problem.nodes.size(); ++i) {
    const auto& x = problem.nodes[i];
    put(text, "{}, {:.12g}, {:.12g}, {:.12g}\n", i + 1, x[0], x[1], x[2]);
  }
  put_elements(text, problem, names);
  put_materials(text, problem, names);
  put_beds(text, problem);
  put(text, "*STEP{}\n*STATIC\n0.25, 1.\n",
      problem.law == ElasticLaw::linear ? "" : ", NLGEOM, INC=1000");
  put_loads(text, problem, names);
  put(text, "*NODE FILE\nU, RF\n*EL FILE\nS\n*END STEP\n");
  write_atomically(path, {text.data(), text.size()});
}

}  // namespace viscera
