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

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "pipeline/base/atomic_file.hpp"
#include "tests/common/needs.hpp"
#include "tests/verification/problems.hpp"

namespace viscera::sim {
namespace {

namespace fs = std::filesystem;

void write_deck(const fs::path& file, const Model& model) {
  std::ofstream out(file);
  out.precision(12);  // CalculiX reads 20 characters a number
  out << "*NODE, NSET=ALL\n";
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const auto& x = model.rest[i];
    out << i + 1 << ", " << x.x << ", " << x.y << ", " << x.z << '\n';
  }
  out << "*ELEMENT, TYPE=C3D4, ELSET=BODY\n";
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    out << t + 1;
    for (const int v : model.tets[t]) out << ", " << v + 1;
    out << '\n';
  }
  out << "*NSET, NSET=CLAMP\n";
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    if (model.fixed[i]) out << i + 1 << ",\n";
  }
  const Material& m = model.materials.front();
  const double bulk = m.youngs_modulus / (3.0 * (1.0 - 2.0 * m.poisson_ratio));
  out << "*MATERIAL, NAME=TISSUE\n*HYPERELASTIC, NEO HOOKE\n"
      << 0.5 * lame(m).mu << ", " << 2.0 / bulk << "\n*DENSITY\n"
      << m.density << "\n*SOLID SECTION, ELSET=BODY, MATERIAL=TISSUE\n"
      << "*BOUNDARY\nCLAMP, 1, 3\n"
      << "*STEP, NLGEOM, INC=1000\n*STATIC\n0.25, 1.\n*DLOAD\nBODY, GRAV, 9.80665, 0., 0., -1.\n"
      << "*NODE PRINT, NSET=ALL, FREQUENCY=1000\nU\n*END STEP\n";
}

// Lines of four numbers: the node and its displacement.
State read_displacements(const fs::path& file, const Model& model) {
  State state = at_rest(model);
  std::ifstream in(file);
  std::size_t found = 0;
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    std::size_t node = 0;
    Vec3<double> u;
    if (!(words >> node >> u.x >> u.y >> u.z) || node < 1 || node > state.u.size()) continue;
    state.u[node - 1] = u;
    ++found;
  }
  if (found != state.u.size()) {
    throw std::runtime_error(
        fmt::format("CalculiX printed {} of {} displacements", found, state.u.size()));
  }
  return state;
}

State judged(const Model& model) {
  const TemporaryFolder folder{fs::temp_directory_path()};
  write_deck(folder.path() / "bar.inp", model);
  const std::string command =
      fmt::format("cd '{}' && OMP_NUM_THREADS=1 ccx bar > log 2>&1", folder.path().string());
  if (std::system(command.c_str()) != 0) throw std::runtime_error("CalculiX failed");
  return read_displacements(folder.path() / "bar.dat", model);
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
                      const State truth = judged(model), found = find(model);
                      return {{{"error", relative_error(model, found, truth), bound},
                               {"CalculiX's tip against its anchor",
                                std::abs(tip_mm(model, truth) / size.expected_tip - 1.0), 5e-4}},
                              fmt::format("tip {:.2f} mm, CalculiX {:.2f} mm", tip_mm(model, found),
                                          tip_mm(model, truth)),
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
}

}  // namespace viscera::sim
