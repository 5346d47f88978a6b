#include "stages/simulate/estimate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <set>

#include "stages/simulate/pilot_body.hpp"
#include "stages/simulate/reports/error_report.hpp"
#include "stages/simulate/scene/schedule.hpp"
#include "stages/simulate/setup.hpp"
#include "stages/simulate/solver_choice.hpp"

namespace viscera {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

constexpr double trial_s = 1.0;  // of frames; and no fewer than these
constexpr std::size_t fewest_frames = 4;
constexpr double patience_s = 3.0;  // until a small body rests
// Newton's method takes long on large bodies: it is tried on fewer tets. Factorisations of sparse
// matrices of meshes in space take n^2 operations (George and Liu 1981), other work n; between
// 5,000 and 16,000 tets runs took as n^1.3 (linear) to n^1.5 (quadratic).
constexpr double most_fem_tets = 4000.0, fem_growth = 1.5;
// How far frames of a run were off those tried (docs/performance.md).
constexpr double low = 0.8, high = 1.3;
// A frame of a mesh takes longer than one of a box of as many tets, whose edges have as many tets
// around them everywhere: by 1.0 to 1.33 on two livers of 20,000 tets, linear and smoothed.
constexpr double unlike_a_box = 1.2;
// The error bar, on two cores (docs/results/body.md): 4 s at 20,000 tets, 15 at 40,000, 50 at
// 81,000.
constexpr double error_bar_s = 4.0, error_bar_tets = 20e3, error_bar_growth = 1.8;
// Its memory at as many tets, most of it the factor of quadratic tets' matrix, whose entries grow
// with the power 4/3 of a body's vertices (George, "Nested Dissection of a Regular Finite Element
// Mesh", SIAM J. Numer. Anal. 10, 1973, and its like in three dimensions).
constexpr double error_bar_mb = 775.0, error_bar_fill = 4.0 / 3.0;
// Of what frames take in memory, in trajectory.h5; and writing them, a vertex: .3 us on two cores
// of an Intel Xeon, .9 on the host of an H200, where it is most of a frame's time.
constexpr double packed = 0.7, written_s = 0.6e-6;
// Beside what an estimate takes itself: reading meshes and writing trajectories.
constexpr double files_mb = 16.0;

// A box of so many tets rests earlier than an organ of its volume, which rocks and bends more:
// by 2.1 to 3.9 on the phantom and two livers, dropped and held (docs/performance.md).
constexpr double rest_tets = 1000.0, soonest_rest = 1.5, latest_rest = 5.0;

// The body of the run: its own where it is there, or one like it.
struct Pilot {
  SceneFile file;
  sim::Model model;
  Expected body;        // of the run; the model may have fewer tets
  bool is_box = false;  // in place of a mesh
};

// What elements and mesh together were off, as a share of the displacement, of livers and the
// phantom held at one side and bent by their weight, at Poisson's ratio .45: that of the best and
// of the worst body with so many tets, and how it falls with their number (docs/performance.md).
struct UsualError {
  double least, most, tets, falls;
  double with(double tets_now, double end) const { return end * std::pow(tets / tets_now, falls); }
};

UsualError usual_error(sim::Element element) {
  if (element == sim::Element::smoothed) return {0.048, 0.13, 5000.0, 0.53};
  if (element == sim::Element::quadratic) return {0.012, 0.08, 4000.0, 0.67};
  return {0.24, 0.32, 4000.0, 0.33};
}

// How much more it is at another ratio: bars, the phantom and two livers at .3, .45 and .49.
double locking_factor(double nu) {
  if (nu <= 0.45) return std::max(0.65, 1.0 - (0.45 - nu) / 0.15 * 0.35);
  return std::min(2.0, 1.0 + (nu - 0.45) / 0.04);
}

// The usual error of a run, as a share: of the best body and of the worst.
struct ErrorRange {
  double least, most;
  double falls;  // as tets^-falls
};

ErrorRange error_range(const Pilot& pilot) {
  const UsualError usual = usual_error(pilot.file.element.value_or(sim::Element::linear));
  const double factor = locking_factor(pilot.model.largest_poisson_ratio());
  return {factor * usual.with(pilot.body.tets, usual.least),
          factor * usual.with(pilot.body.tets, usual.most), usual.falls};
}

// Of the mesh of another round at most; 0: none is expected.
double next_tets(const StageRun& run, const Pilot& pilot) {
  constexpr double most_growth = 4.0, aimed_at = 0.9;  // as sim::tets_for
  const auto goal = read_adapt(run);
  const double tets = pilot.body.tets;
  if (!goal || goal->last) return 0.0;
  const auto at_most = static_cast<double>(goal->at_most);
  double growth = most_growth;
  if (goal->total) {
    const ErrorRange error = error_range(pilot);
    if (error.most <= *goal->total) return 0.0;
    growth = std::min(growth, std::pow(error.most / (aimed_at * *goal->total), 1.0 / error.falls));
  }
  const double next = std::min(at_most, growth * tets);
  return next > tets ? next : 0.0;
}

std::vector<std::string> words_of(const Pilot& pilot, const sim::Stability& stability,
                                  const sim::SolverOptions& options, const sim::Solver& solver,
                                  double per_frame_s) {
  const sim::Scene& scene = pilot.file.scene;
  const bool is_fem = options.method == sim::Method::fem;
  std::vector<std::string> words = {
      fmt::format("{:.3g} ms a frame{}, on {}; {:.0f} tets", 1e3 * per_frame_s,
                  is_fem ? "" : fmt::format(" of {} substeps", scene.time.substeps),
                  solver.device(), pilot.body.tets)};
  if (options.method == sim::Method::pbd) return words;  // it knows no material
  const ErrorRange error = error_range(pilot);
  words.push_back(fmt::format(
      "elements and mesh: {:.2g} to {:.2g} % off on livers that hang by one side; certify: true "
      "says what it is here",
      100.0 * error.least, 100.0 * error.most));
  if (options.method == sim::Method::xpbd && !pilot.file.scene.has<sim::ShapeMatching>())
    words.push_back(
        fmt::format("solver: at rest {:.2g} % off or less", 100.0 * stability.sweep_error));
  return words;
}

std::set<std::string> regions_of(const sim::Scene& scene) {
  std::set<std::string> names;
  sim::Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (std::derived_from<typename Effect::Params, sim::Selection>) {
      for (const auto& params : std::get<i>(scene.effects))
        if (!params.region.empty()) names.insert(params.region);
    }
  });
  return names;
}

