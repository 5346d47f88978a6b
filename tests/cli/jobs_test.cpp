// Many stages at once: what runs side by side, what goes on after a failure, what is stopped, and
// what a program hears of it.
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <sstream>
#include <thread>

#include "pipeline/base/param.hpp"
#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

namespace fs = std::filesystem;

const char* const three_cases =
    "viscera: 1\nvars: {words: hello, size: 4mm}\nstages:\n"
    "  alpha: {in: {volume: volume.txt}, text: \"${words}\"}\n  beta: {size: \"${size}\"}\n"
    "  echo: {}\ncases:\n"
    "  one: {words: a}\n  two: {words: b}\n  three: {words: c}\n"
    "gather:\n  many: {}\n  census: {}\n";

class Jobs : public testing::Test {
 protected:
  void SetUp() override { work_.write("many.yaml", three_cases); }
  CommandResult run(const std::vector<std::string>& extra,
                    const std::vector<std::string>& environment = {}) const {
    return work_.run_spec("many.yaml", extra, environment);
  }
  const Workplace work_;
};

TEST_F(Jobs, RunSideBySideAndMakeTheSameAsOneAfterTheOther) {
  const auto together = run({"--jobs", "2"}, {"FAKE_alpha=together"});  // each waits for another
  ASSERT_EQ(together.exit, 0) << together.errors;
  const auto alone = run({"--out", "alone"});
  ASSERT_EQ(alone.exit, 0) << alone.errors;
  for (const char* file : {"one/echo.txt", "three/echo.txt", "many/many.txt", "runs.json"}) {
    EXPECT_EQ(work_.read(std::string("out/many/") + file),
              work_.read(std::string("alone/many/") + file));
  }
}

TEST_F(Jobs, OneAfterTheOtherIsTheDefault) {
  EXPECT_EQ(run({}, {"FAKE_alpha=together"}).exit, 1) << "nobody else was at work";
}

TEST_F(Jobs, WhatCasesShareIsMadeOnceAlsoSideBySide) {
  const auto result = run({"--jobs", "4", "--set", "words=same"}, {"FAKE_alpha=slow"});
  ASSERT_EQ(result.exit, 0) << result.errors;
  EXPECT_EQ(count(work_.started(), " run"), 5) << "alpha, beta, echo, many and census";
  EXPECT_EQ(run({"--jobs", "4", "--set", "words=same", "--from", "beta"}).exit, 0);
  EXPECT_EQ(count(work_.started(), " run"), 4) << "asked for again: once, too";
}

TEST_F(Jobs, ShareTheThreadsUnlessTheyAreGiven) {
  ASSERT_EQ(run({"--jobs", "2", "--threads", "3"}).exit, 0);
  EXPECT_TRUE(contains(work_.read("out/many/one/alpha/manifest.json"), "\"threads\": 1"))
      << "what the spec says stands";
  ASSERT_EQ(run({"--set", "alpha.threads=0", "--from", "alpha"}).exit, 0);
  EXPECT_TRUE(contains(work_.read("out/many/one/alpha/manifest.json"), "\"threads\": 0"));
  ASSERT_EQ(run({"--threads", "1", "--set", "alpha.threads=0", "--from", "alpha"}).exit, 0);
  EXPECT_TRUE(contains(work_.read("out/many/one/alpha/manifest.json"), "\"threads\": 1"));
}

TEST_F(Jobs, UseNoMoreThreadsThanTheMachineHasCoresAndSaySo) {
  const unsigned cores = std::thread::hardware_concurrency();
  for (const auto& asked :
       {std::vector<std::string>{"--threads", "1024", "--set", "alpha.threads=0"},
        std::vector<std::string>{"--set", "alpha.threads=1024"}}) {
    auto arguments = asked;
    arguments.insert(arguments.end(), {"--case", "one", "--from", "alpha"});
    const auto result = run(arguments);
    ASSERT_EQ(result.exit, 0) << result.errors;
    const Json manifest = Json::parse(work_.read("out/many/one/alpha/manifest.json"));
    EXPECT_EQ(manifest["params"]["threads"], cores);
    EXPECT_TRUE(contains(result.errors, "threads: 1024 were asked for")) << result.errors;
  }
}

