// Rounds that end as soon as the result is good enough: `adapt` of a spec.
#include <gtest/gtest.h>

#include "pipeline/base/param.hpp"
#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

namespace fs = std::filesystem;

// Three lines a round.
const char* const stages = R"(viscera: 1
vars: {lines: 5}
stages:
  grow: {in: {volume: volume.txt}}
  weigh: {}
)";

class Adapt : public testing::Test {
 protected:
  CommandResult run(const std::string& tail, const std::vector<std::string>& extra = {}) {
    work_.write("many.yaml", stages + tail);
    return work_.run_spec("many.yaml", extra);
  }
  bool has(const std::string& file) const { return fs::exists(work_.path("out/many/" + file)); }

  Workplace work_;
};

TEST_F(Adapt, RoundsFollowOneAnotherUntilOneIsGoodEnoughAndItsExitCounts) {
  const auto result = run("adapt: {lines: \"${lines}\"}\n");
  EXPECT_EQ(result.exit, 0) << result.errors;
  EXPECT_EQ(work_.started(),
            "grow describe\nweigh describe\ngrow run\nweigh run\ngrow run\n"
            "weigh run\n");
  EXPECT_TRUE(has("round=2/weigh/manifest.json"));
  EXPECT_FALSE(has("round=3")) << "what is not needed leaves nothing";
  EXPECT_FALSE(contains(result.out, "round=3")) << result.out;
  EXPECT_FALSE(contains(result.out, ": out/many/round=1")) << "a result that has been replaced";
  EXPECT_TRUE(contains(work_.viscera({"why", "many.yaml"}).out,
                       "round=3/grow: not needed: the round before asks for no other"));
  EXPECT_FALSE(contains(work_.viscera({"status", "many.yaml"}).out, "round=3"));
  EXPECT_EQ(run("adapt: {lines: \"${lines}\"}\n").exit, 0);
  EXPECT_EQ(work_.started(), "") << "nothing changed, nothing runs";
}

TEST_F(Adapt, TheLastRoundHasTheLastWord) {
  EXPECT_EQ(run("adapt: {lines: \"${lines}\", rounds: 3}\n", {"--set", "lines=1000"}).exit, 5);
  EXPECT_TRUE(has("round=3/weigh/manifest.json"));
  EXPECT_FALSE(has("round=3/weigh/weigh.txt")) << "asks for another";
  EXPECT_FALSE(has("round=4"));
}

TEST_F(Adapt, EachCaseHasAsManyRoundsAsItNeedsAndThoseAloneAreToldOf) {
  const auto result =
      run("adapt: {lines: \"${lines}\", rounds: 4}\ncases: {a: {lines: 3}, b: {lines: 9}}\n"
          "gather: {census: {}}\n");
  EXPECT_EQ(result.exit, 0) << result.errors;
  const Json runs = Json::parse(work_.read("out/many/runs.json"));
  std::string cases;
  for (const auto& one : runs.at("cases"))
    cases += one.at("case").get<std::string>() + ": " + one.at("state").get<std::string>() + "\n";
  EXPECT_EQ(cases,
            "a,round=1: ok\nb,round=1: gates failed\nb,round=2: gates failed\nb,round=3: ok\n");
}

TEST_F(Adapt, AFailureEndsTheRounds) {
  const auto result = run("adapt: {lines: 1000}\n", {"--set", "grow.text=fail"});
  EXPECT_EQ(result.exit, 4) << result.errors;
  EXPECT_FALSE(has("round=2"));
}

TEST_F(Adapt, WhatItCannotMeanIsRefused) {
  const auto refused = [this](const std::string& tail) {
    const auto result = run(tail);
    EXPECT_EQ(result.exit, 3) << tail << result.errors;
    return result.errors;
  };
  EXPECT_TRUE(contains(refused("adapt: 2 %\n"), "many.yaml:6:8"));
  EXPECT_TRUE(contains(refused("adapt: {lines: 2, rounds: 0}\n"), "adapt.rounds"));
  EXPECT_TRUE(contains(refused("adapt: {lines: 2}\nrounds: 2\n"), "given beside adapt"));
  work_.write("spec.yaml",
              "viscera: 1\nstages: {alpha: {in: {volume: volume.txt}}}\n"
              "adapt: {total: 2 %}\n");
  EXPECT_TRUE(contains(work_.run().errors, "no stage has the param 'adapt'"));
}

}  // namespace
}  // namespace viscera::test
