// Stages and engines that fail, hang, lie or are killed: the exit code, the message, and a cache
// that the next run can go on from.
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <thread>

#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

namespace fs = std::filesystem;

// Nothing of an unfinished stage may be left where a later run could take it for a result.
void expect_intact(const Workplace& work) {
  EXPECT_TRUE(fs::is_empty(work.path("out/.cache/work")));
  EXPECT_FALSE(fs::exists(work.path("out/spec/beta/manifest.json")));
  const auto next = work.run();
  EXPECT_EQ(next.exit, 0) << next.errors;
  EXPECT_EQ(work.started(), "beta run\ngamma run\n");  // alpha was kept
}

struct Misdeed {
  const char* how;
  int exit;
  const char* message;
};

class StageFails : public testing::TestWithParam<Misdeed> {};

TEST_P(StageFails, ItsExitCodePassesThroughWithOneMessageAndTheNextRunGoesOn) {
  const Workplace work;
  const auto run = work.run({}, {std::string("FAKE_beta=") + GetParam().how});
  EXPECT_EQ(run.exit, GetParam().exit) << run.errors;
  EXPECT_EQ(count(run.errors, GetParam().message), 1) << run.errors;
  EXPECT_EQ(count(run.errors, "error:"), 1) << run.errors;
  EXPECT_EQ(run.out, "");
  work.started();
  expect_intact(work);
}

INSTANTIATE_TEST_SUITE_P(Each, StageFails,
                         testing::Values(Misdeed{"fail", 4, "volume.txt: too odd"},
                                         Misdeed{"crash", 1, "signal 6"},
                                         Misdeed{"killed", 75, "was killed"},
                                         Misdeed{"exit42", 1, "exit code 42"},
                                         Misdeed{"no_manifest", 1, "left no manifest.json"},
                                         Misdeed{"lie_garbage", 1, "manifest.json"},
                                         Misdeed{"lie_outside", 1, "is not what the manifest says"},
                                         Misdeed{"lie_link", 1, "is not what the manifest says"},
                                         Misdeed{"lie_digest", 1, "is not what the manifest says"},
                                         Misdeed{"lie_size", 1, "is not what the manifest says"},
                                         Misdeed{"lie_missing", 1, "is not what the manifest says"},
                                         Misdeed{"lie_name", 1, "speaks of stage 'alpha'"},
                                         Misdeed{"lie_exit", 1, "with exit 5"},
                                         Misdeed{"lie_inputs", 1, "leaves out inputs"},
                                         Misdeed{"undeclared", 1, "not declared"},
                                         Misdeed{"undeclared_gate", 1, "gate unknown"}),
                         [](const auto& instance) { return std::string(instance.param.how); });

TEST(StageOutput, GarbageOnStderrIsShownWithoutItsControlCharacters) {
  const Workplace work;
  const auto run = work.run({}, {"FAKE_beta=garbage"});
  EXPECT_EQ(run.exit, 0) << run.errors;
  EXPECT_TRUE(contains(run.errors, "beta: [31mnot json")) << run.errors;
  EXPECT_FALSE(contains(run.errors, "\x1b"));
}

TEST(StageOutput, AFloodOfItIsBoundedAndDoesNotStopTheRun) {
  const Workplace work;
  const auto run = work.run({"--quiet"}, {"FAKE_beta=flood"});
  EXPECT_EQ(run.exit, 0) << run.errors.substr(0, 500);
}

TEST(StageOutput, AProcessThatAStageLeftBehindIsNotWaitedFor) {
  const Workplace work;
  const auto begin = std::chrono::steady_clock::now();
  const auto run = work.run({}, {"FAKE_beta=orphan"});
  EXPECT_EQ(run.exit, 0) << run.errors;
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(20));
}

