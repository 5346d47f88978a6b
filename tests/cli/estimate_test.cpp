// `viscera estimate`: what a run would take, from what its stages say of themselves.
#include <gtest/gtest.h>

#include "pipeline/base/json_value.hpp"
#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

class EstimateCommand : public testing::Test {
 protected:
  // The answer as JSON; the command must have written nothing.
  Json of(const std::string& spec, const std::vector<std::string>& extra = {}) const {
    std::vector<std::string> words = {"estimate", spec, "--json"};
    words.insert(words.end(), extra.begin(), extra.end());
    const auto before = files();
    const CommandResult result = work_.viscera(words);
    EXPECT_EQ(result.exit, 0) << result.errors;
    EXPECT_TRUE(files() == before) << "estimating changes nothing";
    return Json::parse(result.out);
  }
  // Without the list of stages that were started.
  std::map<std::string, std::string> files() const {
    auto all = work_.snapshot();
    all.erase("started.log");
    return all;
  }
  static std::vector<std::string> states(const Json& answer) {
    std::vector<std::string> all;
    for (const auto& stage : answer.at("stages"))
      all.push_back(stage.at("stage").get<std::string>() + ": " +
                    stage.at("state").get<std::string>());
    return all;
  }

  const Workplace work_;
};

using Words = std::vector<std::string>;

TEST_F(EstimateCommand, EachStageBeginsWithWhatTheOneBeforeExpectsAndTheTimesAreAdded) {
  const Json answer = of("spec.yaml");
  EXPECT_EQ(states(answer), (Words{"alpha: to do", "beta: to do", "gamma: to do"}));
  EXPECT_EQ(answer["stages"][1]["wall_s"].dump(), "[3.0,6.0]") << "as many as alpha expects tets";
  EXPECT_EQ(answer["stages"][1]["words"].dump(), R"(["a is not there yet"])");
  EXPECT_EQ(answer["wall_s"].dump(), "[4.0,8.0]");
  EXPECT_EQ(answer["memory_mb"].get<double>(), 20.0) << "the most of any stage";
  EXPECT_EQ(answer["unknown"].dump(), R"(["gamma"])") << "which has no estimate";
}

TEST_F(EstimateCommand, WhatIsInTheCacheTakesNoTimeAndIsReadByWhatFollows) {
  ASSERT_EQ(work_.run().exit, 0);
  EXPECT_EQ(of("spec.yaml")["wall_s"].dump(), "[0.0,0.0]");
  const Json answer = of("spec.yaml", {"--set", "beta.size=5mm"});
  EXPECT_EQ(states(answer), (Words{"alpha: done", "beta: to do", "gamma: to do"}));
  EXPECT_EQ(answer["stages"][1]["words"].dump(), R"(["a is there"])");
}

TEST_F(EstimateCommand, WhatCasesShareIsCountedOnce) {
  work_.write("sweep.yaml",
              "viscera: 1\nvars: {mm: 4}\nstages:\n  alpha: {in: {volume: volume.txt}}\n"
              "  beta: {size: \"${mm}mm\"}\nsweep: {mm: [4, 5]}\n");
  const Json answer = of("sweep.yaml");
  ASSERT_EQ(answer["stages"].size(), 4u);
  EXPECT_EQ(answer["stages"][2]["state"].get<std::string>(), "made once")
      << "alpha of the second case";
  EXPECT_EQ(answer["stages"][3]["state"].get<std::string>(), "to do");
  EXPECT_EQ(answer["wall_s"][0].get<double>(), 7.0);
}

TEST_F(EstimateCommand, RoundsThatMayFollowCountForTheMostAndEndWhereNoneIsExpected) {
  work_.write("rounds.yaml",
              "viscera: 1\nstages:\n  alpha: {in: {volume: volume.txt}}\n"
              "  grow: {in: {volume: volume.txt}}\n  weigh: {}\nadapt: {lines: 5}\n");
  const Json answer = of("rounds.yaml");  // of 1, 4 and 7 tets
  EXPECT_EQ(
      states(answer),
      (Words{"round=1/alpha: to do", "round=1/grow: to do", "round=1/weigh: to do",
             "round=2/alpha: made once", "round=2/grow: if needed", "round=2/weigh: if needed",
             "round=3/alpha: made once", "round=3/grow: if needed", "round=3/weigh: if needed"}));
  EXPECT_EQ(answer["wall_s"].dump(), "[3.0,8.0]");
}

TEST_F(EstimateCommand, ARoundKnowsWhatToExpectOfAMeshThatIsThere) {
  const std::string rounds = "rounds.yaml";
  work_.write(rounds,
              "viscera: 1\nvars: {lines: 4}\nstages:\n  alpha: {in: {volume: volume.txt}}\n"
              "  grow: {in: {volume: volume.txt}}\n  weigh: {}\nadapt: {lines: \"${lines}\"}\n");
  const Json fresh = of(rounds);  // of 1 and 4 tets
  ASSERT_EQ(work_.viscera({"run", rounds, "--set", "lines=1"}).exit, 0);
  const Json known = of(rounds);
  EXPECT_EQ(known["stages"][1]["state"].get<std::string>(), "done");
  EXPECT_EQ(known["stages"][2]["state"].get<std::string>(), "to do");
  ASSERT_EQ(known["stages"].size(), fresh["stages"].size()) << known.dump(1);
  EXPECT_EQ(known["stages"].back().dump(), fresh["stages"].back().dump());
}

TEST_F(EstimateCommand, ARefusalIsToldWithItsCodeAndTheOthersAreStillAsked) {
  const CommandResult result = work_.viscera({"estimate", "spec.yaml"}, {"FAKE_alpha=fail"});
  EXPECT_EQ(result.exit, 4);
  EXPECT_TRUE(contains(result.errors, "volume.txt: too odd")) << result.errors;
  EXPECT_TRUE(contains(result.out, "refused")) << result.out;
  EXPECT_TRUE(contains(result.out, "beta")) << result.out;
}

TEST_F(EstimateCommand, TheTableNamesWhatItDoesNotKnow) {
  const std::string table = work_.viscera({"estimate", "spec.yaml"}).out;
  EXPECT_TRUE(contains(table, "4.0 s to 8.0 s")) << table;
  EXPECT_TRUE(contains(table, "without gamma, which says nothing")) << table;
}

}  // namespace
}  // namespace viscera::test
