// End states under own weight against Newton's equilibrium on the same mesh: what is left is the
// solver's own error. Runs are settled by cutting velocities, which moves no equilibrium, and the
// speed that is left is told.
#include <fmt/format.h>

#include <future>
#include <limits>
#include <optional>

#include "tests/verification/problems.hpp"

namespace viscera::sim {
namespace {

struct SchemeName {
  const char* name;
  SolverOptions options;
};
std::vector<SchemeName> schemes() {
  const auto jacobi = [](double split) {
    SolverOptions options = xpbd(Scheme::jacobi, Precision::fp64);
    options.split = split;
    return options;
  };
  return {{"xpbd gauss_seidel", xpbd(Scheme::gauss_seidel, Precision::fp64)},
          {"xpbd block_gauss_seidel", xpbd(Scheme::block_gauss_seidel, Precision::fp64)},
          {"xpbd jacobi, split 1", jacobi(1.0)},
          {"xpbd jacobi, split 4", jacobi(4.0)},
          {"xpbd jacobi, split 24", jacobi(24.0)},
          {"tled", {.method = Method::tled, .precision = Precision::fp64, .threads = 1}}};
}

struct Settled {
  State state;
  double tip, error, speed;  // mm, of Newton's displacement, m/s
};

// Without a policy: what too few substeps do is to be seen.
Settled settle(const Model& model, Scene scene, const State& exact, const SolverOptions& options,
               int substeps) {
  scene.time.substeps = substeps;
  scene.stability = StabilityPolicy::warn;
  Run run(model, scene, options);
  run.settle(1e-7, 2.5, 0.6);
  return {run.state(), tip_mm(model, run.state()), relative_error(model, run.state(), exact),
          run.now().max_speed};
}

std::string note_of(const Settled& settled, double exact_tip) {
  if (!settled.state.finite()) return "not finite: unstable";
  return fmt::format("tip {:.2f} mm (Newton {:.2f}), {:.1g} m/s left", settled.tip, exact_tip,
                     settled.speed);
}

void add_stiffness_rows(std::vector<Row>& rows, const char* solver, Element element) {
  for (const double e : {5e3, 1.5e4, 5e4}) {
    for (const double nu : {0.3, 0.45, 0.49}) {
      rows.push_back(
          {"static", fmt::format("bar of 450 tets, E {:g} kPa, ν {}", 1e-3 * e, nu), solver, "fp64",
           [e, nu, element]() -> Outcome {
             const Model model = judged_bar({10, 3, 3}, e, nu);
             const Scene scene = own_weight(model, element);
             const State exact = equilibrium(model, scene);
             const auto found =
                 settle(model, scene, exact, xpbd(Scheme::gauss_seidel, Precision::fp64), 64);
             return {{{"error", found.error, 0.01}}, note_of(found, tip_mm(model, exact)), ""};
           }});
    }
  }
}

// What a scheme's error may be with so many substeps. The goal is Gauss-Seidel's at 64; blocks are
// judged there too, with which most of the tables run them; the rest shows how each falls off.
std::optional<double> max_error(const SolverOptions& options, int substeps) {
  if (options.method != Method::xpbd) return {};
  if (options.scheme == Scheme::gauss_seidel && substeps == 64) return 0.003;
  if (options.scheme == Scheme::block_gauss_seidel && substeps >= 64) return 0.01;
  return {};
}

void add_substep_rows(std::vector<Row>& rows) {
  for (const auto& [name, options] : schemes()) {
    for (const int substeps : {16, 32, 64, 128}) {
      rows.push_back({"substeps", fmt::format("bar of 3,600 tets, {} substeps", substeps), name,
                      "fp64", [options = options, substeps]() -> Outcome {
                        static const Model model = judged_bar({20, 6, 6});
                        static const State exact = equilibrium(model, own_weight());
                        const auto found = settle(model, own_weight(), exact, options, substeps);
                        const double tip = tip_mm(model, exact);
                        std::string note = note_of(found, tip);
                        if (!found.state.finite())
                          return {{{"not finite", 1.0, 0.0}}, "unstable", ""};
                        const auto most = max_error(options, substeps);
                        if (!most)
                          return {{}, fmt::format("error {}, {}", number(found.error), note)};
                        return {{{"error", found.error, *most}}, note, ""};
                      }});
    }
  }
}

// 64 sweeps a frame, as substeps or as iterations.
Outcome equal_work() {
  const Model model = judged_bar({10, 3, 3});
  const State exact = equilibrium(model, own_weight());
  std::string note = fmt::format("Newton {:.2f} mm;", tip_mm(model, exact));
  double rises = 0.0, before = std::numeric_limits<double>::infinity();
  for (int substeps = 1; substeps <= 64; substeps *= 2) {
    const SolverOptions options = xpbd(Scheme::gauss_seidel, Precision::fp64, 64 / substeps);
    const auto found = settle(model, own_weight(), exact, options, substeps);
    note += fmt::format(" {} × {}: {:.2f} mm,", substeps, 64 / substeps, found.tip);
    if (!(found.error <= before)) rises += 1.0;
    before = found.error;
  }
  note.back() = '.';
  return {{{"rises of the error with substeps", rises, 0.0}}, note, ""};
}

Outcome single_against_double(Scheme scheme, double offset, double bound) {
  const Model plain = judged_bar({10, 3, 3});
  const Material material = plain.materials.front();
  auto points = plain.rest;
  for (auto& p : points) p += Vec3<double>{offset, -offset, offset};
  Model moved =
      make_model(points, plain.tets, std::vector<int>(plain.tet_count(), 1), {{1, material}});
  moved.fixed = plain.fixed;
  const auto settled = [scheme](const Model& model, Precision precision) {
    Run run(model, own_weight(), xpbd(scheme, precision));
    run.settle(1e-7, 2.5, 0.6);
    return run.state();
  };
  const State exact = settled(plain, Precision::fp64), found = settled(moved, Precision::fp32);
  double worst = 0.0;
  for (std::size_t i = 0; i < found.u.size(); ++i) {
    worst = std::max(worst, norm(found.u[i] - exact.u[i]));
  }
  return {{{"largest difference / L", worst / plain.size(), bound}}, "", ""};
}

struct Bound {
  double poisson_ratio, smoothed;
};

struct QuadraticBar {
  Model model;
  State exact;
};
QuadraticBar quadratic_bar(double poisson_ratio) {
  Model model = judged_bar({20, 6, 6}, 5e4, poisson_ratio);
  State exact = equilibrium_from(at_rest(model), model, own_weight(), 2);
  return {std::move(model), std::move(exact)};
}

Outcome off_quadratic_tets(const QuadraticBar& bar, Element element, std::optional<double> bound) {
  const State found = equilibrium(bar.model, own_weight(bar.model, element));
  const double error = relative_error(bar.model, found, bar.exact);
  const std::string note = fmt::format("tip {:.2f} mm, of quadratic tets {:.2f} mm",
                                       tip_mm(bar.model, found), tip_mm(bar.model, bar.exact));
  if (!bound) return {{}, fmt::format("error {}, {}", number(error), note)};
  return {{{"error", error, *bound}}, note, ""};
}

// What is left of a body's error when the solver has none: equilibria of the elements that XPBD
// takes against those of quadratic tets on the same mesh, which CalculiX's confirm
// (judge_problems.cpp). Those are found once for both rows, when the first asks.
void add_element_rows(std::vector<Row>& rows) {
  for (const auto& [nu, bound] : {Bound{0.3, 0.01}, {0.45, 0.01}, {0.49, 0.02}, {0.499, 0.03}}) {
    const auto bar = std::async(std::launch::deferred, quadratic_bar, nu).share();
    const auto add = [&rows, &bar, nu = nu](const char* solver, Element element,
                                            std::optional<double> most) {
      rows.push_back(
          {"element", fmt::format("bar of 3,600 tets, ν {}, against quadratic tets", nu), solver,
           "fp64", [bar, element, most] { return off_quadratic_tets(bar.get(), element, most); }});
    };
    add("any, smoothed elements", Element::smoothed, bound);
    add("any, linear tets", Element::linear, {});
  }
}

}  // namespace

void add_static_problems(std::vector<Row>& rows) {
  add_stiffness_rows(rows, "xpbd gauss_seidel, 64 × 1", Element::linear);
  add_stiffness_rows(rows, "xpbd gauss_seidel, smoothed elements, 64 × 1", Element::smoothed);
  add_substep_rows(rows);
  rows.push_back({"substeps", "64 sweeps a frame, as substeps × iterations", "xpbd gauss_seidel",
                  "fp64", equal_work});
  for (const auto& [offset, bound] : {std::pair{0.0, 1e-4}, {1.0, 1e-3}, {1e3, 1e-3}}) {
    rows.push_back({"precision", fmt::format("fp32 at {:g} m against fp64 at 0", offset),
                    "xpbd gauss_seidel", "fp32", [offset = offset, bound = bound] {
                      return single_against_double(Scheme::gauss_seidel, offset, bound);
                    }});
  }
  add_element_rows(rows);
}

}  // namespace viscera::sim
