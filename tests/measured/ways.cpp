#include "tests/measured/ways.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cstdio>

#include "sim/element_choice.hpp"
#include "sim/scheme_choice.hpp"
#include "tests/results/run.hpp"

namespace viscera::sim {
namespace {

using Settle = std::function<State(const Model&, const Scene&, const State&)>;

// With the elements and the scheme that the product chooses, in its precision.
State by_substeps(const Model& model, Scene scene, const State& start, SolverOptions options) {
  if (options.method == Method::pbd) {  // has no law: it keeps edges and volumes
    scene.params<NeoHookean>().clear();
    scene.params<Distance>().emplace_back();
    scene.params<Volume>().emplace_back();
  }
  set_element(scene.effects, choose_element(scene, options).element, model.largest_poisson_ratio());
  options.scheme = choose_scheme(model, scene, options, false).scheme;
  Run run(model, scene, options);
  run.start_from(start);
  run.settle(1e-4, 4.0, 0.9);
  return run.state();
}

Way way(const char* name, Settle settle) {
  return {name, [name, settle = std::move(settle)](const Model& model, const Scene& scene,
                                                   const State& start) {
            const auto begin = std::chrono::steady_clock::now();
            State state = settle(model, scene, start);
            const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
            fmt::print(stderr, "{} tets, {}: {:.1f} s\n", model.tet_count(), name, took.count());
            return Way::Found{std::move(state), took.count()};
          }};
}

}  // namespace

const std::vector<Way>& ways() {
  static const std::vector<Way> all = {
      way("fem (quadratic tets)",
          [](const Model& model, const Scene& scene, const State& start) {
            return equilibrium_from(start, model, scene, 2);
          }),
      way("xpbd (default)",
          [](const Model& model, const Scene& scene, const State& start) {
            return by_substeps(model, scene, start, {});
          }),
      way("fem (linear tets)",
          [](const Model& model, const Scene& scene, const State& start) {
            return equilibrium_from(start, model, scene, 1);
          }),
      way("pbd", [](const Model& model, const Scene& scene, const State& start) {
        return by_substeps(model, scene, start, {.method = Method::pbd});
      })};
  return all;
}

}  // namespace viscera::sim
