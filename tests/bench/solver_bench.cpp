// What a substep costs on this machine: nanoseconds a tet and substep, by method, scheme, precision
// and number of threads, on a mesh of the tetmesh stage. Configurations take turns, round after
// round, so that what else the machine does meets all of them; medians with their quartiles.
//   bench_solver MESH.vtu [CSV]
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <thread>

#include "sim/solvers/make.hpp"
#include "stages/common/tet_io.hpp"
#include "stages/simulate/body.hpp"

namespace viscera {
namespace {

struct Row {
  std::string method, scheme;
  sim::SolverOptions options;
  bool viscous = false;
  std::unique_ptr<sim::Solver> solver = {};
  std::vector<double> ns = {};
};

std::vector<Row> rows() {
  using sim::Method, sim::Precision, sim::Scheme;
  std::vector<Row> all;
  const auto add = [&all](const char* method, const char* scheme, sim::SolverOptions options,
                          bool viscous = false) {
    for (const int threads : {1, 2}) {
      options.threads = threads;
      all.push_back({method, scheme, options, viscous});
    }
  };
  add("xpbd", "gauss_seidel", {});
  add("xpbd", "gauss_seidel", {.precision = Precision::fp64});
  add("xpbd", "gauss_seidel, viscosity", {}, true);
  add("xpbd", "block_gauss_seidel", {.scheme = Scheme::block_gauss_seidel});
  add("xpbd", "jacobi", {.scheme = Scheme::jacobi});
  add("xpbd", "gauss_seidel, 2 iterations", {.iterations = 2});
  add("tled", "explicit", {.method = Method::tled});
  return all;
}

double quantile(std::vector<double> values, double q) {
  std::ranges::sort(values);
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1) + 0.5)];
}

void run(const char* mesh_file, const char* csv_file) {
  constexpr int rounds = 15, substeps = 64;
  const TetMesh mesh = read_vtu(mesh_file);
  std::map<int, sim::Material> materials;
  for (const auto& [label, name] : mesh.label_names) {
    materials[label] = {
        .youngs_modulus = 5e3, .poisson_ratio = 0.45, .density = 1060.0, .damping = 0.01};
  }
  const sim::Model model = make_body(mesh, materials);
  std::vector<Row> table = rows();
  for (Row& row : table) {
    sim::Scene scene;
    scene.params<sim::NeoHookean>().emplace_back();
    scene.params<sim::Gravity>().emplace_back();
    if (row.viscous) scene.params<sim::Viscosity>().emplace_back();
    scene.time.frame_s = 1e-3;
    scene.time.substeps = substeps;
    row.solver = make_on_cpu(model, scene, row.options);
  }
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
  std::string csv = "tets,method,scheme,precision,threads,ns_per_tet_substep,q1,q3,speedup\n";
  fmt::print("{} tets, {} rounds of {} substeps; ns a tet, substep and iteration\n",
             model.tet_count(), rounds, substeps);
  fmt::print("{:6} {:28} {:5} {:>7} {:>7} {:>15} {:>8}\n", "method", "scheme", "", "threads", "ns",
             "quartiles", "speed-up");
  double single = 0.0;
  for (const Row& row : table) {
    const double median = quantile(row.ns, 0.5), q1 = quantile(row.ns, 0.25),
                 q3 = quantile(row.ns, 0.75);
    if (row.options.threads == 1) single = median;
    const char* precision = row.options.precision == sim::Precision::fp32 ? "fp32" : "fp64";
    fmt::print("{:6} {:28} {:5} {:7} {:7.1f} {:7.1f} {:7.1f} {:8.2f}\n", row.method, row.scheme,
               precision, row.options.threads, median, q1, q3, single / median);
    csv += fmt::format("{},{},\"{}\",{},{},{:.2f},{:.2f},{:.2f},{:.3f}\n", model.tet_count(),
                       row.method, row.scheme, precision, row.options.threads, median, q1, q3,
                       single / median);
  }
  if (csv_file) std::ofstream(csv_file) << csv;
}

}  // namespace
}  // namespace viscera

int main(int argc, char** argv) {
  if (argc < 2) return std::fputs("usage: bench_solver MESH.vtu [CSV]\n", stderr), 2;
  viscera::run(argv[1], argc > 2 ? argv[2] : nullptr);
}
