// What gc removes and what it leaves, and what verify finds.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <thread>

#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

namespace fs = std::filesystem;

class Upkeep : public testing::Test {
 protected:
  Upkeep() { make(4), make(5), make(6); }

  void make(int size) {
    EXPECT_EQ(work_.run({"--set", fmt::format("beta.size={}mm", size)}).exit, 0);
  }

  // Puts back when a result of this stage was last used; returns their number.
  int age(const std::string& stage, double days) {
    int found = 0;
    for (const auto& entry : fs::directory_iterator(work_.path("out/.cache/entries"))) {
      if (!contains(read_file(entry.path()), "\"stage\": \"" + stage + "\"")) continue;
      const auto back = std::chrono::duration_cast<fs::file_time_type::duration>(
          std::chrono::duration<double>(days * 86400.0));
      fs::last_write_time(entry.path(), fs::file_time_type::clock::now() - back);
      ++found;
    }
    return found;
  }
  std::size_t files(const std::string& folder) const {
    std::size_t count = 0;
    for (const auto& entry : fs::recursive_directory_iterator(work_.path("out/.cache/" + folder)))
      count += entry.is_regular_file();
    return count;
  }
  std::uintmax_t bytes() const {  // of results and what they name
    std::uintmax_t total = 0;
    for (const char* folder : {"entries", "objects"})
      for (const auto& file :
           fs::recursive_directory_iterator(work_.path(std::string("out/.cache/") + folder)))
        if (file.is_regular_file()) total += file.file_size();
    return total;
  }
  CommandResult gc(const std::vector<std::string>& options) const {
    std::vector<std::string> all = {"gc"};
    all.insert(all.end(), options.begin(), options.end());
    return work_.viscera(all);
  }

  Workplace work_;
};

TEST_F(Upkeep, GcRemovesWhatWasNotUsedForLongAndTheObjectsThatOnlyThatNamed) {
  EXPECT_EQ(files("entries"), 7u);  // alpha once, beta and gamma three times each
  EXPECT_EQ(age("beta", 40.0), 3);
  const auto before = files("objects");
  const auto found = gc({"--max-age", "30d"});
  EXPECT_EQ(found.exit, 0) << found.errors;
  EXPECT_TRUE(contains(found.out, "removed 3 of 7 results")) << found.out;
  EXPECT_EQ(files("entries"), 4u);
  EXPECT_LT(files("objects"), before);
  work_.started();
  make(6);
  EXPECT_EQ(work_.started(), "beta run\n");  // equal output: gamma's result is taken as it is
}

TEST_F(Upkeep, GcKeepsToItsSizeTheLongestUnusedFirstAndATakenResultIsAsNew) {
  age("beta", 3.0), age("gamma", 3.0), age("alpha", 3.0);
  make(5);  // takes alpha and its beta and gamma
  const auto found = gc({"--max-size", std::to_string(bytes() * 6 / 10)});
  EXPECT_EQ(found.exit, 0) << found.errors;
  work_.started();
  make(5);
  EXPECT_EQ(work_.started(), "");
  make(6);
  EXPECT_NE(work_.started(), "");
}

TEST_F(Upkeep, TheSizeThatGcKeepsToIsThatOfResultsAndObjectsToTheByte) {
  EXPECT_TRUE(contains(gc({"--max-size", std::to_string(bytes())}).out, "removed 0 of 7 results"));
  const auto found = gc({"--max-size", std::to_string(bytes() - 1)});
  EXPECT_TRUE(contains(found.out, "removed 1 of 7 results")) << found.out;
}

TEST_F(Upkeep, ADryRunOfGcSaysTheSameAndLeavesTheTreeAsItIs) {
  age("gamma", 40.0);
  const auto before = work_.snapshot();
  const auto dry = gc({"--max-age", "30d", "--dry-run"});
  EXPECT_EQ(dry.exit, 0) << dry.errors;
  EXPECT_TRUE(contains(dry.out, "would remove 3 of 7 results")) << dry.out;
  EXPECT_EQ(before, work_.snapshot());
  EXPECT_TRUE(contains(gc({"--max-age", "30d"}).out, "removed 3 of 7 results"));
}