Pilot stand_in(const StageRun& run, SceneFile file, const Expected& body, double tets) {
  sim::Model model = body_of(run, file, pilot_body(body, tets, regions_of(file.scene)));
  return {std::move(file), std::move(model), body, true};
}

Pilot pilot_of(StageRun& run, const Expected& before) {
  const bool is_fem = run.param<std::string>("solver") == "fem";
  if (run.has_input("mesh")) {
    auto [file, mesh, model] = set_up(run);
    const Expected body = expected_of(model);
    if (is_fem && body.tets > most_fem_tets)
      return stand_in(run, std::move(file), body, most_fem_tets);
    return {std::move(file), std::move(model), body};
  }
  return stand_in(run, scene_of(run, run.params().at("change")), before,
                  is_fem ? std::min(before.tets, most_fem_tets) : before.tets);
}

// Seconds of the first frame, in which finite elements find an equilibrium, and of those after it:
// their median.
struct FrameTimes {
  double first = 0.0, others = 0.0;
  double of(double frames) const { return first + std::max(0.0, frames - 1.0) * others; }
};

FrameTimes time_frames(Pilot& pilot, const Schedule& schedule, sim::Solver& solver,
                       FrameOptions frames) {
  std::vector<double> took;  // that of the start before them
  auto last = Clock::now();
  const auto begin = last;
  frames.keep = [&](const ComputedFrame&, const sim::State&) {
    took.push_back(seconds_since(last));
    last = Clock::now();
  };
  frames.objects = [&](const sim::State&) {
    return took.size() > fewest_frames && seconds_since(begin) > trial_s ? "enough was tried" : "";
  };
  run_frames(solver, pilot.model, pilot.file.scene, schedule, frames);
  if (took.size() < 2) return {};
  const double first = took[1];
  took.erase(took.begin(), took.begin() + std::min<std::size_t>(2, took.size() - 1));
  const auto median = took.begin() + took.size() / 2;
  std::ranges::nth_element(took, median);
  return {first, *median};
}

// How many times as many substeps the policy may ask for, whose mesh has one tet as flat as the
// mesher's flattest: smallest altitudes over the cube root of a tet's mean volume were .19 to .34
// without regions and down to .06 with them, on 70 meshes of the phantom and five livers; the box
// has .24.
double more_substeps(const Pilot& pilot, const sim::Stability& stability) {
  if (pilot.file.scene.stability != sim::StabilityPolicy::substeps) return 1.0;
  const double flattest = pilot.body.region_share.empty() ? 0.19 : 0.06;
  const sim::StabilityLimit& limit = stability.limit;
  return std::max(1.0, limit.value / limit.at_most * flattest_of_box / flattest);
}

