// What differs between two runs is told with both values; what is equal is counted.
#include "pipeline/record/diff.hpp"

#include <gtest/gtest.h>

#include "tests/record/sample.hpp"

namespace viscera::engine {
namespace {

TEST(Diff, OfARunAndItselfHasNothing) {
  const Json diff = diff_of(sample_run(), sample_run());
  for (const auto& [part, compared] : diff["parts"].items())
    EXPECT_TRUE(compared["differing"].empty()) << part << compared;
  EXPECT_EQ(diff["parts"]["parameters"]["equal"], 8);
}

TEST(Diff, TellsBothValuesAndTheRelativeChange) {
  FinishedRun other = sample_run();
  other.stages[0].manifest.params["iterations"] = 2;
  for (Metric& metric : other.stages[0].manifest.metrics) {
    if (metric.name == "rest_time") metric.value = 2.31;
  }
  const Json parts = diff_of(sample_run(), other)["parts"];
  ASSERT_EQ(parts["results"]["differing"].size(), 1u) << parts["results"];
  const Json& rest = parts["results"]["differing"][0];
  EXPECT_EQ(rest["name"], "simulate.rest_time");
  EXPECT_EQ(rest["a"], 2.1);
  EXPECT_EQ(rest["b"], 2.31);
  EXPECT_NEAR(rest["change"].get<double>(), 0.1, 1e-12);
  EXPECT_EQ(parts["parameters"]["differing"][0]["name"], "simulate.iterations");
  const std::string text = diff_text(diff_of(sample_run(), other));
  EXPECT_NE(text.find("simulate.rest_time: 2.1 -> 2.31 s (+10 %)"), std::string::npos) << text;
}

TEST(Diff, LeavesOutTimesOfTheMachine) {
  FinishedRun other = sample_run();
  for (Metric& metric : other.stages[0].manifest.metrics) {
    if (metric.machine) metric.value = 99.0;
  }
  EXPECT_TRUE(diff_of(sample_run(), other)["parts"]["results"]["differing"].empty());
}

TEST(Diff, TellsWhatOnlyOneRunHas) {
  FinishedRun other = sample_run();
  other.stages[0].manifest.caveats = {"The cut is a flat cap."};
  other.scene["materials"].erase("tumour");
  const Json parts = diff_of(sample_run(), other)["parts"];
  EXPECT_TRUE(parts["caveats"]["differing"][0]["a"].is_null());
  EXPECT_EQ(parts["scene"]["differing"].size(), 4u) << "E, nu, density and damping";
  EXPECT_TRUE(parts["scene"]["differing"][0]["b"].is_null());
}

TEST(Diff, TellsAGateThatWentTheOtherWay) {
  FinishedRun other = sample_run();
  other.stages[0].manifest.gates[0].value = 3.0;
  const Json gate = diff_of(sample_run(), other)["parts"]["gates"]["differing"][0];
  EXPECT_EQ(gate["a"], "passed");
  EXPECT_EQ(gate["b"], "failed");
}

}  // namespace
}  // namespace viscera::engine
