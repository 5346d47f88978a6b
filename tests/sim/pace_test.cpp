// When several threads give way to one, and come back. Times are made up: no clock is asked.
#include "sim/backend/cpu/pace.hpp"

#include <gtest/gtest.h>

namespace viscera::sim {
namespace {

// The time of so many substeps where one takes `together` or `alone` seconds.
double run(Pace& pace, int substeps, double together, double alone) {
  double seconds = 0.0;
  for (int left = substeps; left > 0;) {
    const Pace::Stretch stretch = pace.next(left);
    const double took = stretch.substeps * (stretch.alone ? alone : together);
    pace.took(stretch, took);
    seconds += took;
    left -= stretch.substeps;
  }
  return seconds;
}

TEST(Pace, BesideBusyProgramsIsNeverATenthSlowerThanOneThread) {
  Pace pace;
  run(pace, 256, 0.6, 1.0);  // a quiet machine
  constexpr int substeps = 4096;
  EXPECT_LT(run(pace, substeps, 7.5, 1.0), 1.1 * substeps);
}

TEST(Pace, ComesBackToAllThreadsOnAQuietMachine) {
  Pace pace;
  run(pace, 4096, 7.5, 1.0);
  run(pace, 2 * 64 * Pace::longest, 0.6, 1.0);  // until the next trial
  constexpr int substeps = 4096;
  EXPECT_LT(run(pace, substeps, 0.6, 1.0), 0.65 * substeps);
}

}  // namespace
}  // namespace viscera::sim