// Times between which a run ends, s.
struct End {
  double earliest, latest;
};

// A run ends with its time, or as soon as the body rests: a body of few tets is left to.
End end_of(StageRun& run, const Pilot& pilot, const Schedule& schedule,
           const sim::SolverOptions& options) {
  const sim::Scene& scene = pilot.file.scene;
  const double last = scene.time.end_s, least = schedule.loads_end() + scene.rest.hold_s;
  if (least >= last) return {last, last};
  if (options.method == sim::Method::fem) return {least, last};
  // The policy has fitted the pilot's scene to its own tets.
  Pilot small = stand_in(run, scene_of(run, run.params().at("change")), pilot.body,
                         std::min(rest_tets, pilot.body.tets));
  apply_policy(schedule, small.model, small.file.scene, options);
  const auto solver = sim::make_on_cpu(small.model, small.file.scene, options);
  FrameOptions frames = frame_options(run, small.file, small.model, options);
  frames.keep = [](const ComputedFrame&, const sim::State&) {};
  const auto begin = Clock::now();
  frames.objects = [begin](const sim::State&) {
    return seconds_since(begin) > patience_s ? "it has had its time" : "";
  };
  const Outcome outcome = run_frames(*solver, small.model, small.file.scene, schedule, frames);
  if (!outcome.rested) return {least, last};
  const double rests = outcome.frames.back().time_s;
  return {std::min(last, soonest_rest * rests), std::min(last, latest_rest * rests)};
}

}  // namespace

Estimate estimate_simulate(StageRun& run, const Expected& before) {
  Estimate estimate{.expected = before};
  if (!run.has_input("mesh") && before.tets <= 0.0) {
    estimate.words.push_back("neither a mesh nor what it will be is known");
    return estimate;
  }
  const auto begin = Clock::now();
  Pilot pilot = pilot_of(run, before);
  sim::Scene& scene = pilot.file.scene;
  const Schedule schedule(pilot.file);
  const auto [options, why] = solver_choice(run, pilot.model, scene);
  const sim::Stability stability = apply_policy(schedule, pilot.model, scene, options);
  const auto solver = choose_solver(run, pilot.model, scene, options);
  const double setup_s = seconds_since(begin);
  const End end = end_of(run, pilot, schedule, options);
  const FrameTimes tried =
      time_frames(pilot, schedule, *solver, frame_options(run, pilot.file, pilot.model, options));
  const double tets = pilot.body.tets;
  const double growth = tets / static_cast<double>(pilot.model.tet_count());
  const double longer = options.method == sim::Method::fem ? std::pow(growth, fem_growth)
                        : pilot.is_box                     ? unlike_a_box
                                                           : 1.0;
  const bool certifies = run.param<bool>("certify") || run.has_param("adapt");
  const double certify_s =
      certifies ? error_bar_s * std::pow(tets / error_bar_tets, error_bar_growth) : 0.0;
  const double frame_s = scene.time.frame_s;
  const double more = pilot.is_box ? more_substeps(pilot, stability) : 1.0;
  const double fewest = end.earliest / frame_s, most = end.latest / frame_s;
  const double vertices = growth * static_cast<double>(pilot.model.vertex_count());
  const auto seconds = [&](double frames, double substeps) {
    return setup_s + substeps * longer * tried.of(frames) + frames * vertices * written_s +
           certify_s;
  };
  estimate.wall_low_s = low * seconds(fewest, 1.0);
  estimate.wall_high_s = high * seconds(most, more);
  estimate.words = words_of(pilot, stability, options, *solver, longer * tried.others);
  if (run.has_param("accuracy") && !run.has_input("mesh"))
    estimate.words.push_back("accuracy chooses solver and substeps once the mesh is there");
  if (more > 1.0) {
    estimate.words.push_back(fmt::format("up to {:.0f} substeps, as flat as one tet may be",
                                         std::ceil(more * scene.time.substeps)));
  }
  if (end.earliest < end.latest) {
    estimate.words.push_back(
        fmt::format("ends when it rests, at {:.2g} to {:.2g} s", end.earliest, end.latest));
  }
  estimate.expected.next_tets = next_tets(run, pilot);
  const double certify_mb =
      certifies ? error_bar_mb * std::pow(tets / error_bar_tets, error_bar_fill) : 0.0;
  estimate.memory_mb = used_mb() + files_mb + certify_mb;
  estimate.expected.tets = tets;
  estimate.expected.trajectory_mb = 1e-6 * packed * most * 3.0 * sizeof(float) * vertices;
  return estimate;
}

}  // namespace viscera