TEST(StageOutput, WhatAStageChangesOutsideItsFolderIsNoticedAndMadeAgain) {
  const Workplace work;
  EXPECT_EQ(work.run({}, {"FAKE_gamma=tamper"}).exit, 75);  // gamma reads what it changed
  work.started();
  const auto next = work.run();
  EXPECT_EQ(next.exit, 0) << next.errors;
  EXPECT_TRUE(contains(next.errors, "alpha: cached alpha.txt is damaged")) << next.errors;
  EXPECT_FALSE(contains(work.read("out/spec/alpha/alpha.txt"), "tampered"));
  EXPECT_FALSE(contains(work.read("out/spec/page.html"), "tampered"));
}

TEST(StageOutput, QuietShowsWarningsOnly) {
  const Workplace work;
  const auto run = work.run({"--quiet"});
  EXPECT_EQ(run.exit, 0);
  EXPECT_EQ(run.out, "");
  EXPECT_FALSE(contains(run.errors, "first run"));
  EXPECT_TRUE(contains(run.errors, "alpha: warning: alpha is only a fake"));
}

TEST(Interrupt, SigintStopsTheStageAndExits130WithTheCacheIntact) {
  const Workplace work;
  const pid_t engine = work.start({"run", "spec.yaml"}, {"FAKE_beta=hang"});
  work.wait_until_started("beta run");
  kill(engine, SIGINT);
  const auto run = work.finish(engine);
  EXPECT_EQ(run.exit, 130) << run.errors;
  EXPECT_TRUE(contains(run.errors, "interrupted")) << run.errors;
  work.started();
  expect_intact(work);
}

TEST(Interrupt, AKilledEngineTakesItsStageWithItAndTheNextRunGoesOn) {
  const Workplace work;
  const pid_t engine = work.start({"run", "spec.yaml"}, {"FAKE_beta=hang"});
  work.wait_until_started("beta run");
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  kill(engine, SIGKILL);
  EXPECT_EQ(work.finish(engine).exit, 128 + SIGKILL);
  work.started();
  EXPECT_FALSE(fs::exists(work.path("out/spec/beta/manifest.json")));
  const auto next = work.run();
  EXPECT_EQ(next.exit, 0) << next.errors;
  EXPECT_EQ(work.started(), "beta run\ngamma run\n");
  EXPECT_TRUE(fs::is_empty(work.path("out/.cache/work")));  // what was left has been swept
}

TEST(Scratch, OfAnInterruptedStageIsGivenToTheNextEqualRunAndGoesWithItsResult) {
  const Workplace work;
  const std::vector<std::string> half = {"FAKE_beta=half"};
  EXPECT_EQ(work.run({}, half).exit, 75);
  EXPECT_EQ(work.run({"--set", "beta.size=5mm"}, half).exit, 75) << "that of another key";
  const auto next = work.run({}, half);
  EXPECT_EQ(next.exit, 0) << next.errors;
  EXPECT_TRUE(contains(next.errors, "goes on from its half")) << next.errors;
  const auto left = fs::directory_iterator(work.path("out/.cache/scratch"));
  EXPECT_EQ(std::distance(begin(left), end(left)), 1) << "the other's";
  EXPECT_EQ(work.viscera({"gc"}).exit, 0);
  EXPECT_TRUE(fs::is_empty(work.path("out/.cache/scratch")));
}

TEST(TwoEngines, RunEachStageOnceAndOneSaysWhomItWaitsFor) {
  for (const char* second_out : {"out", "other"}) {  // the run's lock, and the key's lock
    const Workplace work;
    const std::vector<std::string> slow = {"FAKE_alpha=slow", "FAKE_beta=slow"};
    const pid_t first = work.start({"run", "spec.yaml", "--cache", "shared"}, slow);
    work.wait_until_started("alpha run");
    const pid_t second =
        work.start({"run", "spec.yaml", "--cache", "shared", "--out", second_out}, slow);
    const auto one = work.finish(first), two = work.finish(second);
    EXPECT_EQ(one.exit, 0) << one.errors;
    EXPECT_EQ(two.exit, 0) << two.errors;
    const std::string started = work.started();
    for (const char* stage : {"alpha run", "beta run", "gamma run"}) {
      EXPECT_EQ(count(started, stage), 1) << started;
    }
    EXPECT_TRUE(contains(two.errors, "waits for process " + std::to_string(first))) << two.errors;
    const bool same_folder = second_out == std::string("out");
    EXPECT_EQ(contains(two.errors, "(run spec)"), same_folder) << two.errors;
    EXPECT_EQ(work.read(std::string(second_out) + "/spec/page.html"),
              work.read("out/spec/page.html"));
  }
}

