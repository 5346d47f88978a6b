// The independent judge: CalculiX (Debian's calculix-ccx) on the very mesh, C3D4 tets,
// geometrically non-linear statics under own weight.
//
// CalculiX's Neo-Hookean law is U = C10 (J^(-2/3) I_C - 3) + (J - 1)^2 / D1, ours is
// Psi = mu/2 (I_C - 3) + lambda/2 (J - 1 - mu/lambda)^2 with lambda = Lamé's constant + mu. Both
// have the same tangent at rest when C10 = mu/2 and D1 = 2/K with K = E / (3 (1 - 2 nu)). Beyond,
// they part with the square of the strain: CalculiX takes the volume out of I_C and puts all of
// pressure into (J - 1)^2, ours lets -mu (J - 1) balance the shear term. At nu 0.45 and the strains
// of the bar that is of the order of a tenth of a percent, part of the difference that is measured.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "pipeline/base/atomic_file.hpp"
#include "sim/measures/reactions.hpp"
#include "sim/solvers/fem/mesh.hpp"
#include "sim/stress/stress_field.hpp"
#include "tests/common/calculix.hpp"
#include "tests/common/needs.hpp"
#include "tests/verification/problems.hpp"

namespace viscera::sim {
namespace {

namespace fs = std::filesystem;

template <int n>
void write_elements(std::ostream& out, const std::vector<FemElement<n>>& elements) {
  for (std::size_t t = 0; t < elements.size(); ++t) {
    out << t + 1;
    for (const int node : elements[t].nodes) out << ", " << node + 1;
    out << '\n';
  }
}

// `prints`: what is asked of the end of the step.
void write_deck(const fs::path& file, const Model& model, const FemMesh& mesh, const char* prints) {
  std::ofstream out(file);
  out.precision(12);  // CalculiX reads 20 characters a number
  out << "*NODE, NSET=ALL\n";
  for (std::size_t i = 0; i < mesh.node_count(); ++i) {
    const auto& x = mesh.rest[i];
    out << i + 1 << ", " << x.x << ", " << x.y << ", " << x.z << '\n';
  }
  // Nodes of ten have the same order in both programs.
  out << "*ELEMENT, TYPE=" << (mesh.order == 1 ? "C3D4" : "C3D10") << ", ELSET=BODY\n";
  write_elements(out, mesh.linear);
  write_elements(out, mesh.quadratic);
  out << "*NSET, NSET=CLAMP\n";
  for (std::size_t i = 0; i < mesh.node_count(); ++i) {
    if (mesh.fixed[i]) out << i + 1 << ",\n";
  }
  const Material& m = model.materials.front();
  const double bulk = m.youngs_modulus / (3.0 * (1.0 - 2.0 * m.poisson_ratio));
  out << "*MATERIAL, NAME=TISSUE\n*HYPERELASTIC, NEO HOOKE\n"
      << 0.5 * lame(m).mu << ", " << 2.0 / bulk << "\n*DENSITY\n"
      << m.density << "\n*SOLID SECTION, ELSET=BODY, MATERIAL=TISSUE\n"
      << "*BOUNDARY\nCLAMP, 1, 3\n"
      << "*STEP, NLGEOM, INC=1000\n*STATIC\n0.25, 1.\n*DLOAD\nBODY, GRAV, 9.80665, 0., 0., -1.\n"
      << prints << "*END STEP\n";
}

struct Judgement {
  State state;
  // [n] N, what acts on each node from outside: for a clamped one what the clamp exerts and its
  // share of the weight.
  std::vector<Vec3<double>> outside;
};

// Lines of four numbers, a node and what is printed of it: first the displacements of all nodes,
// then the forces.
Judgement read_judgement(const fs::path& file, const Model& model) {
  const std::size_t n = model.vertex_count();
  Judgement out{at_rest(model), std::vector<Vec3<double>>(n)};
  std::ifstream in(file);
  std::size_t found = 0;
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    std::size_t node = 0;
    Vec3<double> value;
    if (!(words >> node >> value.x >> value.y >> value.z) || node < 1 || node > n) continue;
    (found < n ? out.state.u : out.outside)[node - 1] = value;
    ++found;
  }
  if (found != 2 * n) {
    throw std::runtime_error(
        fmt::format("CalculiX printed {} of {} displacements and forces", found, 2 * n));
  }
  return out;
}

// What `read` makes of what CalculiX leaves: the file `bar` with an extension.
template <class Read>
auto judged(const Model& model, int order, const char* prints, const char* extension, Read&& read) {
  const TemporaryFolder folder{fs::temp_directory_path()};
  write_deck(folder.path() / "bar.inp", model, FemMesh(model, order), prints);
  const std::string command =
      fmt::format("cd '{}' && OMP_NUM_THREADS=1 ccx bar > log 2>&1", folder.path().string());
  if (std::system(command.c_str()) != 0) throw std::runtime_error("CalculiX failed");
  return read(folder.path() / (std::string("bar") + extension), model);
}

Judgement judged(const Model& model) {
  return judged(model, 1, "*NODE PRINT, NSET=ALL, FREQUENCY=1000\nU, RF\n", ".dat", read_judgement);
}

// [vertices] Pa: Cauchy's stress at the nodes, extrapolated from the points of quadrature and
// averaged over elements.
std::vector<Tensor6> read_stress(const fs::path& file, const Model& model) {
  const auto field = calculix_field<6>(file, "STRESS");
  std::vector<Tensor6> stress;
  for (int v = 0; v < static_cast<int>(model.vertex_count()); ++v) stress.push_back(field.at(v));
  return stress;
}

// What the clamp exerts: how far its resultant is off CalculiX's, its moment about the body's
// centre of mass at rest (over the force times the clamp's lever to there), and its forces node by
// node.
struct ClampError {
  double force, moment, nodal;
};

ClampError clamp_error(const Model& model, const State& found, const Judgement& truth) {
  const Reactions reactions(model, own_weight());
  const auto own = reactions.at(FrameMotion::between(found, found, found, 1.0));
  const auto held = std::ranges::find(reactions.names(), Reactions::model_held);
  const Resultant& clamp = own.of[static_cast<std::size_t>(held - reactions.names().begin())];
  Resultant judged;
  double off = 0.0, all = 0.0, lever = 0.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    if (!model.fixed[i]) continue;
    lever = std::abs(model.rest[i].x - reactions.about().x);
    const Vec3<double> weight = {0.0, 0.0, -9.80665 * model.mass[i]};
    const Vec3<double> force = truth.outside[i] - weight, miss = own.contact[i] - force;
    judged.force += force;
    judged.moment += cross(model.rest[i] - reactions.about(), force);
    off += dot(miss, miss), all += dot(force, force);
  }
  return {norm(clamp.force - judged.force) / norm(judged.force),
          norm(clamp.moment - judged.moment) / (lever * norm(judged.force)), std::sqrt(off / all)};
}

