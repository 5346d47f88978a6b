// Whether a team of threads is worth it just now. Where other programs keep the cores busy, a
// thread that is not scheduled holds up all the others at every barrier, and one thread alone is
// many times faster. The results do not depend on it, so each stretch of substeps may be run either
// way: the times of the last stretches decide.
#pragma once

#include <algorithm>

namespace viscera::sim {

class Pace {
 public:
  static constexpr int longest = 16;  // substeps between two decisions

  // A stretch of substeps to run, and how.
  struct Stretch {
    int substeps;
    bool alone;
  };

  // What to do next of the `left` substeps of a frame.
  Stretch next(int left) {
    if (together_ == unknown) return {1, false};
    if (alone_ == unknown) return {1, true};
    if (--until_trial_ < 0) {
      until_trial_ = between_trials;
      return {1, together_ <= alone_};  // the slower one: it may have become the faster
    }
    return {std::min(left, longest), alone_ < together_};
  }

  void took(const Stretch& stretch, double seconds) {
    (stretch.alone ? alone_ : together_) = seconds / stretch.substeps;
  }

 private:
  static constexpr double unknown = -1.0;
  static constexpr int between_trials = 64;      // stretches
  double together_ = unknown, alone_ = unknown;  // seconds a substep
  int until_trial_ = between_trials;
};

}  // namespace viscera::sim
