// Stiff beside soft, heavy on light, nearly incompressible, too few substeps. The reference is the
// equilibrium that Newton finds on the same mesh, so that what is measured is the solver's error.
#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "tests/hard_cases/cases.hpp"

namespace viscera::sim {
namespace {

template <class Function>
void for_each_centroid(const Model& model, Function&& function) {
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    Vec3<double> x;
    for (const int v : model.tets[t]) x += 0.25 * model.rest[v];
    function(t, x);
  }
}

double rms(const Model& model, const State& state) {
  return rms_difference(model, state, at_rest(model));
}

// Settles under the scene's forces; the difference to Newton's equilibrium over the rms
// displacement.
Outcome against_newton(const Model& model, const Scene& scene, const SolverOptions& options,
                       double bound, double seconds = 1.25) {
  const State exact = equilibrium(model, scene);
  Run run(model, scene, options);
  run.settle(1e-6, seconds, 0.63);
  return {{{"error / displacement", rms_difference(model, run.state(), exact) / rms(model, exact),
            bound}},
          fmt::format("Cs {:.2g}, κ {:.2g}, {} substeps, {:.1g} m/s left", run.stability().cs_max,
                      run.stability().kappa_max, run.scene().time.substeps, run.now().max_speed),
          ""};
}

// How many times as stiff or as dense a part is, and the scene's accuracy_limit; 0: none.
struct Contrast {
  double ratio;
  double accuracy_limit = 0.0;
};

// A bar of 10 x 2 x 2 cm, clamped at its left end; its middle fifth is stiffer.
Outcome stiffness_jump(const SolverOptions& options, Contrast jump) {
  Material soft = soft_tissue, stiff = soft_tissue;
  soft.youngs_modulus = 5e4;
  stiff.youngs_modulus = 5e4 * jump.ratio;
  Model model = make_box({0.1, 0.02, 0.02}, {5, 1, 1}, soft);
  model.materials.push_back(stiff);
  for_each_centroid(model, [&](std::size_t t, const Vec3<double>& x) {
    if (std::abs(x.x) < 0.01) model.material_of[t] = 1;
  });
  clamp_left(model);
  Scene scene = weighty_scene(options);
  scene.accuracy_limit = jump.accuracy_limit;
  return against_newton(model, scene, options, 0.01);
}

// A held bar with flat tets inside: one vertex lies close to what is opposite to it.
Outcome flat_tets(const SolverOptions& options) {
  constexpr double left = 0.05;  // of the height that the tets had
  const Model regular = make_box({0.06, 0.02, 0.02}, {6, 2, 2}, soft_tissue);
  std::vector<Vec3<double>> points = regular.rest;
  const auto inner = std::ranges::find_if(points, [](const Vec3<double>& x) {
    return std::abs(x.x) < 1e-9 && std::abs(x.y) < 1e-9 && std::abs(x.z) < 1e-9;
  });
  inner->x += (1.0 - left) * 0.01;
  Model model = make_model(points, regular.tets, std::vector<int>(regular.tet_count(), 1),
                           {{1, soft_tissue}});
  clamp_left(model);
  return against_newton(model, weighty_scene(options), options, 0.01);
}

// The slender, stiff bar of docs/results/physics.md, whose elements hold their forces.
Outcome slender_bar(const SolverOptions& options, double nu) {
  Material stiff = soft_tissue;
  stiff.youngs_modulus = 264e3;
  stiff.poisson_ratio = nu;
  stiff.damping = 0.03;
  Model model = make_box({0.1, 0.03, 0.03}, {12, 4, 4}, stiff);
  clamp_left(model);
  Scene scene = weighty_scene(options);
  scene.accuracy_limit = 0.01;
  return against_newton(model, scene, options, 0.01);
}

// A column that hangs from its top; its lowest third is denser.
Outcome mass_ratio(const SolverOptions& options, Contrast density) {
  const double ratio = density.ratio;
  Material light = soft_tissue, heavy = soft_tissue;
  light.youngs_modulus = heavy.youngs_modulus = 2e3 * ratio;
  heavy.density *= ratio;
  Model model = make_box({0.06, 0.02, 0.02}, {6, 2, 2}, light);
  model.materials.push_back(heavy);
  for_each_centroid(model, [&](std::size_t t, const Vec3<double>& x) {
    if (x.x < 0.01) return;
    model.material_of[t] = 1;
    for (const int v : model.tets[t]) {
      model.mass[v] += 0.25 * model.volume[t] * (heavy.density - light.density);
    }
  });
  clamp_left(model);
  Scene scene = weighty_scene(options);
  scene.params<Gravity>().front().direction = {1.0, 0.0, 0.0};
  scene.accuracy_limit = density.accuracy_limit;
  // In blocks its elements hold their forces over .7 s.
  const double seconds = density.accuracy_limit > 0.0 ? 4.0 : 1.25;
  return against_newton(model, scene, options, 0.01, seconds);
}

// The bar's volume and sag against those of Newton's equilibrium. What is left of the sag at nu
// 0.45 in Newton's (locking) is reported.
Outcome nearly_incompressible(const SolverOptions& options, double nu) {
  const auto bar = [](double poisson_ratio) {
    Material material = soft_tissue;
    material.youngs_modulus = 5e4;
    material.poisson_ratio = poisson_ratio;
    Model model = make_five_tet_box({0.1, 0.03, 0.03}, {6, 2, 2}, material);
    clamp_left(model);
    return model;
  };
  const Model model = bar(nu), plain = bar(0.45);
  const Scene scene = weighty_scene(options);
  const State exact = equilibrium(model, scene);
  const double left = rms(model, exact) / rms(plain, equilibrium(plain, scene));
  const double volume = diagnose(model, scene, exact).volume_ratio;
  Run run(model, scene, options);
  run.settle(1e-5, 1.5);
  const double off = rms_difference(model, run.state(), exact) / rms(model, exact);
  return {{{"volume off", std::abs(run.now().volume_ratio - volume), 1e-3}, {"sag off", off, 0.02}},
          fmt::format("volume {:.6f}, locked to {:.3f} of the sag at ν 0.45, "
                      "κ {:.2g}, {} substeps",
                      volume, left, run.stability().kappa_max, run.scene().time.substeps),
          ""};
}

// A cube falls onto the ground at 1/30 s a frame with one substep.
Outcome one_substep(const SolverOptions& options, StabilityPolicy policy) {
  Material material = soft_tissue;
  material.youngs_modulus = 2e4;
  const Model model = make_cube(4, material);
  Scene scene = falling_scene(options);
  scene.time = {.frame_s = 1.0 / 30.0, .substeps = 1, .end_s = 3.0};
  scene.stability = policy;
  Run run(model, scene, options);
  run.advance_to(3.0);
  // What gravity can give: the fall to the ground and as much again for sagging.
  double mass = 0.0;
  for (const double m : model.mass) mass += m;
  const double given = mass * 9.80665 * 2.0 * scene.params<Ground>().front().clearance;
  return {{{"peak energy / given", run.peak_energy() / given, 1.0},
           {"ε", run.rigid_aligned_rms(), 0.1}},
          fmt::format("{} substeps, min J {:.3f}", run.scene().time.substeps, run.min_j()),
          ""};
}

// For XPBD, whose own error it is that accuracy_limit bounds; it may refuse.
void add_accuracy_case(std::vector<Row>& rows, const char* section, const std::string& name,
                       const CaseRun& run) {
  std::vector<Row> all;
  add_material_case(all, section, name, run, true);
  std::ranges::copy_if(all, std::back_inserter(rows),
                       [](const Row& row) { return row.solver.starts_with("xpbd"); });
}

}  // namespace

