// Whether a run has more motion than its scene can give it. Neither is a question to the solver, so
// that every one of them is watched alike, whatever the policy on stability.
//
// Energy. While no effect changes by itself and no hand holds the body, the mechanical energy
//
//   M = kinetic + elastic + gravity + that of beds and branches - work of loads and pressure
//
// can only fall: damping, friction and impacts take from it. It may not rise above the least that
// it has been by more than `energy_share` of the most motion that there has been (kinetic energy
// and what is stored in tets, beds and branches), or by what strains the whole body by a
// thousandth. The share covers what frames and steps leave undecided: the energy at the end of a
// substep. The work of a pressure hangs on how the edge of its patch goes from one frame to the
// next: it is taken along cubics that have the places and velocities of both frames, and M may rise
// by as much as straight lines would make of a difference, too. (On a closed surface, or one whose
// edge is held, there is none.) The phantom that lands (10,246 tets, damped or not, XPBD in every
// order and explicit dynamics) rose by 1.3e-5 of its motion at most.
//
// Speed. Otherwise the energy that comes in is not known. Particles of an elastic body move as fast
// as strain waves times the strain, so that none is faster than
//
//   v = speed_factor (c + v_led + sqrt(2 a s)),   c^2 = (lambda + 2 mu) / rho,
//
// with the largest c of the materials, v_led the speed at which obstacles and prescribed vertices
// move, a the largest acceleration that a force effect gives and s the largest displacement so far:
// the speed of a fall over s.
#pragma once

#include <string>

#include "sim/scene/diagnostics.hpp"
#include "sim/solvers/options.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

class EnergyWatch {
 public:
  static constexpr double energy_share = 0.1;
  static constexpr double speed_factor = 3.0;

  // What it knows of the frames so far.
  struct Course {
    double least = 0.0;         // J, M
    double motion = 0.0;        // J, the most
    double work = 0.0;          // J, of loads and pressure
    double doubt = 0.0;         // J, what of it hangs on the path between frames
    double displacement = 0.0;  // m, the largest
    bool begun = false;         // whether energies are watched yet
  };

  // Refers to model and scene. PBD, whose stiffness is that of its iterations, has no energy.
  EnergyWatch(const Model& model, const Scene& scene, Method method);

  // What is wrong in the frame that ends at `time_s`, empty if nothing is; `before` is the state of
  // the frame before, if there is one.
  std::string judge(const State* before, const State& now, const Diagnostics& sums, double time_s,
                    Course& course) const;

 private:
  template <class Effect>
  using Slot = Prepared<Effect, double>;

  struct Work {
    double sum, doubt;  // J, of loads and pressure, and how much less or more on straight paths
  };

  double stored(const State& now) const;  // J, in beds and branches
  Work work(const State& before, const State& now) const;
  std::string too_fast(const Diagnostics& sums, double time_s, const Course& course) const;

  const Model& model_;
  const Scene& scene_;
  Effects::Slots<Slot> on_;  // only those that are evaluated
  bool has_loads_ = false;   // whether loads or pressure do work
  bool closed_;              // whether energies are known once the loads have ended
  double loads_end_s_;
  double min_energy_;  // J, below which nothing is judged
  double wave_speed_;  // m/s, c
};

}  // namespace viscera::sim