TEST_F(Upkeep, GcNeverTouchesWhatALiveRunTookOrMade) {
  work_.started();
  // Takes alpha's result, makes beta's and hangs in gamma.
  const pid_t engine =
      work_.start({"run", "spec.yaml", "--set", "beta.size=7mm"}, {"FAKE_gamma=hang"});
  work_.wait_until_started("gamma run");
  for (const char* stage : {"alpha", "beta", "gamma"}) age(stage, 400.0);
  const auto found = gc({"--max-age", "1d", "--max-size", "0"});
  EXPECT_EQ(found.exit, 0) << found.errors;
  EXPECT_TRUE(contains(found.out, "removed 6 of 8 results")) << found.out;
  EXPECT_TRUE(contains(found.out, "1 live run: 2 results stay")) << found.out;
  EXPECT_EQ(files("entries"), 2u);
  EXPECT_EQ(files("objects"), 2u);
  EXPECT_FALSE(fs::is_empty(work_.path("out/.cache/work")));  // where gamma works
  kill(engine, SIGKILL);
  work_.finish(engine);
  work_.started();
  make(7);
  EXPECT_EQ(work_.started(), "gamma run\n");
  EXPECT_TRUE(contains(gc({"--max-size", "0"}).out, "removed 3 of 3 results"));
  EXPECT_EQ(files("objects") + files("entries") + files("locks") + files("live"), 0u);
  make(7);
}

TEST_F(Upkeep, GcWhileEnginesRunLosesThemNothing) {
  std::vector<pid_t> engines;
  for (int round = 0; round < 6; ++round) {
    for (const char* out : {"one", "two"}) {
      engines.push_back(work_.start({"run", "spec.yaml", "--out", out, "--cache", "out/.cache",
                                     "--set", fmt::format("alpha.text=round {}", round)}));
    }
    EXPECT_EQ(gc({"--max-size", "0"}).exit, 0);
    while (!engines.empty()) {
      const auto run = work_.finish(engines.back());
      EXPECT_EQ(run.exit, 0) << run.errors;
      engines.pop_back();
    }
    for (const char* out : {"one", "two"}) {
      EXPECT_TRUE(contains(work_.read(std::string(out) + "/spec/page.html"),
                           fmt::format("round {}", round)));
    }
  }
}

TEST_F(Upkeep, GcSweepsWhatKilledRunsLeftBehind) {
  fs::create_directories(work_.path("out/.cache/objects/aa"));
  work_.write("out/.cache/objects/aa/" + std::string(64, 'a'),
              "of a result that never was entered");
  work_.write("out/.cache/entries/.half.json.1-0", "{");
  work_.write("out/.cache/live/1-0", std::string(64, 'a') + "\n");  // held by nobody
  const auto before = files("objects");
  EXPECT_TRUE(contains(gc({}).out, "removed 0 of 7 results"));
  EXPECT_EQ(files("objects"), before - 1);
  EXPECT_EQ(files("entries"), 7u);
  EXPECT_EQ(files("live"), 0u);
}

TEST_F(Upkeep, TimesAheadOfTheClockCountAsNow) {
  EXPECT_EQ(age("beta", -4000.0), 3);
  EXPECT_TRUE(contains(gc({"--max-age", "1d"}).out, "removed 0 of 7 results"));
}

TEST_F(Upkeep, VerifyFindsWhatNoTimeStampBetrays) {
  EXPECT_TRUE(contains(work_.viscera({"verify"}).out, "all sound"));
  const std::string good = work_.read("out/spec/beta/beta.txt");
  const fs::path file = work_.path("out/spec/beta/beta.txt");  // a link to the object
  const auto time = fs::last_write_time(file);
  fs::permissions(file, fs::perms::owner_write, fs::perm_options::add);
  work_.write("out/spec/beta/beta.txt", std::string(good.size(), 'X'));
  fs::last_write_time(file, time);  // as decay on a disk would look
  const auto found = work_.viscera({"verify"});
  EXPECT_EQ(found.exit, 4) << found.out;
  EXPECT_TRUE(contains(found.out, "1 damaged, 1 incomplete")) << found.out;
  EXPECT_TRUE(contains(found.errors, "beta")) << found.errors;
  work_.started();
  make(6);
  EXPECT_EQ(work_.started(), "beta run\n");
  EXPECT_EQ(work_.read("out/spec/beta/beta.txt"), good);
  EXPECT_EQ(work_.viscera({"verify"}).exit, 0);
}

TEST_F(Upkeep, WithoutACacheBothSaySo) {
  for (const char* command : {"gc", "verify"}) {
    const auto found = work_.viscera({command, "--out", "elsewhere"});
    EXPECT_EQ(found.exit, 2);
    EXPECT_TRUE(contains(found.errors, "elsewhere/.cache: no cache")) << found.errors;
    EXPECT_FALSE(fs::exists(work_.path("elsewhere")));
  }
}

}  // namespace
}  // namespace viscera::test