// Root mean square over the vertices farther than `off_m` from the clamp, at whose edges stresses
// grow without bound, of what the stresses are off; over that of the true ones.
double stress_error(const Model& model, const StressField& field, const std::vector<Tensor6>& truth,
                    double off_m) {
  double off = 0.0, all = 0.0;
  for (std::size_t c = 0; c < field.corners.size(); ++c) {
    const int v = field.corners[c].vertex;
    if (model.rest[v].x + model.origin.x < off_m) continue;
    for (int k = 0; k < 6; ++k) {
      const double twice = k < 3 ? 1.0 : 2.0;  // shear stands twice in the tensor
      off += twice * std::pow(field.recovered[c].cauchy[k] - truth[v][k], 2);
      all += twice * std::pow(truth[v][k], 2);
    }
  }
  return std::sqrt(off / all);
}

// Stiff, so that the two laws are one to a part in a thousand.
struct StressedBar {
  Model model = judged_bar({20, 6, 6}, 5e5, 0.3);
  std::vector<Tensor6> truth =
      judged(model, 2, "*EL FILE, FREQUENCY=1000\nS\n", ".frd", read_stress);
  static constexpr double height = 0.03;  // m
};

void add_stress_rows(std::vector<Row>& rows) {
  const auto add = [&rows](const char* solver, Element element, double bound) {
    rows.push_back(
        {"judge", "stress at the vertices of a bar of 3,600 tets against CalculiX's quadratic tets",
         solver, "fp64", [=]() -> Outcome {
           static const StressedBar bar;  // the same for every element
           const Model& model = bar.model;
           const Scene scene = own_weight(model, element);
           const int order = element == Element::quadratic ? 2 : 1;
           const State found = equilibrium_from(at_rest(model), model, scene, order);
           const StressField field = stress_field(model, scene, found, order);
           return {
               {{"error farther from the clamp than the bar is high",
                 stress_error(model, field, bar.truth, bar.height), bound}},
               fmt::format("{:.3g} with the clamp", stress_error(model, field, bar.truth, -1.0)),
               ""};
         }});
  };
  add("fem, quadratic tets", Element::quadratic, 0.02);
  add("fem, smoothed elements", Element::smoothed, 0.02);
  add("fem, linear tets", Element::linear, 0.02);
}

