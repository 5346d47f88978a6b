// What a substep costs on this machine: nanoseconds a tet and substep, by method, scheme, precision
// and number of threads, and on a CUDA device where there is one, on meshes of the tetmesh stage.
// Says too which scheme is chosen for those who name none, and how much slower it is than the
// fastest. Configurations take turns, round after round, so that what else the machine does meets
// all of them; medians with their quartiles.
//   bench_solver CSV MESH.vtu…
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <thread>
#include <tuple>

#include "sim/base/refusal.hpp"
#include "sim/element_choice.hpp"
#include "sim/make.hpp"
#include "sim/scheme_choice.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/body.hpp"

namespace viscera {
namespace {

struct Row {
  std::string method, scheme;
  sim::SolverOptions options;
  bool viscous = true, smoothed = false, on_device = false;
  std::unique_ptr<sim::Solver> solver = {};
  std::vector<double> ns = {};

  // What orders the same elements another way competes with it.
  auto contest() const {
    return std::tuple(options.method, options.precision, options.iterations, viscous, smoothed,
                      on_device, options.threads);
  }
};

std::vector<Row> rows() {
  using sim::Method, sim::Precision, sim::Scheme;
  std::vector<Row> all;
  const auto add = [&all](const char* method, const char* scheme, sim::SolverOptions options,
                          bool viscous = true, bool smoothed = false) {
    for (const int threads : {1, 2, 4, 8, 16}) {
      if (threads > static_cast<int>(std::thread::hardware_concurrency())) continue;
      options.threads = threads;
      all.push_back({method, scheme, options, viscous, smoothed});
    }
    options.threads = 0;
    const bool runs = options.iterations == 1 && sim::find_cuda_device().name;
    if (runs) all.push_back({method, scheme, options, viscous, smoothed, true});
  };
  add("xpbd", "gauss_seidel", {}, false);
  add("xpbd", "gauss_seidel", {.precision = Precision::fp64}, false);
  add("xpbd", "gauss_seidel, viscosity", {});
  for (const int block_tets : {0, 500, 2000, 8000}) {
    const std::string size = block_tets ? fmt::format(" of {}", block_tets) : "";
    add("xpbd", ("block_gauss_seidel" + size + ", viscosity").c_str(),
        {.scheme = Scheme::block_gauss_seidel, .block_tets = block_tets});
  }
  add("xpbd", "gauss_seidel, viscosity, smoothed", {}, true, true);
  add("xpbd", "block_gauss_seidel, viscosity, smoothed", {.scheme = Scheme::block_gauss_seidel},
      true, true);
  add("xpbd", "jacobi, viscosity", {.scheme = Scheme::jacobi});
  add("xpbd", "gauss_seidel, 2 iterations", {.iterations = 2}, false);
  add("tled", "explicit", {.method = Method::tled}, false);
  return all;
}

double quantile(std::vector<double> values, double q) {
  std::ranges::sort(values);
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1) + 0.5)];
}

constexpr double poisson_ratio = 0.45;

sim::Scene scene_of(const Row& row, int substeps) {
  sim::Scene scene;
  scene.params<sim::NeoHookean>().emplace_back();
  scene.params<sim::Gravity>().emplace_back();
  if (row.viscous) scene.params<sim::Viscosity>().emplace_back();
  if (row.smoothed) sim::set_element(scene.effects, sim::Element::smoothed, poisson_ratio);
  scene.time.frame_s = 1e-3;
  scene.time.substeps = substeps;
  return scene;
}

// Rows of a CSV, which are printed too.
std::string run(const char* mesh_file) {
  constexpr int substeps = 64;
  const TetMesh mesh = read_vtu(mesh_file);
  std::map<int, sim::Material> materials;
  for (const auto& [label, name] : mesh.label_names) {
    materials[label] = {
        .youngs_modulus = 5e3, .poisson_ratio = poisson_ratio, .density = 1060.0, .damping = 0.01};
  }
  const sim::Model model = make_body(mesh, materials);
  const int rounds = std::clamp(static_cast<int>(1'000'000 / model.tet_count()), 3, 15);
  std::vector<Row> table = rows();
  std::erase_if(table, [&](Row& row) {
    const sim::Scene scene = scene_of(row, substeps);
    try {
      row.solver = row.on_device ? make_on_cuda(model, scene, row.options)
                                 : make_on_cpu(model, scene, row.options);
    } catch (const sim::Refusal&) {  // a block that has no room on the device
      return true;
    }
    return false;
  });
  for (int round = 0; round <= rounds; ++round) {
    for (Row& row : table) {
      const auto begin = std::chrono::steady_clock::now();
      row.solver->advance_frame();
      const std::chrono::duration<double, std::nano> took =
          std::chrono::steady_clock::now() - begin;
      const double work =
          static_cast<double>(model.tet_count()) * substeps * row.options.iterations;
      if (round > 0) row.ns.push_back(took.count() / work);  // the first warms up
    }
  }
  std::map<decltype(table[0].contest()), double> fastest;
  for (const Row& row : table) {
    double& ns = fastest.try_emplace(row.contest(), HUGE_VAL).first->second;
    ns = std::min(ns, quantile(row.ns, 0.5));
  }
  fmt::print("{} tets, {} rounds of {} substeps; ns a tet, substep and iteration\n",
             model.tet_count(), rounds, substeps);
  fmt::print("{:6} {:38} {:5} {:>7} {:>7} {:>15} {:>8} {:>10} {}\n", "method", "scheme", "",
             "threads", "ns", "quartiles", "speed-up", "of fastest", "auto");
  std::string csv;
  double single = 0.0;
  for (const Row& row : table) {
    const double median = quantile(row.ns, 0.5), q1 = quantile(row.ns, 0.25),
                 q3 = quantile(row.ns, 0.75), share = median / fastest[row.contest()];
    if (row.options.threads == 1) single = median;
    const sim::SchemeChoice choice =
        sim::choose_scheme(model, scene_of(row, substeps), row.options, row.on_device);
    const bool chosen = row.options.method == sim::Method::xpbd &&
                        row.options.scheme == choice.scheme && row.options.block_tets == 0;
    const char* precision = row.options.precision == sim::Precision::fp32 ? "fp32" : "fp64";
    const std::string threads = row.on_device ? "cuda" : std::to_string(row.options.threads);
    fmt::print("{:6} {:38} {:5} {:>7} {:7.2f} {:7.2f} {:7.2f} {:8.2f} {:10.2f} {}\n", row.method,
               row.scheme, precision, threads, median, q1, q3, single / median, share,
               chosen ? "yes" : "");
    csv += fmt::format("{},{},\"{}\",{},{},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f},{}\n",
                       model.tet_count(), row.method, row.scheme, precision, threads, median, q1,
                       q3, single / median, share, chosen ? "yes" : "no");
  }
  return csv;
}

}  // namespace
}  // namespace viscera

int main(int argc, char** argv) {
  if (argc < 3) return std::fputs("usage: bench_solver CSV MESH.vtu…\n", stderr), 2;
  std::string csv =
      "tets,method,scheme,precision,threads,ns_per_tet_substep,q1,q3,speedup,of_fastest,auto\n";
  for (int i = 2; i < argc; ++i) {
    csv += viscera::run(argv[i]);
    std::ofstream(argv[1]) << csv;  // what there is, if a later mesh takes too long
  }
}
