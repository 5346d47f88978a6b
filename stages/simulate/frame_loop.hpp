// Runs a solver frame by frame until the body rests, the time is over or the run diverges. A solver
// on a device works on the next frame while the host judges and writes this one; the frames are the
// same, and one that was begun in vain is dropped.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "sim/measures/energy_watch.hpp"
#include "sim/measures/gap.hpp"
#include "sim/measures/reactions.hpp"
#include "sim/model/probe.hpp"
#include "sim/scene/diagnostics.hpp"
#include "sim/solvers/solver.hpp"
#include "stages/simulate/rest.hpp"
#include "stages/simulate/scene/schedule.hpp"

namespace viscera {

// What a run tells of a frame.
struct ComputedFrame {
  int index = 0;
  double time_s = 0.0;
  sim::Diagnostics now;
  std::size_t contacts = 0;
  std::uint64_t state_hash = 0;
  double step_ms = 0.0;  // wall time of advance_frame, in which a device has finished
  // Of what sim::Reactions names; empty where they are not asked for, in the first frame, and in
  // the last one of a run that diverged.
  std::vector<sim::Resultant> forces = {};
  double handed_on = 0.0;                      // N, sim::Reactions::Found
  std::vector<sim::Vec3<double>> probes = {};  // m, the displacement of each
  std::vector<double> gaps = {};               // m
};

// Wall time beside the steps, s; on a device at the same time as they.
struct Aside {
  double transfer = 0.0;   // of the state from the solver, from a device
  double diagnosis = 0.0;  // energies, volumes, hash
  double writing = 0.0;
};

struct Outcome {
  std::vector<ComputedFrame> frames;  // the first is the start
  bool rested = false;
  double contact_time_s = -1.0;  // first contact; negative: none
  sim::EnergyWatch::Course watch;
  RestCourse rest;            // which conditions of rest hold at the end
  double rest_time_s = -1.0;  // when the body came to rest; negative: it did not
  std::string divergence;     // empty: none
  std::vector<std::pair<std::string, double>> seconds;  // of the solver, by effect
  Aside aside;
  sim::State last;           // the last good state
  sim::State before;         // that of the frame before, empty if there is none
  sim::State most_deformed;  // where the elastic energy was greatest
  // Of the frame with the most inverted tets, as sim::inverted_tets() lists them.
  std::vector<std::pair<double, std::size_t>> most_inverted;
  std::vector<std::string> exerting;  // names of the frames' forces
};

// What is done with the frames, and what they know.
struct FrameOptions {
  // Called for every good frame, the first included.
  std::function<void(const ComputedFrame&, const sim::State&)> keep;
  std::function<void(const Outcome&)> kept = {};  // after it, with all so far
  sim::Method method = sim::Method::xpbd;         // of the solver
  // Says of a frame after the first why the run may not go on from it: a divergence; empty: it may.
  std::function<std::string(const sim::State&)> objects = {};
  bool is_static = false;                      // frames are equilibria
  bool ends_at_rest = true;                    // or with the time
  bool forces = false;                         // whether frames are to know theirs
  double acts_s = 0.0;                         // sim::Reactions
  sim::Reactions::ForcesOfTissue tissue = {};  // where tets are quadratic
  std::vector<sim::Probe> probes = {};
  std::vector<sim::GapProbe> gaps = {};
};

// What is wrong with a frame whatever was before; empty: nothing. `size` of the body, m.
std::string why_diverged(const sim::State& state, const sim::Diagnostics& now, double size);

// Body and scene, with which the solver was made, go through the schedule from its start on.
// `start` holds what an interrupted run had reached; empty: the run begins with the solver's state.
Outcome run_frames(sim::Solver& solver, sim::Model& model, sim::Scene& scene,
                   const Schedule& schedule, const FrameOptions& options, Outcome start = {});

}  // namespace viscera