struct Size {
  std::array<int, 3> cells;
  const char* name;
  double expected_tip;  // mm, computed with CalculiX before this project had a solver
};

void add_size(std::vector<Row>& rows, const Size& size) {
  const auto add = [&rows, size](const char* solver, auto find, double bound) {
    rows.push_back({"judge", fmt::format("bar of {} tets against CalculiX", size.name), solver,
                    "fp64", [=]() -> Outcome {
                      const Model model = judged_bar(size.cells);
                      const Judgement judgement = judged(model);
                      const State found = find(model), &truth = judgement.state;
                      const ClampError clamp = clamp_error(model, found, judgement);
                      return {{{"error", relative_error(model, found, truth), bound},
                               {"error of the clamp's force", clamp.force, 1e-4},
                               {"and of its moment", clamp.moment, bound},
                               {"CalculiX's tip against its anchor",
                                std::abs(tip_mm(model, truth) / size.expected_tip - 1.0), 5e-4}},
                              fmt::format("tip {:.2f} mm, CalculiX {:.2f} mm; the clamp's forces, "
                                          "node by node, are {:.2g} % off",
                                          tip_mm(model, found), tip_mm(model, truth),
                                          100.0 * clamp.nodal),
                              ""};
                    }});
  };
  add(
      "fem", [](const Model& model) { return equilibrium(model, own_weight()); }, 0.002);
  add(
      "xpbd gauss_seidel, 64 × 1",
      [](const Model& model) {
        Run run(model, own_weight(), xpbd(Scheme::gauss_seidel, Precision::fp64));
        run.settle(1e-6, 2.0, 0.6);
        return run.state();
      },
      0.01);
  rows.back().begins_first = size.cells[0] >= 40;
}

}  // namespace

void add_judge_problems(std::vector<Row>& rows) {
  if (!installed("ccx") && !must_have_packages()) {
    rows.push_back({"judge", "bar against CalculiX", "any", "fp64", []() -> Outcome {
                      return {{}, "skipped: ccx is not installed (Debian's calculix-ccx)", ""};
                    }});
    return;
  }
  add_size(rows, {{10, 3, 3}, "450", -25.78});
  add_size(rows, {{20, 6, 6}, "3,600", -30.91});
  add_size(rows, {{40, 12, 12}, "28,800", -32.90});
  add_stress_rows(rows);
}

}  // namespace viscera::sim
