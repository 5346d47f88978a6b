// Friction and restitution against the laws of Coulomb and Newton.
#include <fmt/format.h>

#include "tests/verification/problems.hpp"

namespace viscera::sim {
namespace {

constexpr double g = 9.80665, friction = 0.4;

// A stiff block on a slope, made by tilting gravity.
Scene slope(double angle) {
  Scene scene = own_weight();
  scene.params<Gravity>().front().direction = {std::sin(angle), 0.0, -std::cos(angle)};
  auto& ground = scene.params<Ground>().emplace_back();
  ground.friction = friction;
  ground.clearance = 0.0;
  return scene;
}

Model block() {
  Material stiff = soft_tissue;
  stiff.youngs_modulus = 2e5;
  return make_box({0.06, 0.06, 0.02}, {3, 3, 1}, stiff);
}

double mean_along(const Model& model, const std::vector<Vec3<double>>& field) {
  double mass = 0.0, sum = 0.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    mass += model.mass[i];
    sum += model.mass[i] * field[i].x;
  }
  return sum / mass;
}

Outcome sticking(const SolverOptions& options) {
  const Model model = block();
  const double critical = std::atan(friction);
  const auto speed_after_a_second = [&](double share) {
    Run run(model, slope(std::atan(share * friction)), options);
    run.advance_to(1.0);
    return mean_along(model, run.state().v);
  };
  const double below = std::abs(speed_after_a_second(0.98)), above = speed_after_a_second(1.02);
  const double angle = std::atan(1.02 * friction);
  const double expected = g * (std::sin(angle) - friction * std::cos(angle));
  return {{{"speed 2 % below, m/s", below, 1e-3},
           {"speed 2 % above, off by", std::abs(above / expected - 1.0), 0.05}},
          fmt::format("critical angle {:.2f}°", critical * 180.0 / M_PI),
          ""};
}

Outcome sliding(const SolverOptions& options, int substeps) {
  const Model model = block();
  const double angle = 35.0 * M_PI / 180.0;
  Scene scene = slope(angle);
  scene.time.substeps = substeps;
  Run run(model, scene, options);
  run.advance_to(1.0);
  const double expected = g * (std::sin(angle) - friction * std::cos(angle));
  return {{{"speed off by", std::abs(mean_along(model, run.state().v) / expected - 1.0), 0.05}},
          fmt::format("{:.3f} m/s", expected),
          ""};
}

Outcome stopping(const SolverOptions& options) {
  const Model model = block();
  Run run(model, slope(0.0), options);
  State start = at_rest(model);
  for (auto& v : start.v) v.x = 1.0;
  run.start_from(start);
  run.advance_to(1.0);
  const double expected = 1.0 / (2.0 * friction * g);
  return {{{"distance off by", std::abs(mean_along(model, run.state().u) / expected - 1.0), 0.05}},
          fmt::format("{:.3f} m", expected),
          ""};
}

// The law is that of vertices, so nothing holds these together: h_n = e^(2n) h_0.
Outcome bouncing(const SolverOptions& options, double restitution) {
  constexpr double drop = 0.1;
  const Model model = make_cube(1, soft_tissue, 0.02);
  Scene scene;
  scene.params<Gravity>().emplace_back();
  auto& ground = scene.params<Ground>().emplace_back();
  ground.clearance = drop;
  ground.restitution = restitution;
  std::size_t low = 0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    if (model.rest[i].z < model.rest[low].z) low = i;
  }
  Run run(model, scene, options);
  std::vector<double> heights;  // over the drop, after every bounce, from speed and place
  double before = -1.0;
  while (heights.size() < 2 && run.time() < 1.0 && run.advance()) {
    const double v = run.state().v[low].z, z = drop + run.state().u[low].z;
    if (before < 0.0 && v > 0.0) heights.push_back((z + 0.5 * v * v / g) / drop);
    before = v;
  }
  Outcome outcome;
  for (std::size_t n = 0; n < 2; ++n) {
    const double expected = std::pow(restitution, 2.0 * (static_cast<double>(n) + 1.0));
    const double reached = n < heights.size() ? heights[n] : 0.0;
    outcome.measures.push_back(
        {fmt::format("bounce {} off by", n + 1), std::abs(reached / expected - 1.0), 0.05});
  }
  return outcome;
}

}  // namespace

void add_contact_problems(std::vector<Row>& rows) {
  for (const Precision precision : {Precision::fp32, Precision::fp64}) {
    const auto add = [&rows, precision](const std::string& name, const char* solver, auto run) {
      rows.push_back({"friction", name, solver, name_of(precision), run});
    };
    const SolverOptions options = xpbd(Scheme::gauss_seidel, precision);
    const SolverOptions more = xpbd(Scheme::gauss_seidel, precision, 4);
    add("sticks below its angle, slides above", "xpbd gauss_seidel",
        [options] { return sticking(options); });
    for (const int substeps : {32, 64, 128}) {
      add(fmt::format("slides down 35°, {} × 1", substeps), "xpbd gauss_seidel",
          [options, substeps] { return sliding(options, substeps); });
    }
    add("slides down 35°, 64 × 4", "xpbd gauss_seidel", [more] { return sliding(more, 64); });
    add("stopping distance", "xpbd gauss_seidel", [options] { return stopping(options); });
    for (const double e : {0.5, 0.9}) {
      rows.push_back({"restitution", fmt::format("vertices that fall 10 cm, e {}", e),
                      "xpbd gauss_seidel", name_of(precision),
                      [options, e] { return bouncing(options, e); }});
    }
  }
}

}  // namespace viscera::sim
