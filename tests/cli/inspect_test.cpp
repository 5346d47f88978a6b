// Commands that look: why, status, graph and where a file comes from. None of them writes anything.
#include <gtest/gtest.h>

#include "pipeline/base/param.hpp"
#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

class Inspect : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(work_.run().exit, 0);
    work_.started();
  }
  std::string out(const std::vector<std::string>& arguments, int exit = 0) const {
    const auto before = work_.snapshot();
    const auto result = work_.viscera(arguments);
    EXPECT_EQ(result.exit, exit) << result.errors;
    EXPECT_EQ(work_.snapshot(), before) << "looking changes nothing";
    return exit == 0 ? result.out : result.errors;
  }
  const Workplace work_;
};

TEST_F(Inspect, WhyShowsOldAndNewAndTellsCauseFromCascade) {
  EXPECT_EQ(out({"why", "spec.yaml", "beta"}), "beta: cached\n");
  EXPECT_EQ(out({"why", "spec.yaml", "beta", "--set", "beta.size=5mm", "--set", "beta.text=x"}),
            "beta: would run: text \"hello\" -> \"x\", size 4 mm -> 5 mm (cause)\n");
  const std::string all = out({"why", "spec.yaml", "--set", "beta.size=5mm"});
  EXPECT_TRUE(contains(all, "alpha: cached\n")) << all;
  EXPECT_TRUE(contains(all, "gamma: would run unless the outputs of beta stay the same (cascade)"))
      << all;
  const std::string unknown = out({"why", "spec.yaml", "bete"}, 2);
  EXPECT_TRUE(contains(unknown, "did you mean 'beta'?")) << unknown;
}

TEST_F(Inspect, WhyOfAFileLeadsBackToWhatNoStageMade) {
  const std::string page = out({"why", "out/spec/page.html"});  // laid out in the run's folder too
  for (const char* part : {"made by gamma 1", "made by beta 1", "size = 4.0 mm", "made by alpha 1",
                           "from volume volume.txt"}) {
    EXPECT_TRUE(contains(page, part)) << part << "\n" << page;
  }
  EXPECT_EQ(count(page, "from volume volume.txt"), 1) << "alpha's story is told once";
  EXPECT_TRUE(contains(out({"why", "out/spec/beta/beta.txt"}), "made by beta 1"));
  EXPECT_TRUE(contains(out({"why", "volume.txt"}, 2), "no manifest there names"));
  EXPECT_TRUE(contains(out({"why", "absent.txt"}, 2), "no such file"));
}

TEST_F(Inspect, AChangedFileIsNotTakenForAResult) {
  std::filesystem::remove(work_.path("out/spec/page.html"));
  work_.write("out/spec/page.html", "edited");
  EXPECT_TRUE(contains(out({"why", "out/spec/page.html"}, 2), "changed, or not a result"));
}

TEST_F(Inspect, StatusSaysWhatIsDoneToDoOrFailed) {
  EXPECT_EQ(count(out({"status", "spec.yaml"}), "done"), 3);
  const std::string open = out({"status", "spec.yaml", "--set", "beta.size=5mm"});
  EXPECT_EQ(count(open, "to do"), 2) << open;
  EXPECT_TRUE(contains(open, "beta: would run: size 4 mm -> 5 mm (cause)")) << open;
  EXPECT_EQ(work_.run({"--set", "beta.text=fail"}).exit, 4);
  work_.started();
  const std::string failed = out({"status", "spec.yaml", "--set", "beta.text=fail"});
  EXPECT_TRUE(contains(failed, "beta: failed with 4: volume.txt: text fail")) << failed;
  EXPECT_EQ(work_.run().exit, 0);
  work_.started();
  EXPECT_EQ(count(out({"status", "spec.yaml"}), "done"), 3) << "a success ends a failure";
}

