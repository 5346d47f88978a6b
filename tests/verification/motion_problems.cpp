// Bodies without obstacles: stillness, free fall, momentum, energy.
#include <fmt/format.h>

#include "tests/verification/problems.hpp"

namespace viscera::sim {
namespace {

struct Entrant {
  const char* name;
  SolverOptions options;
};
std::vector<Entrant> entrants() {
  std::vector<Entrant> all;
  for (const Precision precision : {Precision::fp32, Precision::fp64}) {
    all.push_back({"xpbd gauss_seidel", xpbd(Scheme::gauss_seidel, precision)});
    all.push_back({"xpbd block_gauss_seidel", xpbd(Scheme::block_gauss_seidel, precision)});
    all.back().options.block_tets = 60;
    all.push_back({"xpbd jacobi, split 4", xpbd(Scheme::jacobi, precision)});
    all.push_back({"tled", {.method = Method::tled, .precision = precision, .threads = 1}});
  }
  return all;
}

Outcome stillness(const SolverOptions& options) {
  const Model model = make_cube(3);
  Run run(model, elastic_scene(), options);
  run.advance_to(100000.0 / 64.0 / 60.0);
  const double bound = options.precision == Precision::fp32 ? 1e-9 : 1e-14;
  return {{{"displacement, m", run.now().max_displacement, bound}}, "", ""};
}

Outcome free_fall(const SolverOptions& options) {
  const Model model = make_cube(3);
  Run run(model, own_weight(), options);
  run.advance_to(0.5);
  const double fallen = run.free_fall();
  double off = 0.0, strain = 0.0;
  const State& state = run.state();
  for (const auto& u : state.u) {
    off = std::max(off, std::abs(u.z + fallen));
    strain = std::max(strain, norm(u - state.u.front()));
  }
  const double round_off = options.precision == Precision::fp32 ? 1e-4 : 1e-12;
  return {{{"error / fall", off / fallen, round_off},
           {"deformation / L", strain / model.size(), round_off}},
          fmt::format("after {:.0f} steps", run.time() / run.scene().time.substep_s()),
          ""};
}

State disturbed(const Model& model) {
  std::mt19937 generator(3);
  State state = at_rest(model);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    state.u[i] = random_vector(generator, 5e-4);
    state.v[i] = random_vector(generator, 0.02) +
                 cross(Vec3<double>{0.0, 0.0, 5.0}, model.rest[i]) + Vec3<double>{0.1, 0.0, 0.0};
  }
  return state;
}

struct Momenta {
  Vec3<double> linear, angular;
};
Momenta momenta(const Model& model, const State& state) {
  Momenta sum;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const Vec3<double> p = model.mass[i] * state.v[i];
    sum.linear += p;
    sum.angular += cross(model.rest[i] + state.u[i], p);
  }
  return sum;
}

struct Drift {
  double linear, angular;
};
Drift drift(const SolverOptions& options, int substeps) {
  const Model model = make_cube(4);
  Scene scene = elastic_scene();
  scene.time.substeps = substeps;
  Run run(model, scene, options);
  const State start = disturbed(model);
  run.start_from(start);
  run.advance_to(0.5);
  const Momenta a = momenta(model, start), b = momenta(model, run.state());
  return {norm(b.linear - a.linear) / norm(a.linear),
          norm(b.angular - a.angular) / norm(a.angular)};
}

Outcome momentum(const SolverOptions& options) {
  const Drift coarse = drift(options, 64), fine = drift(options, 256);
  const bool single = options.precision == Precision::fp32;
  Outcome outcome = {{{"linear drift", coarse.linear, single ? 1e-4 : 1e-12}},
                     fmt::format("angular drift {:.2g} at 64 substeps", coarse.angular),
                     ""};
  // In single precision round-off hides the fall.
  const double at_most = single ? 1e-2 : std::max(coarse.angular, 1e-12);
  outcome.measures.push_back({"angular drift at 256 substeps", fine.angular, at_most});
  return outcome;
}

Outcome energy(const SolverOptions& options) {
  const Model model = make_cube(4);
  Run run(model, elastic_scene(), options);
  run.start_from(disturbed(model));
  const double start = run.now().total();
  double before = start, rise = 0.0;
  for (int frame = 0; frame < 60; ++frame) {
    run.advance();
    rise = std::max(rise, run.now().total() / before - 1.0);
    before = run.now().total();
  }
  return {{{"largest rise in a frame", rise, options.precision == Precision::fp32 ? 1e-6 : 1e-9}},
          fmt::format("{:.3f} of it left after 1 s", before / start),
          ""};
}

}  // namespace

void add_motion_problems(std::vector<Row>& rows) {
  const auto add = [&rows](const char* section, const char* name, auto run) {
    for (const auto& [solver, options] : entrants()) {
      rows.push_back({section, name, solver, name_of(options.precision),
                      [run, options = options] { return run(options); }});
    }
  };
  add("stillness", "no gravity, 1e5 steps", stillness);
  add("free fall", "discrete law", free_fall);
  add("momentum", "a shaken, turning cube, 0.5 s", momentum);
  add("energy", "never rises", energy);
}

}  // namespace viscera::sim
