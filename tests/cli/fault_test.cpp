// Kills, a full disk, many engines, a cache that cannot be written and clocks that jump: no result
// is ever wrong, the next run goes on by itself, and nothing is left to clean up by hand.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <random>
#include <thread>

#include "pipeline/base/digest.hpp"
#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

// Every object is what its name says.
void expect_sound_objects(const fs::path& cache) {
  for (const auto& file : fs::recursive_directory_iterator(cache / "objects")) {
    if (!file.is_regular_file()) continue;
    EXPECT_EQ(sha256_file(file.path()), file.path().filename().string());
  }
}

// What a whole run leaves in its folder.
std::string page_of(const Workplace& work, const std::string& text) {
  EXPECT_TRUE(contains(work.read("out/spec/alpha/alpha.txt"), text));
  EXPECT_TRUE(contains(work.read("out/spec/beta/beta.txt"), text));
  return work.read("out/spec/page.html");
}

std::vector<pid_t> children(pid_t process) {
  std::ifstream list(fmt::format("/proc/{}/task/{}/children", process, process));
  std::vector<pid_t> found;
  for (pid_t child = 0; list >> child;) found.push_back(child);
  return found;
}

// VISCERA_KILLS sets how often: a few in each test run, 200 for the table in docs/results.
int kills() {
  const char* asked = std::getenv("VISCERA_KILLS");
  return asked ? std::atoi(asked) : 15;
}

TEST(Killed, AtAnyMomentEngineOrStageLeaveNothingWrongAndTheNextRunGoesOn) {
  const Workplace work;
  std::mt19937 random(1);
  ASSERT_EQ(work.run().exit, 0);  // asks the stages for their declarations, as later ones do not
  const auto begin = std::chrono::steady_clock::now();
  ASSERT_EQ(work.run({"--set", "alpha.text=timed"}).exit, 0);
  const auto whole =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin);
  std::uniform_real_distribution<double> moment(0.0, whole.count());
  int killed = 0;
  for (int round = 0; round < kills(); ++round) {
    const std::string text = fmt::format("round {}.", round);
    const std::vector<std::string> settings{"--set", "alpha.text=" + text};
    std::vector<std::string> arguments{"run", "spec.yaml"};
    arguments.insert(arguments.end(), settings.begin(), settings.end());
    const pid_t engine = work.start(arguments);
    std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(moment(random)));
    const auto stages = children(engine);
    const bool stage = round % 2 == 1 && !stages.empty();
    kill(stage ? stages.front() : engine, SIGKILL);
    const int exit = work.finish(engine).exit;
    killed += exit != 0;
    EXPECT_TRUE(exit == 0 || exit == 128 + SIGKILL || exit == 75) << exit;
    expect_sound_objects(work.path("out/.cache"));

    const auto next = work.run(settings);
    ASSERT_EQ(next.exit, 0) << round << next.errors;
    EXPECT_TRUE(contains(page_of(work, text), text));
    EXPECT_TRUE(fs::is_empty(work.path("out/.cache/work")));
  }
  EXPECT_GT(killed, kills() / 5);  // or the test would show little
  EXPECT_EQ(work.viscera({"verify"}).exit, 0);
  EXPECT_EQ(work.viscera({"gc"}).exit, 0);
  EXPECT_TRUE(fs::is_empty(work.path("out/.cache/live")));
  std::printf("%d of %d runs were killed before their end\n", killed, kills());
}

TEST(ManyEngines, EightOnOneSpecComputeEachStageOnceAndAllSucceed) {
  for (const bool one_folder : {true, false}) {
    const Workplace work;
    std::vector<pid_t> engines;
    for (int e = 0; e < 8; ++e) {
      const std::string out = one_folder ? "out" : fmt::format("out{}", e);
      engines.push_back(work.start({"run", "spec.yaml", "--out", out, "--cache", "shared"}));
    }
    for (const pid_t engine : engines) {
      const auto run = work.finish(engine);
      EXPECT_EQ(run.exit, 0) << run.errors;
    }
    const std::string started = work.started();
    for (const char* stage : {"alpha run", "beta run", "gamma run"})
      EXPECT_EQ(count(started, stage), 1) << started;
    if (one_folder) continue;
    for (int e = 1; e < 8; ++e) {
      EXPECT_EQ(work.read(fmt::format("out{}/spec/page.html", e)),
                work.read("out0/spec/page.html"));
    }
  }
}

// A file system of this many kilobytes of its own, below `small`.
CommandResult run_on_small_disk(const Workplace& work, int kilobytes, const std::string& commands) {
  work.write("small.sh", fmt::format("set -e\nmkdir -p small\n"
                                     "mount -t tmpfs -o size={}k none small\n{}\n",
                                     kilobytes, commands));
  std::error_code failure;
  fs::create_symlink("/usr/bin/unshare", work.path("bin/unshare"), failure);
  return work.finish(work.start_program("bin/unshare", {"-rm", "sh", "small.sh"}));
}