TEST_F(Inspect, StatusShowsOfEveryResultWhatItTookAndHowItsGatesWent) {
  const std::string done = out({"status", "spec.yaml"});
  EXPECT_EQ(count(done, " MB  "), 3) << done;
  EXPECT_EQ(count(done, " s  "), 3) << done;
  EXPECT_EQ(count(done, "1 passed\n"), 1) << done;
  const std::string open = out({"status", "spec.yaml", "--set", "beta.size=5mm"});
  EXPECT_EQ(count(open, " MB  "), 1) << "of alpha alone is there one\n" << open;
  EXPECT_EQ(count(open, "passed"), 0) << open;
}

TEST_F(Inspect, StatusSaysOfAFailedGateWhatToChange) {
  EXPECT_EQ(work_.run({"--set", "beta.limit=1"}).exit, 5);
  work_.started();
  const std::string text = out({"status", "spec.yaml", "--set", "beta.limit=1"});
  EXPECT_TRUE(contains(text, "beta: gate size: 4 mm, required <= 1 mm\n")) << text;
  EXPECT_TRUE(contains(text, "  remedy:  lower beta.size\n")) << text;
}

TEST_F(Inspect, StatusForProgramsHasGatesFiguresAndFailures) {
  const Json json = Json::parse(out({"status", "spec.yaml", "--json"}));
  EXPECT_EQ(json["cases"][0]["state"], "ok");
  EXPECT_EQ(json["cases"][0]["stages"][1]["gates"][0]["name"], "size");
  EXPECT_EQ(work_.run({"--set", "beta.text=fail"}).exit, 4);
  work_.started();
  const Json failed =
      Json::parse(out({"status", "spec.yaml", "--set", "beta.text=fail", "--json"}));
  EXPECT_EQ(failed["cases"][0]["state"], "failed");
  EXPECT_EQ(failed["cases"][0]["message"], "beta: volume.txt: text fail");
  EXPECT_EQ(failed["cases"][0]["stages"][1]["exit"], 4);
}

TEST_F(Inspect, GraphsAreColouredByState) {
  const std::string mermaid = out({"graph", "spec.yaml", "--set", "beta.size=5mm"});
  for (const char* part : {"flowchart LR", "s0[\"alpha<br/>done\"]:::done", "s0 --> s1",
                           "s1[\"beta<br/>to do\"]:::todo", "gamma<br/>depends", "classDef todo"}) {
    EXPECT_TRUE(contains(mermaid, part)) << part << "\n" << mermaid;
  }
  const std::string dot = out({"graph", "spec.yaml", "--dot"});
  EXPECT_TRUE(contains(dot, "digraph")) << dot;
  EXPECT_TRUE(contains(dot, "s0 -> s1;")) << dot;
  EXPECT_TRUE(contains(dot, "s0 [label=\"alpha\\ndone\", fillcolor=")) << dot;
  const Json json = Json::parse(out({"graph", "spec.yaml", "--json"}));
  EXPECT_EQ(json["jobs"][1]["manifest"], "out/spec/beta/manifest.json");
  EXPECT_EQ(json["jobs"][1]["needs"][0], "out/spec/alpha/manifest.json");
}

TEST_F(Inspect, TheSettingsOfAJobChangeWithWhatItsStageIsTold) {
  const auto settings = [this](const std::vector<std::string>& extra) {
    std::vector<std::string> arguments = {"graph", "spec.yaml", "--json"};
    arguments.insert(arguments.end(), extra.begin(), extra.end());
    const auto result = work_.viscera(arguments);
    std::vector<std::string> digests;
    const Json graph = Json::parse(result.out);
    for (const auto& job : graph["jobs"]) digests.push_back(job["settings"]);
    return digests;
  };
  const auto before = settings({}), after = settings({"--set", "beta.size=5mm"});
  EXPECT_EQ(before[0], after[0]);
  EXPECT_NE(before[1], after[1]);
  EXPECT_EQ(before[2], after[2]);
  work_.write("volume.txt", "other voxels\n");
  EXPECT_NE(settings({})[0], before[0]) << "an input is a setting too";
}

}  // namespace
}  // namespace viscera::test