TEST(Folders, AnOutOrCacheThatCannotBeMadeIsAUsageErrorNamingIt) {
  const Workplace work;
  const auto out = work.run({"--out", "volume.txt/out", "--cache", "cache"});
  EXPECT_EQ(out.exit, 2) << out.errors;
  EXPECT_TRUE(contains(out.errors, "volume.txt/out")) << out.errors;
  const auto cache = work.run({"--cache", "volume.txt/cache"});
  EXPECT_EQ(cache.exit, 2) << cache.errors;
  EXPECT_TRUE(contains(cache.errors, "volume.txt/cache")) << cache.errors;
  EXPECT_EQ(count(work.started(), " run"), 0);
}

struct BadCommand {
  const char* name;
  std::vector<std::string> arguments;
  std::vector<std::string> says;
};

std::ostream& operator<<(std::ostream& out, const BadCommand& bad) {
  return out << bad.name;
}

class CommandLine : public testing::TestWithParam<BadCommand> {};

TEST_P(CommandLine, ThatCannotBeMeantIsAUsageErrorBeforeAnyStageRuns) {
  const Workplace work;
  const auto end = work.viscera(GetParam().arguments);
  EXPECT_EQ(end.exit, 2) << end.errors;
  for (const auto& part : GetParam().says) {
    EXPECT_TRUE(contains(end.errors + end.out, part)) << end.errors;
  }
  EXPECT_EQ(work.started(), "");
}

INSTANTIATE_TEST_SUITE_P(
    Each, CommandLine,
    testing::ValuesIn(std::vector<BadCommand>{
        {"MistypedCommand", {"rnu", "spec.yaml"}, {"'run'"}},
        {"NoTime", {"run", "spec.yaml", "--timeout", "0"}, {"--timeout", "above 0"}},
        {"TimeBelowZero", {"run", "spec.yaml", "--timeout=-1h"}, {"--timeout", "above 0"}},
        {"AgeBelowZero", {"gc", "--max-age=-1d"}, {"--max-age", "0 or more"}},
        {"EmptyOut", {"run", "spec.yaml", "--out", ""}, {"--out", "empty"}},
        {"SetTwice",
         {"run", "spec.yaml", "--set", "input=volume.txt", "--set", "input=other.txt"},
         {"--set input", "twice"}},
    }),
    [](const auto& each) { return each.param.name; });

TEST(CommandLine, TellsTheVersion) {
  const auto end = Workplace().viscera({"--version"});
  EXPECT_EQ(end.exit, 0);
  EXPECT_TRUE(end.out.starts_with("viscera 0.")) << end.out;
}

// 200,000 levels: enough to exhaust the stack of a reader without a bound.
const std::string& deep_json() {
  static const std::string text = std::string(200000, '[') + std::string(200000, ']');
  return text;
}

TEST(DeepJson, AsACacheEntryIsMadeAgainAndVerifyRemovesIt) {
  const Workplace work;
  ASSERT_EQ(work.run().exit, 0);
  const auto spoil = [&work] {
    for (const auto& entry : fs::directory_iterator(work.path("out/.cache/entries"))) {
      fs::permissions(entry.path(), fs::perms::owner_all);
      write_atomically(entry.path(), deep_json());
    }
  };
  spoil();
  work.started();
  const auto again = work.run();
  EXPECT_EQ(again.exit, 0) << again.errors;
  EXPECT_EQ(count(work.started(), " run"), 3);
  spoil();
  EXPECT_NE(work.viscera({"verify"}).exit, 139);
  EXPECT_TRUE(fs::is_empty(work.path("out/.cache/entries")));
  EXPECT_EQ(work.viscera({"gc"}).exit, 0);
}

