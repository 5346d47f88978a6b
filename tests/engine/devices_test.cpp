#include "pipeline/engine/run/devices.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <thread>

namespace viscera::engine {
namespace {

// 0 would mean all of them for each.
TEST(Devices, StagesSideBySideShareTheCoresAndEachHasOneAtLeast) {
  const unsigned cores = std::max(1u, std::thread::hardware_concurrency());
  for (unsigned jobs = 2; jobs <= 2 * cores + 1; ++jobs) {
    const unsigned each = Devices::threads_each(jobs, 0);
    EXPECT_GE(each, 1u) << jobs;
    EXPECT_TRUE(each == 1 || each * jobs <= cores) << jobs;
    EXPECT_GT((each + 1) * jobs, cores) << jobs << ": no core is left over that all could have";
  }
}

TEST(Devices, WhatIsAskedForIsNotSharedAndOneStageHasAllCores) {
  EXPECT_EQ(Devices::threads_each(4, 3), 3u);
  EXPECT_EQ(Devices::threads_each(1, 0), 0u);
}

}  // namespace
}  // namespace viscera::engine
