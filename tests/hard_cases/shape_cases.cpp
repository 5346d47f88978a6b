// Bodies that start where no tissue should be: pressed flat, turned inside out, scrambled, wrung.
// Cubes of 5 cm, 162 tets, E 5 kPa, nu 0.45. "No inverted tets" is not "recovered": only energy
// and the distance from a rigid copy of the rest shape count.
#include <fmt/format.h>

#include "sim/model/start.hpp"
#include "tests/hard_cases/cases.hpp"

namespace viscera::sim {
namespace {

constexpr double rms_bound = 1e-3, energy_bound = 1e-6;

bool has_its_shape(const Run& run) {
  return run.finite() && run.elastic_density() < energy_bound &&
         run.rigid_aligned_rms() < rms_bound;
}

// Waits until the body has kept its shape for a tenth of a second: passing through is not
// recovering. Returns when it had it first, or the time at which patience ran out.
double wait_for_shape(Run& run, double patience_s = 4.0) {
  int kept = 0;
  double since = run.time();
  while (kept < 6 && run.time() < patience_s - 1e-9 && run.advance()) {
    if (!has_its_shape(run))
      kept = 0;
    else if (++kept == 1)
      since = run.time();
  }
  return kept == 6 ? since : run.time();
}

// Lets a body go and waits until it has its shape back.
Outcome release(const SolverOptions& options, const std::function<Vec3<double>(Vec3<double>)>& to) {
  const Model model = make_cube(3);
  Run run(model, damped_scene(options), options);
  const State start = placed(model, to);
  check_start(model, start);
  run.start_from(start);
  const double given = run.peak_energy(), when = wait_for_shape(run);
  return {{{"ε", run.rigid_aligned_rms(), rms_bound},
           {"ψ/μ", run.elastic_density(), energy_bound},
           {"peak energy / start", run.peak_energy() / given, 1.0 + 1e-6}},
          fmt::format("at {:.2f} s, peak speed {:.3g} m/s, {:.1g} m/s left", when, run.peak_speed(),
                      run.now().rms_speed),
          ""};
}

CaseRun released(std::function<Vec3<double>(Vec3<double>)> to) {
  return [to](const SolverOptions& options) { return release(options, to); };
}

State scrambled(const Model& model, unsigned seed) {
  std::mt19937 generator(seed);
  return placed(model, [&](const Vec3<double>&) { return random_vector(generator, 0.025); });
}

Outcome scramble(const SolverOptions& options, double poisson_ratio) {
  Material material = soft_tissue;
  material.poisson_ratio = poisson_ratio;
  const Model model = make_cube(3, material);
  double lost = 0.0, blown_up = 0.0, slowest = 0.0, worst = 0.0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Run run(model, damped_scene(options), options);
    run.start_from(scrambled(model, seed));
    slowest = std::max(slowest, wait_for_shape(run, 2.0));
    lost += !has_its_shape(run);
    blown_up += !run.finite();
    worst = std::max(worst, run.elastic_density());
  }
  return {{{"seeds of 20 not recovered", lost, 0.0}, {"seeds not finite", blown_up, 0.0}},
          fmt::format("slowest {:.2f} s, worst ψ/μ {:.2g}", slowest, worst),
          ""};
}

// Two full turns and five times the length, along x from the clamped end.
Outcome wrung(const SolverOptions& options) {
  Model model = make_box({0.06, 0.03, 0.03}, {8, 4, 4}, soft_tissue);
  clamp_left(model);
  Run run(model, damped_scene(options), options);
  const double length = 0.06;
  run.start_from(placed(model, [&](const Vec3<double>& x) {
    const double s = x.x + 0.5 * length, angle = 4.0 * M_PI * s / length;
    const double c = std::cos(angle), sn = std::sin(angle);
    return Vec3<double>{5.0 * s - 0.5 * length, c * x.y - sn * x.z, sn * x.y + c * x.z};
  }));
  const double given = run.peak_energy();
  run.advance_to(10.0);
  return {{{"ε", run.rigid_aligned_rms(), 1e-2},
           {"peak energy / start", run.peak_energy() / given, 1.0 + 1e-6}},
          fmt::format("after 10 s; peak speed {:.3g} m/s", run.peak_speed()),
          ""};
}

}  // namespace

void add_shape_cases(std::vector<Row>& rows) {
  add_case(rows, "1", "squash to a plane", released([](Vec3<double> x) {
             return Vec3<double>{x.x, x.y, 0.0};
           }));
  add_case(rows, "1", "squash to 1 %", released([](Vec3<double> x) {
             return Vec3<double>{x.x, x.y, 0.01 * x.z};
           }));
  add_case(rows, "1", "mirror", released([](Vec3<double> x) {
             return Vec3<double>{x.x, x.y, -x.z};
           }));
  add_case(rows, "2", "collapse to a line", released([](Vec3<double> x) {
             return Vec3<double>{x.x, 0.0, 0.0};
           }),
           true);
  add_case(rows, "2", "collapse to a point", released([](Vec3<double>) { return Vec3<double>{}; }),
           true);
  add_case(rows, "3", "random scramble, 20 seeds, ν 0.3",
           [](const SolverOptions& options) { return scramble(options, 0.3); });
  add_case(rows, "3", "random scramble, 20 seeds, ν 0.45",
           [](const SolverOptions& options) { return scramble(options, 0.45); });
  add_case(rows, "4", "twist 720° and stretch ×5, release", wrung);
}

}  // namespace viscera::sim