TEST_F(Jobs, OnAGpuAreAsManyAsThereAreGpus) {
  work_.write("gpu.yaml",
              "viscera: 1\nvars: {words: x}\nstages:\n"
              "  device: {in: {volume: volume.txt}, text: \"${words}\"}\n"
              "cases: {a: {words: a}, b: {words: b}}\n");
  const auto run_on = [this](const std::string& gpus, const std::string& how) {
    return work_.viscera({"run", "gpu.yaml", "--jobs", "2", "--gpus", gpus, "--from", "device"},
                         {"FAKE_device=" + how, "CUDA_VISIBLE_DEVICES=4,7"});
  };
  EXPECT_EQ(run_on("2", "together").exit, 0);
  fs::remove(work_.path("met.log"));
  EXPECT_EQ(run_on("1", "together").exit, 1) << "one at a time";
  ASSERT_EQ(run_on("2", "gpu_log").exit, 0);
  const std::string used = work_.read("gpu.log");
  EXPECT_EQ(count(used, "4\n"), 1) << used;
  EXPECT_EQ(count(used, "7\n"), 1) << used;
}

TEST_F(Jobs, AFailureEndsTheRunButNotWhatIsAtWork) {
  const auto result =
      run({"--jobs", "2", "--set", "beta.size=5mm"}, {"FAKE_alpha=fail_first", "FAKE_beta=slow"});
  EXPECT_EQ(result.exit, 4) << result.errors;
  EXPECT_EQ(count(result.errors, "too odd"), 1);
  EXPECT_EQ(result.out, "");
  EXPECT_TRUE(fs::is_empty(work_.path("out/.cache/work")));
}

TEST_F(Jobs, KeepGoingDoesAllThatDoesNotNeedWhatFailed) {
  for (const char* jobs : {"1", "3"}) {
    const auto result = run(
        {"--keep-going", "--jobs", jobs, "--out", jobs, "--set", "words=fail", "--case", "one"});
    EXPECT_EQ(result.exit, 4) << result.errors;
  }
  work_.write("many.yaml", std::string(three_cases)
                               .replace(std::string(three_cases).find("two: {words: b}"), 15,
                                        "two: {words: fail}"));
  const auto result = run({"--keep-going", "--jobs", "2"});
  EXPECT_EQ(result.exit, 4) << result.errors;
  EXPECT_TRUE(contains(result.out, "two/alpha    failed")) << result.out;
  EXPECT_TRUE(contains(result.out, "two/echo     skipped")) << result.out;
  EXPECT_TRUE(fs::exists(work_.path("out/many/three/echo.txt")));
  EXPECT_TRUE(contains(work_.read("out/many/many/many.txt"), "[\"one\",\"three\"]"));
  const Json report = Json::parse(work_.read("out/many/runs.json"));
  EXPECT_EQ(report["cases"][1]["state"], "failed");
  EXPECT_EQ(report["cases"][1]["message"], "alpha: volume.txt: text fail");
  EXPECT_EQ(report["cases"][2]["state"], "ok");
}

TEST_F(Jobs, AStageThatTakesTooLongIsStopped) {
  const auto begin = std::chrono::steady_clock::now();
  const auto result = run({"--timeout", "1s"}, {"FAKE_beta=hang"});
  EXPECT_EQ(result.exit, 75) << result.errors;
  EXPECT_TRUE(contains(result.errors, "one/beta: did not end within 1 s")) << result.errors;
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(20));
  EXPECT_TRUE(fs::is_empty(work_.path("out/.cache/work")));
}

