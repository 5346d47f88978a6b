// What accuracy costs on a CUDA device: milliseconds a frame against the error of displacement, by
// element, scheme, order of the time step, substeps and size. A body swings under its own weight;
// errors are root mean squares over the vertices, in parts of the displacement's, against
// colour-by-colour Gauss-Seidel in fp64 with many substeps on the same mesh: in motion at half a
// second, held by its thin end, and at rest, held by its thick one, where Newton has it on meshes
// that take him a minute. Beside each time stands what an H200 would need at least (bound_of), by
// the limit that binds.
//   bench_gpu CSV E_kPa NU MESH.vtu…
// and what the members of an ensemble cost, which differ in E, on all devices that there are:
//   bench_gpu ensemble CSV MESH.vtu
// and what a bar costs that one or several devices step together:
//   bench_gpu devices CSV
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "sim/make.hpp"
#include "sim/measures/stability.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/body.hpp"
#include "tests/bench/bodies.hpp"
#include "tests/bench/measured.hpp"

namespace viscera {
namespace {

using sim::Model, sim::Precision, sim::Scheme, sim::State, sim::Vec3;

constexpr int motion_frames = 30;  // of 1/60 s
constexpr int reference_substeps = 512;
constexpr int rest_substeps = 256;  // off by a hundredth of a percent: it falls with their square
constexpr std::size_t max_tets_for_newton = 60'000;

struct Row {
  const char* name;
  sim::SolverOptions options;
  int substeps;
  int order = 2;  // of the time step
};

std::vector<Row> rows() {
  std::vector<Row> all;
  for (const int substeps : {32, 64}) all.push_back({"gauss_seidel", {}, substeps});
  for (const int substeps : {16, 32, 64, 128}) {
    all.push_back({"block_gauss_seidel", {.scheme = Scheme::block_gauss_seidel}, substeps, 1});
  }
  for (const int substeps :
       {14, 15, 16, 17, 18, 20, 21, 22, 24, 26, 27, 28, 30, 32, 34, 36,  37, 38,
        39, 40, 42, 43, 44, 48, 52, 56, 60, 64, 66, 68, 72, 80, 96, 112, 128}) {
    all.push_back({"block_gauss_seidel", {.scheme = Scheme::block_gauss_seidel}, substeps});
  }
  return all;
}

enum class Held {
  thin,   // where x is in its highest tenth, which of a liver is the end of its left lobe
  thick,  // where x is in its lowest fifth
};
Model held_body(const char* file, const sim::Material& material, Held held) {
  const TetMesh mesh = read_vtu(file);
  std::map<int, sim::Material> materials;
  for (const auto& [label, name] : mesh.label_names) materials[label] = material;
  Model model = make_body(mesh, materials);
  const auto [low, high] =
      std::ranges::minmax(model.rest, {}, [](const Vec3<double>& p) { return p.x; });
  for (std::size_t i = 0; i < model.rest.size(); ++i) {
    model.fixed[i] = held == Held::thin ? model.rest[i].x > high.x - 0.1 * (high.x - low.x)
                                        : model.rest[i].x < low.x + 0.2 * (high.x - low.x);
  }
  return model;
}

// Under its own weight along z.
sim::Scene tissue(const Model& model, sim::Element element, int substeps, int order = 2) {
  sim::Scene scene = scene_of(element, model.materials.front().poisson_ratio, substeps);
  scene.params<sim::Gravity>().front() = {};
  scene.time.order = order;
  scene.stability = sim::StabilityPolicy::warn;
  apply_policy(model, scene);  // lays out what smoothed elements are of
  return scene;
}

// Velocities are halved every few frames: near the critical damping of the slowest swing.
State settled(sim::Solver& solver, const State& start, int halvings = 60) {
  State state = start;
  for (int k = 0; k < halvings; ++k) {
    for (auto& v : state.v) v = 0.5 * v;
    solver.set_state(state);
    for (int frame = 0; frame < 4; ++frame) solver.advance_frame();
    state = solver.state();
  }
  return state;
}

State by_newton(const Model& model, sim::Element element) {
  sim::SolverOptions newton{.method = sim::Method::fem};
  newton.fem.time = sim::FemOptions::Time::quasi_static;
  newton.fem.tolerance = 1e-9;
  const auto solver = make_on_cpu(model, tissue(model, element, 1), newton);
  solver->advance_frame();
  return solver->state();
}
State by_settling(const Model& model, sim::Element element) {
  const auto near =
      make_on_cuda(model, tissue(model, element, 96), {.scheme = Scheme::block_gauss_seidel});
  const auto exact =
      make_on_cuda(model, tissue(model, element, rest_substeps), {.precision = Precision::fp64});
  return settled(*exact, settled(*near, near->state(), 240));
}
// Where it hangs still.
State equilibrium(const Model& model, sim::Element element) {
  const bool is_small = model.tet_count() <= max_tets_for_newton;
  State state = is_small ? by_newton(model, element) : by_settling(model, element);
  state.step = 0;
  return state;
}

template <class Advance>
Times time_frames(Advance&& advance, int frames) {
  std::vector<double> ms;
  for (int frame = 0; frame < frames; ++frame) {
    ms.push_back(time_frame(advance));
  }
  return Times::of(ms);
}

struct Bound {
  double us;  // a substep
  const char* by;
};

// The least that an H200 needs for a substep of tets: docs/results/cuda.md has where the numbers
// come from.
Bound bound_of(const sim::SubstepWork& work, std::size_t tets) {
  constexpr double processors = 132, cycles_a_us = 1980;
  constexpr double lanes = 128, close_bytes_a_cycle = 128;  // of a multiprocessor
  constexpr double instructions = 352;                      // a tet, evaluated in place
  constexpr double cache_bytes = 48e6;                      // that are read at its rate
  constexpr double cache_bytes_a_us = 8.0e6, memory_bytes_a_us = 4.4e6;
  constexpr double phase_cycles = 160, meeting_cycles = 1500;  // one element; two trips to L2
  constexpr double launch_us = 0.55;                           // an empty node of a graph
  const double far_rate = work.global_bytes <= cache_bytes ? cache_bytes_a_us : memory_bytes_a_us;
  const double in_order = work.launches > 0
                              ? work.launches * launch_us
                              : (work.phases * phase_cycles + meeting_cycles) / cycles_a_us;
  const std::array<Bound, 4> all{
      {{instructions * static_cast<double>(tets) / (processors * lanes * cycles_a_us),
        "arithmetic"},
       {work.shared_bytes / (processors * close_bytes_a_cycle * cycles_a_us), "shared memory"},
       {work.global_bytes / far_rate, "memory"},
       {in_order, "latency"}}};
  return std::ranges::max(all, {}, &Bound::us);
}

void run(const sim::Material& material, sim::Element element, const char* file, std::string& csv) {
  const char* const name = element == sim::Element::smoothed ? "smoothed" : "linear";
  const Model model = held_body(file, material, Held::thin);
  const Model hanging = held_body(file, material, Held::thick);
  const auto converged = make_on_cuda(model, tissue(model, element, reference_substeps),
                                      {.precision = Precision::fp64});
  for (int frame = 0; frame < motion_frames; ++frame) converged->advance_frame();
  const State reference = converged->state();
  const double size = root_mean_square(reference.u, nullptr);
  const State rest = equilibrium(hanging, element);
  const double sag = root_mean_square(rest.u, nullptr);
  fmt::print("{} {} tets, E {} kPa, nu {}; rms displacement {:.2f} mm, at rest {:.2f} mm\n",
             model.tet_count(), name, material.youngs_modulus / 1e3, material.poisson_ratio,
             1e3 * size, 1e3 * sag);
  for (const Row& row : rows()) {
    const sim::Scene scene = tissue(model, element, row.substeps, row.order);
    const auto made = std::chrono::steady_clock::now();
    const auto solver = make_on_cuda(model, scene, row.options);
    const double setup_s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - made).count();
    const Times times = time_frames([&] { solver->advance_frame(); }, motion_frames);
    const double error = root_mean_square(solver->state().u, &reference.u) / size;
    const auto hung =
        make_on_cuda(hanging, tissue(hanging, element, row.substeps, row.order), row.options);
    const double rest_error = root_mean_square(settled(*hung, rest).u, &rest.u) / sag;
    const double cs = assess(model, scene).cs_max;
    const double us = 1e3 * times.median / row.substeps;
    const sim::SubstepWork work = solver->substep_work();
    const double bytes = work.shared_bytes + work.global_bytes;
    const Bound bound = bound_of(work, model.tet_count());
    const std::string line = fmt::format(
        "{:<18} order {} {:3} substeps {:8.3f} ms a frame ({:.3f}, {:.3f}) {:7.2f} us a substep, "
        "error {:.3f} %, at rest {:.3f} %, Cs {:.2f}, {:6.2f} MB, bound {:6.2f} us by {}, ratio "
        "{:.1f}, "
        "set-up {:.2f} s\n",
        row.name, row.order, row.substeps, times.median, times.q1, times.q3, us, 100.0 * error,
        100.0 * rest_error, cs, 1e-6 * bytes, bound.us, bound.by, us / bound.us, setup_s);
    std::fputs(line.c_str(), stdout);
    std::fflush(stdout);
    csv += fmt::format(
        "{},{},{},{},{},{},{},{:.4f},{:.4f},{:.4f},{:.3f},{:.4f},{:.4f},{:.3f},{:.0f},{:.3f},{},"
        "{:.2f},{:.3f}\n",
        model.tet_count(), name, material.youngs_modulus, material.poisson_ratio, row.name,
        row.order, row.substeps, times.median, times.q1, times.q3, us, 100.0 * error,
        100.0 * rest_error, cs, bytes, bound.us, bound.by, us / bound.us, setup_s);
  }
}

void run_ensembles(const char* file, std::string& csv) {
  // Stiff enough to stay away from the bound on compression, whose frames take far longer.
  const Model model = held_body(file, {20e3, 0.45, 1060.0, 0.0}, Held::thin);
  const auto spread = [](int member, Model& own, sim::Scene&) {
    for (auto& material : own.materials) material.youngs_modulus *= 0.8 + 0.4 * (member % 64) / 64;
  };
  const sim::Scene scene = tissue(model, sim::Element::linear, 64);
  for (const int members : {1, 2, 4, 8, 16, 32, 64, 132, 256, 264}) {
    const auto made = std::chrono::steady_clock::now();
    const auto ensemble = make_ensemble_on_cuda(
        model, scene, {.scheme = Scheme::block_gauss_seidel}, members, spread);
    const double setup_s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - made).count();
    const Times times = time_frames([&] { ensemble->advance_frame(); }, motion_frames);
    const double us = 1e3 * times.median / 64 / members;
    fmt::print(
        "{} tets, {:3} members: {:8.3f} ms a frame ({:.3f}, {:.3f}), {:6.3f} us a member and "
        "substep, set-up {:.2f} s\n",
        model.tet_count(), members, times.median, times.q1, times.q3, us, setup_s);
    csv += fmt::format("{},{},{:.4f},{:.4f},{:.4f},{:.4f},{:.3f}\n", model.tet_count(), members,
                       times.median, times.q1, times.q3, us, setup_s);
  }
}