// Where the machine lets a test mount a file system of its own.
class SmallDisk : public testing::Test {
 protected:
  void SetUp() override {
    const auto tried = run_on_small_disk(
        work, 64, "mkdir probe\nmount --bind probe probe\nmount -o remount,ro,bind probe");
    if (tried.exit != 0) GTEST_SKIP() << "unshare -rm and mount do not work here: " << tried.errors;
    fs::remove(work.path("probe"));
  }
  const Workplace work;
};
using FullDisk = SmallDisk;
using ReadOnlyCache = SmallDisk;

TEST_F(FullDisk, EndsWithAnErrorAndTheNextRunWithSpaceCompletes) {
  // Sizes from nothing fits to all fits; after each the space is given back and the run goes on.
  int failed = 0;
  for (const int kilobytes : {8, 16, 24, 32, 40, 48, 56, 64, 72, 80, 96, 128}) {
    const auto run =
        run_on_small_disk(work, kilobytes,
                          "code=0\n"
                          "bin/viscera run spec.yaml --out small/out || code=$?\n"
                          "for f in $(find small -path '*objects*' -type f); do\n"
                          "  test $(sha256sum < $f | cut -c-64) = $(basename $f) || echo WRONG $f\n"
                          "done\n"
                          "mount -o remount,size=4m small\n"
                          "bin/viscera run spec.yaml --out small/out >/dev/null || echo STUCK\n"
                          "grep -q draft small/out/spec/page.html || echo EMPTY\n"
                          "bin/viscera verify --out small/out > verified || echo UNSOUND\n"
                          "exit $code");
    SCOPED_TRACE(fmt::format("{} kB: {} {}", kilobytes, run.out, run.errors));
    for (const char* word : {"WRONG", "STUCK", "EMPTY", "UNSOUND"})
      EXPECT_FALSE(contains(run.out, word)) << word;
    if (run.exit == 0) continue;
    ++failed;
    EXPECT_EQ(run.exit, 2);
    EXPECT_TRUE(contains(run.errors, "space")) << "no word on what to do";
  }
  EXPECT_GT(failed, 3);
  EXPECT_LT(failed, 12);
}

TEST_F(FullDisk, StagesNameTheFileThatDidNotFitAndLeaveNone) {
  const std::string labels =
      fmt::format("{}/viscera-labels --quiet --in volume={}", VISCERA_BIN, PHANTOM);
  const std::string surface =
      fmt::format("{}/viscera-surface --quiet --in labels=labels/labels.nrrd", VISCERA_BIN);
  ASSERT_EQ(run_on_small_disk(work, 64, labels + " --out labels").exit, 0);
  for (const auto& [stage, file] :
       {std::pair(labels, "labels.nrrd"), std::pair(surface, "surface.vtp")}) {
    const auto run = run_on_small_disk(
        work, 8,
        fmt::format("code=0\n{} --out small/out || code=$?\nfind small -type f\nexit $code",
                    stage));
    EXPECT_EQ(run.exit, 2) << run.errors;
    EXPECT_EQ(run.out, "");
    EXPECT_TRUE(contains(run.errors, std::string(file) + ": cannot be written")) << run.errors;
    EXPECT_TRUE(contains(run.errors, "space")) << run.errors;
  }
}

TEST_F(ReadOnlyCache, IsAnErrorThatNamesIt) {
  ASSERT_EQ(work.run().exit, 0);
  const auto run = run_on_small_disk(work, 1024,
                                     "mount --bind out/.cache out/.cache\n"
                                     "mount -o remount,ro,bind out/.cache\n"
                                     "exec bin/viscera run spec.yaml --set beta.size=9mm");
  EXPECT_EQ(run.exit, 2) << run.errors;
  EXPECT_TRUE(contains(run.errors, "out/.cache/")) << run.errors;
  EXPECT_TRUE(contains(run.errors, "Read-only")) << run.errors;
  work.started();
  EXPECT_EQ(work.run().exit, 0);
  EXPECT_EQ(work.started(), "");
}

TEST(Clock, JumpsThatPutTimesAheadOrFarBackNeitherHideAChangeNorLoseAResult) {
  const Workplace work;
  ASSERT_EQ(work.run().exit, 0);
  work.started();
  const auto years = std::chrono::hours(24 * 365);
  const auto now = fs::file_time_type::clock::now();
  for (const int by : {+20, -40}) {
    // The clock was wrong when everything was made, and is right again.
    for (const auto& file : fs::recursive_directory_iterator(work.path("out")))
      if (file.is_regular_file()) fs::last_write_time(file.path(), now + by * years);
    fs::last_write_time(work.path("volume.txt"), now + by * years);
    EXPECT_EQ(work.run().exit, 0);
    EXPECT_EQ(work.started(), "") << "an equal result is taken whatever its time";
    // Now the input changes, and so do the times, but backwards.
    work.write("volume.txt", fmt::format("voxels {}\n", by));
    fs::last_write_time(work.path("volume.txt"), now + 2 * by * years);
    EXPECT_EQ(work.run().exit, 0);
    EXPECT_EQ(count(work.started(), " run"), 3);
    EXPECT_TRUE(contains(work.read("out/spec/page.html"), fmt::format("voxels {}", by)));
  }
}

}  // namespace
}  // namespace viscera::test