TEST(ForeignManifest, InTheOutFolderIsReplacedAndNothingElseThere) {
  for (const std::string& text : {std::string(R"({"outputs": ["notes.txt", 7, {"path": 3}]})"),
                                  std::string(R"({"outputs": [{"path": "../notes.txt"}]})"),
                                  std::string("[1, 2]"), deep_json()}) {
    const Workplace work;
    work.write("notes.txt", "mine");
    fs::create_directories(work.path("out/alpha"));
    work.write("out/alpha/notes.txt", "mine too");
    work.write("out/alpha/manifest.json", text);
    const auto end = work.finish(work.start_program(
        "bin/viscera-alpha", {"run", "--in", "volume=volume.txt", "--out", "out/alpha"}));
    EXPECT_EQ(end.exit, 0) << end.errors;
    EXPECT_EQ(work.read("notes.txt") + work.read("out/alpha/notes.txt"), "minemine too");
    EXPECT_TRUE(contains(work.read("out/alpha/manifest.json"), "\"stage\": \"alpha\""));
  }
}

TEST(StageByHand, ArgumentsFromADeviceAndAParameterTwiceAreRefused) {
  const Workplace work;
  const auto alpha = [&work](const std::vector<std::string>& arguments) {
    return work.finish(work.start_program("bin/viscera-alpha", arguments));
  };
  const auto device = alpha({"run", "--arguments", "/dev/zero"});
  EXPECT_EQ(device.exit, 4) << device.errors;
  EXPECT_TRUE(contains(device.errors, "/dev/zero")) << device.errors;
  const auto twice = alpha(
      {"run", "--in", "volume=volume.txt", "--out", "new", "--set", "text=a", "--set", "text=b"});
  EXPECT_EQ(twice.exit, 2) << twice.errors;
  EXPECT_TRUE(contains(twice.errors, "twice")) << twice.errors;
  EXPECT_FALSE(fs::exists(work.path("new")));
}

TEST(StageByHand, ARefusedInputOrAFailureLeavesNoFolder) {
  const Workplace work;
  const auto alpha = [&work](const std::string& volume, const std::string& how) {
    return work.finish(work.start_program(
        "bin/viscera-alpha", {"run", "--in", "volume=" + volume, "--out", "new/folder"},
        {"FAKE_alpha=" + how}));
  };
  const auto device = alpha("/dev/zero", "");
  EXPECT_EQ(device.exit, 4) << device.errors;
  EXPECT_TRUE(contains(device.errors, "/dev/zero")) << device.errors;
  EXPECT_FALSE(fs::exists(work.path("new")));
  EXPECT_EQ(alpha("volume.txt", "fail").exit, 4);
  EXPECT_FALSE(fs::exists(work.path("new")));
  EXPECT_EQ(alpha("volume.txt", "").exit, 0);
  EXPECT_TRUE(fs::exists(work.path("new/folder/manifest.json")));
}

TEST(SpecialFiles, AsAnInputOfASpecAreRefusedAtOnce) {
  const Workplace work;
  const auto run = work.run({"--set", "input=/dev/zero"});
  EXPECT_EQ(run.exit, 4) << run.errors;
  EXPECT_TRUE(contains(run.errors, "/dev/zero")) << run.errors;
}

TEST(Describe, AStageThatDoesNotDeclareItselfIsNamed) {
  const Workplace work;
  const auto run = work.run({}, {"FAKE_beta=no_describe"});
  EXPECT_EQ(run.exit, 1);
  EXPECT_TRUE(contains(run.errors, "viscera-beta describe")) << run.errors;
}

}  // namespace
}  // namespace viscera::test