void run_devices(std::string& csv) {
  const int devices_there = sim::find_cuda_device().count;
  constexpr int substeps = 32, frames = 20;
  for (const int cells_across : {15, 23, 31, 39, 45, 57}) {
    const Model model = sim::make_five_tet_box({0.1, 0.03, 0.03},
                                               {10 * cells_across / 3, cells_across, cells_across},
                                               {100.0, 0.45, 1060.0, 0.0});
    for (int devices = 1; devices <= devices_there; devices *= 2) {
      try {
        const auto solver =
            make_on_cuda(model, tissue(model, sim::Element::linear, substeps),
                         {.scheme = Scheme::block_gauss_seidel, .devices = devices});
        const Times times = time_frames([&] { solver->advance_frame(); }, frames);
        fmt::print(
            "{} tets on {} devices: {:.3f} ms a frame ({:.3f}, {:.3f}), {:.2f} us a substep\n",
            model.tet_count(), devices, times.median, times.q1, times.q3,
            1e3 * times.median / substeps);
        csv += fmt::format("{},{},{},{:.4f},{:.4f},{:.4f}\n", model.tet_count(), devices, substeps,
                           times.median, times.q1, times.q3);
      } catch (const sim::Refusal& refusal) {
        fmt::print("{} tets on {} devices: {}\n", model.tet_count(), devices, refusal.what());
      }
      std::fflush(stdout);
    }
  }
}

}  // namespace
}  // namespace viscera

