// What must be refused before the first step, with the field named; runs that must repeat; and
// scenes with next to nothing in them.
#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <numeric>

#include "sim/base/refusal.hpp"
#include "tests/hard_cases/cases.hpp"

namespace viscera::sim {
namespace {

constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();

// One row: what each attempt was refused with; those that were accepted, or refused with other
// words than `reason`, are the figures.
struct Attempt {
  const char* name;
  std::string reason;
  std::function<void()> make;
};
Outcome all_refused(const std::vector<Attempt>& attempts) {
  Outcome outcome;
  double accepted = 0.0, for_another_reason = 0.0;
  for (const auto& [name, reason, make] : attempts) {
    std::string said = "accepted";
    try {
      make();
      ++accepted;
    } catch (const Refusal& refusal) {
      said = refusal.what();
      if (said.find(reason) == std::string::npos) ++for_another_reason;
    }
    outcome.refusal += fmt::format("{}{}: “{}”", outcome.refusal.empty() ? "" : "; ", name, said);
  }
  outcome.measures = {{"accepted", accepted, 0.0},
                      {"refused for another reason", for_another_reason, 0.0}};
  return outcome;
}

using Points = std::vector<Vec3<double>>;
const Points corner = {{0, 0, 0}, {0.01, 0, 0}, {0, 0.01, 0}, {0, 0, 0.01}};

Model body(const Points& points, const std::vector<Tet>& tets,
           const Material& material = soft_tissue) {
  return make_model(points, tets, std::vector<int>(tets.size(), 1), {{1, material}});
}

Attempt tet(const char* name, const char* reason, Vec3<double> apex, Tet order = {0, 1, 2, 3}) {
  return {name, reason, [=] {
            Points points = corner;
            points[3] = apex;
            Scene scene = elastic_scene();
            apply_policy(body(points, {order}), scene);
          }};
}

Outcome bad_meshes() {
  const Attempt twins = {"two tets on coincident points", "3 at the place of another", [] {
                           Points points = corner;
                           points.insert(points.end(), corner.begin(), corner.end());
                           points[7] = {0.01, 0.01, 0.01};
                           body(points, {{0, 1, 2, 3}, {5, 6, 4, 7}});
                         }};
  return all_refused(
      {tet("sliver of dihedral 1e-5°", "which makes Cs 3", {0.005, 0.005, 1e-9}),
       tet("volume 1e-12 of a cube", "1 inverted or flat", {0.0, 0.0, 1e-15}), twins,
       tet("wrong winding", "1 inverted or flat", corner[3], {0, 2, 1, 3}),
       tet("NaN coordinate", "point 3: coordinates that are not finite", {0.0, nan_value, 0.01}),
       tet("vertex named twice", "tetrahedron 0: names a vertex twice", corner[3], {0, 1, 1, 3})});
}

Attempt material(const char* name, const char* field_name, double Material::*field, double value) {
  return {name, std::string("material of label 1, ") + field_name, [=] {
            Material m = soft_tissue;
            m.*field = value;
            body(corner, {{0, 1, 2, 3}}, m);
          }};
}

Attempt scene(const char* name, const char* field, const std::function<void(Scene&)>& change) {
  return {name, field, [=] {
            Scene s = drop_scene();
            change(s);
            make_on_cpu(make_cube(1), s, {});
          }};
}

Outcome bad_numbers() {
  return all_refused(
      {material("E −1", "E", &Material::youngs_modulus, -1.0),
       material("E NaN", "E", &Material::youngs_modulus, nan_value),
       material("ν 0.5", "nu", &Material::poisson_ratio, 0.5),
       material("ν −1", "nu", &Material::poisson_ratio, -1.0),
       material("density 0", "density", &Material::density, 0.0),
       material("damping NaN", "damping", &Material::damping, nan_value),
       scene("frame 0", "time.frame", [](Scene& s) { s.time.frame_s = 0.0; }),
       scene("frame NaN", "time.frame", [](Scene& s) { s.time.frame_s = nan_value; }),
       scene("substeps 0", "time.substeps", [](Scene& s) { s.time.substeps = 0; }),
       scene("friction −0.1", "effects.ground.friction",
             [](Scene& s) { s.params<Ground>().front().friction = -0.1; }),
       scene("restitution of a body 0.5", "effects.ground.restitution",
             [](Scene& s) { s.params<Ground>().front().restitution = 0.5; }),
       scene("friction NaN", "effects.ground.friction",
             [](Scene& s) { s.params<Ground>().front().friction = nan_value; }),
       scene("gravity ∞", "effects.gravity.acceleration",
             [](Scene& s) { s.params<Gravity>().front().acceleration = 1.0 / 0.0; }),
       scene("normal 0", "effects.ground.normal",
             [](Scene& s) { s.params<Ground>().front().normal = {}; })});
}

Outcome repeated(const SolverOptions& options) {
  const Model model = make_cube(4);
  std::uint64_t hash[2];
  for (auto& h : hash) {
    Run run(model, falling_scene(options), options);
    run.advance_to(0.5);
    h = run.state().hash();
  }
  return {{{"runs that differ in a bit", hash[0] == hash[1] ? 0.0 : 1.0, 0.0}}, "", ""};
}

// The same bar with its vertices and tets in another order: at rest it must hang the same way.
Outcome permuted(const SolverOptions& options) {
  Model model = make_box({0.06, 0.02, 0.02}, {6, 2, 2}, soft_tissue);
  std::vector<int> to(model.vertex_count());
  std::iota(to.begin(), to.end(), 0);
  std::mt19937 generator(3);
  std::ranges::shuffle(to, generator);
  Points points(to.size());
  for (std::size_t i = 0; i < to.size(); ++i) points[to[i]] = model.rest[i];
  auto tets = model.tets;
  for (auto& t : tets) {
    for (int& v : t) v = to[v];
  }
  std::ranges::shuffle(tets, generator);
  Model other = body(points, tets);
  clamp_left(model);
  clamp_left(other);
  Run run(model, weighty_scene(options), options),
      permuted_run(other, weighty_scene(options), options);
  run.settle(1e-6, 4.0);
  permuted_run.settle(1e-6, 4.0);
  State back = at_rest(model);
  for (std::size_t i = 0; i < to.size(); ++i) back.u[i] = permuted_run.state().u[to[i]];
  return {{{"difference / L", rms_difference(model, run.state(), back), 1e-3}}, "", ""};
}

Outcome all_fixed(const SolverOptions& options) {
  Model model = make_cube(2);
  std::ranges::fill(model.fixed, 1);
  Run run(model, weighty_scene(options), options);
  run.advance_to(0.2);
  return {{{"displacement, m", run.now().max_displacement, 0.0}}, "", ""};
}

// Free fall of one tet, and of a body whose ground is out of reach: the discrete law.
Outcome free_fall(const SolverOptions& options, const Model& model, const Scene& scene) {
  Run run(model, scene, options);
  run.advance_to(0.2);
  const double fallen = run.free_fall();
  double worst = 0.0;
  for (const auto& u : run.state().u) worst = std::max(worst, norm(u + Vec3<double>{0, 0, fallen}));
  const double bound = options.precision == Precision::fp32 ? 1e-4 : 1e-9;
  return {{{"error / fall", worst / fallen, bound}}, "", ""};
}

Outcome rigid(const SolverOptions& options) {
  Material steel = soft_tissue;
  steel.youngs_modulus = 1e300;
  const Model model = make_cube(2, steel);
  Run run(model, weighty_scene(options), options);
  run.advance_to(0.1);
  return {{{"not finite", run.finite() ? 0.0 : 1.0, 0.0}}, "", ""};
}

}  // namespace

void add_input_cases(std::vector<Row>& rows) {
  add_case(rows, "10", "meshes that cannot be simulated", bad_meshes);
  add_case(rows, "15", "numbers that make no sense", bad_numbers);
  add_case(rows, "16", "two runs", repeated);
  add_case(rows, "16", "permuted mesh", permuted);
  add_case(rows, "17", "all vertices fixed", all_fixed);
  add_case(rows, "17", "one tet", [](const SolverOptions& options) {
    return free_fall(options, body(corner, {{0, 1, 2, 3}}), weighty_scene(options));
  });
  add_case(rows, "17", "ground out of reach", [](const SolverOptions& options) {
    Scene scene = falling_scene(options);
    scene.params<Ground>().front().clearance = 1e3;
    return free_fall(options, make_cube(2), scene);
  });
  add_case(rows, "17", "no compliance (E 1e300 Pa)", rigid, true);
}

}  // namespace viscera::sim
