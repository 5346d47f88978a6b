// Invariants: a checked build stops at one that does not hold, with its values; others do not
// evaluate it.
#include "sim/base/assert.hpp"

#include <gtest/gtest.h>

#include "sim/base/range.hpp"
#include "sim/model/coloring.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

TEST(Assertions, SayTheirValuesInACheckedBuildAndCostNothingInOthers) {
  int evaluated = 0;
#if defined(VISCERA_CHECKED)
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_DEATH(VISCERA_ASSERT(++evaluated == 2, "vertex " << 7), "does not hold: .*: vertex 7");
  EXPECT_DEATH(part_of({0, 10}, 3, 3), "part 3 of 3 of \\[0, 10\\)");
  EXPECT_DEATH(inverse(Mat3<double>{}), "singular");
  const auto cpu = make_on_cpu(make_cube(1), drop_scene(), {});
  EXPECT_DEATH(cpu->set_state(State{}), "0 and 0 of 8");
  State half = cpu->state();
  half.v.clear();
  EXPECT_DEATH(cpu->set_state(half), "8 and 0 of 8");
  EXPECT_DEATH(lame({.youngs_modulus = 1e3, .poisson_ratio = 0.5}), "nu 0.5");
  EXPECT_DEATH(lame({.youngs_modulus = 1e3, .poisson_ratio = 0.6}), "nu 0.6");
#else
  VISCERA_ASSERT(++evaluated == 2, "vertex " << 7);
#endif
  EXPECT_EQ(evaluated, 0);
}

TEST(Assertions, TellDisjointColoursFromOthers) {
  const std::vector<std::array<int, 2>> chain = {{0, 1}, {1, 2}, {2, 3}};
  const auto disjoint = [&chain](const std::vector<int>& colors) {
    return is_disjoint<2>(group_by_color(colors), chain, 4);
  };
  EXPECT_TRUE(disjoint({0, 1, 0}));
  EXPECT_TRUE(disjoint({0, 1, 2}));
  EXPECT_FALSE(disjoint({0, 0, 1}));
  EXPECT_FALSE(disjoint({1, 0, 0}));
}

}  // namespace
}  // namespace viscera::sim
