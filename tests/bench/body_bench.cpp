// What the elements cost and what they are worth: how far a body at rest is off quadratic tets, by
// linear tets and by smoothed elements, solved by Newton and by XPBD, with milliseconds a frame of
// one thread and, where there is one, of a CUDA device.
//   bench_body CSV NU,NU… MESH.vtu…    livers: held by their superior 30 mm, gravity along +y
//   bench_body CSV NU,NU… bar          10 x 3 x 3 cm, held at one end, by Newton alone, against
//                                      quadratic tets of half the size of the finest bar's
// Errors are root mean squares over the vertices, in percent of the displacement's: `total` against
// quadratic tets, which for livers are those of the same mesh and for bars the finest, and `solver`
// against Newton's method on the same elements.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "sim/make.hpp"
#include "sim/measures/stability.hpp"
#include "tests/bench/bodies.hpp"

namespace viscera {
namespace {

using sim::Scene, sim::State, sim::Vec3;

constexpr std::size_t max_tets_on_cpu = 30'000;  // beyond, one thread takes minutes to come to rest

struct Place {
  const char* name;
  bool on_device;
  sim::Scheme scheme;
};
constexpr Place places[] = {{"xpbd cpu", false, sim::Scheme::gauss_seidel},
                            {"xpbd cuda", true, sim::Scheme::gauss_seidel},
                            {"xpbd cuda blocks", true, sim::Scheme::block_gauss_seidel}};

sim::Element element_of(bool smoothed) {
  return smoothed ? sim::Element::smoothed : sim::Element::linear;
}

std::vector<Vec3<double>> judged(const Body& body, const State& state) {
  std::vector<Vec3<double>> u;
  for (const std::size_t i : body.judged) u.push_back(state.u[i]);
  return u;
}

double percent_off(const std::vector<Vec3<double>>& u, const std::vector<Vec3<double>>& truth) {
  return 100.0 * root_mean_square(u, &truth) / root_mean_square(truth, nullptr);
}

struct Bench {
  std::string csv;

  void row(const Body& body, double nu, const char* element, const char* solver, int substeps,
           double total, double own, const std::vector<double>& ms) {
    std::string times = ",,";
    if (!ms.empty()) {
      const auto [median, q1, q3] = Times::of(ms);
      times = fmt::format("{:.3f},{:.3f},{:.3f}", median, q1, q3);
    }
    const std::string line = fmt::format("{},{},{},{},{},{:.3f},{:.3f},{}\n", body.name, nu,
                                         element, solver, substeps, total, own, times);
    fmt::print("{}", line);
    std::fflush(stdout);
    csv += line;
  }

  // At rest by XPBD, from where Newton has it; velocities are halved on the way.
  void xpbd(const Body& body, double nu, bool smoothed, const State& newton,
            const std::vector<Vec3<double>>& truth) {
    for (const int substeps : {8, 16, 32, 64}) {
      Scene scene = scene_of(element_of(smoothed), nu, substeps);
      if (assess(body.model, scene).limit.value > sim::cs_limit) continue;
      apply_policy(body.model, scene);
      for (const Place& place : places) {
        if (place.on_device ? !sim::find_cuda_device().name
                            : body.model.tet_count() > max_tets_on_cpu) {
          continue;
        }
        const sim::SolverOptions options{.scheme = place.scheme, .threads = 1};
        const auto solver = place.on_device ? make_on_cuda(body.model, scene, options)
                                            : make_on_cpu(body.model, scene, options);
        const auto [state, ms] = rest_from(*solver, newton, 40);
        const auto u = judged(body, state);
        row(body, nu, smoothed ? "smoothed" : "linear", place.name, substeps, percent_off(u, truth),
            percent_off(u, judged(body, newton)), ms);
      }
    }
  }

  void body(const Body& body, double nu, const std::vector<Vec3<double>>& truth, bool with_xpbd) {
    for (const bool smoothed : {false, true}) {
      const State newton = equilibrium(body.model, scene_of(element_of(smoothed), nu), 1);
      row(body, nu, smoothed ? "smoothed" : "linear", "newton", 0,
          percent_off(judged(body, newton), truth), 0.0, {});
      if (with_xpbd) xpbd(body, nu, smoothed, newton, truth);
    }
  }
};

void run(const std::string& what, double nu, Bench& bench) {
  if (what != "bar") {
    const Body body = liver(what.c_str(), nu);
    bench.body(body, nu,
               judged(body, equilibrium(body.model, scene_of(sim::Element::linear, nu), 2)), true);
    return;
  }
  const Body finest = bar(12, nu), finer = bar(6, nu);
  const auto truth =
      judged(finest, equilibrium(finest.model, scene_of(sim::Element::linear, nu), 2));
  const auto before =
      judged(finer, equilibrium(finer.model, scene_of(sim::Element::linear, nu), 2));
  bench.row(finer, nu, "quadratic", "newton", 0, percent_off(before, truth), 0.0, {});
  for (const int fine : {3, 6}) bench.body(bar(fine, nu), nu, truth, false);
}

}  // namespace
}  // namespace viscera

int main(int argc, char** argv) {
  if (argc < 4) return std::fputs("usage: bench_body CSV NU,NU… MESH.vtu…|bar\n", stderr), 2;
  viscera::Bench bench{
      "body,nu,element,solver,substeps,total_percent,solver_percent,ms_frame,q1,q3\n"};
  for (int i = 3; i < argc; ++i) {
    std::istringstream numbers(argv[2]);
    for (std::string nu; std::getline(numbers, nu, ',');) {
      viscera::run(argv[i], std::stod(nu), bench);
      std::ofstream(argv[1]) << bench.csv;
    }
  }
}
