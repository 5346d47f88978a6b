// Whether the error bar of a run (sim/error_bar.hpp) holds: what it says of bodies at rest, beside
// how far they are off quadratic tets on the same mesh with every tet cut in eight (small ones
// twice), which stand for the truth.
//   bench_error CSV [MESH.vtu…]   bars, a panel and cubes; and these livers, held by their superior
//                                 30 mm, gravity along +y
// Errors are root mean squares over the body's mass in percent of the displacement's; effectivity
// is what the bar says over the true error.
#include <cstdio>
#include <fstream>

#include "sim/error_bar.hpp"
#include "tests/bench/bodies.hpp"

namespace viscera {
namespace {

using sim::Model, sim::Scene, sim::State, sim::Vec3;

struct Case {
  std::string name;
  double nu;
  Model model;
  Scene scene;
  int cuts;  // of the mesh that gives the truth
};

constexpr double face = 1e-9;  // m: a side and nothing behind it

// The tapered panel of Cook, 48 mm long, 44 to 16 mm high and 8 mm deep, bent by a load at its end.
Case panel(double nu) {
  Model box = sim::make_five_tet_box({0.048, 0.044, 0.008}, {8, 8, 2}, tissue(nu, 5e4));
  for (auto& x : box.rest) {
    const double along = (x.x + 0.024) / 0.048, up = (x.y + 0.022) / 0.044;
    x = {0.048 * along, 0.044 * along + up * (0.044 - 0.028 * along), x.z};
  }
  const std::vector<int> labels(box.tet_count(), 0);
  Model model = make_model(box.rest, box.tets, labels, {{0, box.materials[0]}}, {{0, "panel"}});
  Case one{"tapered panel", nu, std::move(model), scene_of(sim::Element::linear, nu), 1};
  one.scene.params<sim::Gravity>().clear();
  auto& held = one.scene.params<sim::Fixed>().emplace_back();
  held.side = "right", held.within = face;
  auto& load = one.scene.params<sim::Load>().emplace_back();
  load.side = "left", load.force = {0.0, 0.05, 0.0};
  return one;
}

Case held_bar(int fine, double nu, int cuts) {
  Body body = bar(fine, nu);
  return {body.name, nu, std::move(body.model), scene_of(sim::Element::linear, nu), cuts};
}

// Half of the bar is a hundred times as stiff.
Case two_tissues(double nu) {
  const Model bar_model = bar(3, nu).model;
  std::vector<int> labels;
  for (const auto& tet : bar_model.tets) {
    double x = 0.0;
    for (const int v : tet) x += 0.25 * bar_model.rest[v].x;
    labels.push_back(x < 0.0 ? 1 : 2);
  }
  Model model =
      make_model(bar_model.rest, bar_model.tets, labels,
                 {{1, tissue(nu, 2e5)}, {2, tissue(nu, 2e7)}}, {{1, "soft"}, {2, "stiff"}});
  model.fixed = bar_model.fixed;
  return {"bar of two tissues, E 1:100", nu, std::move(model), scene_of(sim::Element::linear, nu),
          2};
}

// Bonded below and above, and pressed by a fifth of its height.
Case bonded_cube(double nu) {
  Case one{"bonded cube, pressed by 20 %", nu,
           sim::make_five_tet_box({0.05, 0.05, 0.05}, {5, 5, 5}, tissue(nu, 5e3)),
           scene_of(sim::Element::linear, nu), 1};
  auto& below = one.scene.params<sim::Fixed>().emplace_back();
  below.side = "inferior", below.within = face;
  auto& top = one.scene.params<sim::Prescribed>().emplace_back();
  top.side = "superior", top.within = face, top.displacement = {0.0, 0.0, -0.01},
  top.duration = 0.0;
  return one;
}

// Led down by a fifth of its height onto a plane with friction.
Case pressed_cube(double nu) {
  Case one{"cube pressed onto a plane", nu,
           sim::make_five_tet_box({0.05, 0.05, 0.05}, {5, 5, 5}, tissue(nu, 5e3)),
           scene_of(sim::Element::linear, nu), 1};
  auto& top = one.scene.params<sim::Prescribed>().emplace_back();
  top.side = "superior", top.within = face, top.displacement = {0.0, 0.0, -0.01},
  top.duration = 0.0;
  auto& ground = one.scene.params<sim::Ground>().emplace_back();
  ground.clearance = 0.001, ground.friction = 0.3;
  return one;
}

Case held_liver(const char* file, double nu) {
  Body body = liver(file, nu);
  const std::string path = file;
  return {path.substr(path.rfind('/') + 1), nu, std::move(body.model),
          scene_of(sim::Element::linear, nu), 1};
}

void judge(const Case& one, std::string& csv) {
  Model fine = one.model;
  for (int cut = 0; cut < one.cuts; ++cut) fine = sim::cut_in_eight(fine);
  const std::vector<Vec3<double>> truth = equilibrium(fine, one.scene, 2).u;
  const std::vector<Vec3<double>> none(one.model.vertex_count());
  for (const bool smoothed : {false, true}) {
    Scene scene = one.scene;
    if (smoothed) set_element(scene.effects, sim::Element::smoothed, one.nu);
    const State end = equilibrium(one.model, scene, 1);
    const sim::ErrorBar bar = error_bar(one.model, scene, end, 1, [] {});
    const char* element = smoothed ? "smoothed" : "linear";
    std::string line =
        fmt::format("\"{}\",{},{},{},", one.name, one.model.tet_count(), one.nu, element);
    if (bar.unknown.empty()) {
      const double size = 0.01 * off(one.model, none, truth), found = off(one.model, end.u, truth);
      const auto& parts = bar.displacement;
      line += fmt::format("{:.3f},{:.3f},{:.3f},{:.3f},{:.2f}\n", parts.element / size,
                          parts.mesh / size, parts.total / size, found / size, parts.total / found);
    } else {
      line += fmt::format(",,,,\"{}\"\n", bar.unknown);
    }
    fmt::print("{}", line);
    std::fflush(stdout);
    csv += line;
  }
}

}  // namespace
}  // namespace viscera

int main(int argc, char** argv) {
  using namespace viscera;
  if (argc < 2) return std::fputs("usage: bench_error CSV [MESH.vtu…]\n", stderr), 2;
  std::vector<std::function<Case()>> cases;
  for (const double nu : {0.3, 0.45, 0.49}) {
    cases.push_back([nu] { return held_bar(3, nu, 2); });
  }
  cases.push_back([] { return held_bar(6, 0.45, 1); });
  for (const double nu : {0.3, 0.45}) cases.push_back([nu] { return panel(nu); });
  cases.push_back([] { return two_tissues(0.45); });
  for (const double nu : {0.3, 0.45, 0.49}) cases.push_back([nu] { return bonded_cube(nu); });
  for (const double nu : {0.3, 0.45}) cases.push_back([nu] { return pressed_cube(nu); });
  for (int i = 2; i < argc; ++i) {
    for (const double nu : {0.3, 0.45, 0.49}) {
      cases.push_back([file = argv[i], nu] { return held_liver(file, nu); });
    }
  }
  std::string csv =
      "body,tets,nu,element,element_percent,mesh_percent,total_percent,true_percent,effectivity\n";
  for (const auto& one : cases) {
    judge(one(), csv);
    std::ofstream(argv[1]) << csv;
  }
}