int main(int argc, char** argv) {
  const bool shares_bodies = argc == 3 && argv[1] == std::string("devices");
  if (argc < 4 && !shares_bodies) {
    return std::fputs(
               "usage: bench_gpu CSV E_kPa NU MESH.vtu...\n"
               "       bench_gpu ensemble CSV MESH.vtu\n"
               "       bench_gpu devices CSV\n",
               stderr),
           2;
  }
  if (shares_bodies) {
    std::string csv = "tets,devices,substeps,frame_ms,q1,q3\n";
    viscera::run_devices(csv);
    std::ofstream(argv[2]) << csv;
    return 0;
  }
  if (argv[1] == std::string("ensemble")) {
    std::string csv = "tets,members,frame_ms,q1,q3,us_per_member_and_substep,setup_s\n";
    viscera::run_ensembles(argv[3], csv);
    std::ofstream(argv[2]) << csv;
    return 0;
  }
  const viscera::sim::Material material{.youngs_modulus = 1e3 * std::atof(argv[2]),
                                        .poisson_ratio = std::atof(argv[3]),
                                        .density = 1060.0,
                                        .damping = 0.0};
  std::string csv =
      "tets,element,E_Pa,nu,scheme,order,substeps,frame_ms,q1,q3,us_per_substep,error_percent,"
      "rest_error_percent,Cs,bytes_per_substep,bound_us,bound_by,ratio,setup_s\n";
  for (int i = 4; i < argc; ++i) {
    for (const auto element : {viscera::sim::Element::linear, viscera::sim::Element::smoothed}) {
      viscera::run(material, element, argv[i], csv);
      std::ofstream(argv[1]) << csv;  // what there is, if a later mesh takes too long
    }
  }
}