TEST_F(Jobs, AnInterruptStopsAllOfThemAndKeepsWhatIsDone) {
  const pid_t engine = work_.start({"run", "many.yaml", "--jobs", "3"}, {"FAKE_beta=hang"});
  for (int turn = 0; turn < 400; ++turn) {
    if (fs::exists(work_.path("started.log")) && count(work_.read("started.log"), "beta run") == 3)
      break;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  kill(engine, SIGINT);
  const auto result = work_.finish(engine);
  EXPECT_EQ(result.exit, 130) << result.errors;
  EXPECT_TRUE(fs::is_empty(work_.path("out/.cache/work")));
  work_.started();
  EXPECT_EQ(run({}).exit, 0);
  EXPECT_EQ(count(work_.started(), "alpha run"), 0) << "finished before the interrupt";
}

TEST_F(Jobs, OnlyRunsOneStageOnWhatLiesThere) {
  const auto early = run({"--case", "one", "--only", "beta"});
  EXPECT_EQ(early.exit, 2);
  EXPECT_TRUE(contains(early.errors, "no result of one/alpha")) << early.errors;
  EXPECT_EQ(run({"--case", "one", "--only", "alpha"}).exit, 0);
  EXPECT_EQ(run({"--case", "one", "--only", "beta"}).exit, 0);
  EXPECT_EQ(count(work_.started(), " run"), 2);
  EXPECT_EQ(run({"--only", "census"}).exit, 0);
  EXPECT_TRUE(contains(work_.read("out/many/runs.json"), "\"state\": \"unfinished\""));
  EXPECT_EQ(run({"--only", "census", "--until", "beta"}).exit, 2);
}

TEST_F(Jobs, EventsForProgramsAreLinesOfJson) {
  const auto result = run({"--progress", "jsonl", "--set", "beta.limit=1", "--case", "one"});
  EXPECT_EQ(result.exit, 5);
  std::istringstream lines(result.errors);
  std::string kinds;
  int settled = 0, stages = -1;
  for (std::string line; std::getline(lines, line);) {
    const Json json = Json::parse(line, nullptr, false);
    ASSERT_TRUE(json.is_object()) << line;
    if (!json.contains("event")) continue;
    kinds += json["event"].get<std::string>() + " " + json["stage"].get<std::string>() + " " +
             std::to_string(json["exit"].get<int>()) + "\n";
    settled = json["settled"].get<int>();
    stages = json["stages"].get<int>();
  }
  EXPECT_EQ(settled, stages) << "the last of all is among those that have ended";
  EXPECT_EQ(kinds,
            "started alpha 0\nran alpha 0\nstarted beta 0\nran beta 5\nstarted echo 0\nran echo "
            "0\n");
}

TEST_F(Jobs, EventsCountTheStagesThatAreWantedAlone) {
  const auto result = run({"--progress", "jsonl", "--until", "beta", "--case", "one"});
  EXPECT_EQ(result.exit, 0);
  std::istringstream lines(result.errors);
  Json last;
  for (std::string line; std::getline(lines, line);) {
    const Json json = Json::parse(line, nullptr, false);
    if (json.is_object() && json.contains("event")) last = json;
  }
  EXPECT_EQ(last["stage"], "beta");
  EXPECT_EQ(last["settled"], 2);
  EXPECT_EQ(last["stages"], 2);
}

TEST_F(Jobs, PipedProgressIsPlainLines) {
  const auto result = run({});
  EXPECT_TRUE(contains(result.errors, "one/alpha: working  50 %")) << result.errors;
  EXPECT_TRUE(contains(result.errors, "viscera: one/alpha: ended; 1 of 11 stages"))
      << result.errors;
  EXPECT_FALSE(contains(result.errors, "\x1b"));
}

TEST_F(Jobs, TheTimeLeftFollowsFromEarlierRuns) {
  ASSERT_EQ(run({}, {"FAKE_echo=slow"}).exit, 0);
  for (const char* name : {"one", "two", "three"}) {  // as if each had taken 100 s
    const std::string file = std::string("out/many/") + name + "/run.json";
    Json record = Json::parse(work_.read(file));
    record["stages"]["echo"]["wall_s"] = 100.0;
    work_.write(file, record.dump());
  }
  const auto result = run({"--from", "echo", "--case", "one"});
  EXPECT_TRUE(contains(result.errors, "3 of 3 stages")) << result.errors;
  const auto more = run({"--from", "alpha", "--case", "two", "--case", "three"});
  EXPECT_TRUE(contains(more.errors, "two/beta: ended; 2 of 6 stages, about 2 min left"))
      << more.errors;
}

}  // namespace
}  // namespace viscera::test