void add_material_cases(std::vector<Row>& rows) {
  const auto with = [](auto run, auto value) {
    return [run, value](const SolverOptions& options) { return run(options, value); };
  };
  add_material_case(rows, "10", "flat tets in a held bar", flat_tets, true);
  add_material_case(rows, "5", "stiffness jump 1e2", with(stiffness_jump, Contrast{1e2}), true);
  add_material_case(rows, "5", "stiffness jump 1e4", with(stiffness_jump, Contrast{1e4}), true);
  add_material_case(rows, "5", "stiffness jump 1e6", with(stiffness_jump, Contrast{1e6}), true);
  add_accuracy_case(rows, "5", "stiffness jump 1e2, accuracy_limit 1 %",
                    with(stiffness_jump, Contrast{1e2, 0.01}));
  add_accuracy_case(rows, "5", "stiffness jump 1e4, accuracy_limit 1 %",
                    with(stiffness_jump, Contrast{1e4, 0.01}));
  add_material_case(rows, "5", "slender bar of 264 kPa, ν 0.45, accuracy_limit 1 %",
                    with(slender_bar, 0.45), true);
  add_material_case(rows, "5", "slender bar of 264 kPa, ν 0.49, accuracy_limit 1 %",
                    with(slender_bar, 0.49), true);
  add_material_case(rows, "5", "slender bar of 264 kPa, ν 0.499, accuracy_limit 1 %",
                    with(slender_bar, 0.499), true);
  add_material_case(rows, "6", "mass ratio 1e4", with(mass_ratio, Contrast{1e4}));
  add_accuracy_case(rows, "6", "mass ratio 1e4, accuracy_limit 1 %",
                    with(mass_ratio, Contrast{1e4, 0.01}));
  add_material_case(rows, "7", "ν 0.49", with(nearly_incompressible, 0.49));
  add_material_case(rows, "7", "ν 0.499", with(nearly_incompressible, 0.499));
  add_material_case(rows, "7", "ν 0.4999", with(nearly_incompressible, 0.4999));
  add_material_case(rows, "7", "ν 0.49999", with(nearly_incompressible, 0.49999));
  add_case(rows, "8", "1/30 s with one substep, policy refuse",
           with(one_substep, StabilityPolicy::refuse), true);
  add_case(rows, "8", "1/30 s with one substep, policy substeps",
           with(one_substep, StabilityPolicy::substeps));
}

}  // namespace viscera::sim
