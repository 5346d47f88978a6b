// What is computed again and what is not, and what the engine says about it.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* all_ran = "alpha run\nbeta run\ngamma run\n";

class Cache : public testing::Test {
 protected:
  Cache() {
    const auto first = work_.run();
    EXPECT_EQ(first.exit, 0) << first.errors;
    EXPECT_TRUE(contains(work_.started(), "alpha run"));
  }

  // The stored object of a stage's output, by the digest in its manifest.
  fs::path object_of(const std::string& stage) const {
    const std::string manifest = work_.read(fmt::format("out/spec/{}/manifest.json", stage));
    const auto outputs = manifest.find("\"outputs\"");
    const auto at = manifest.find("\"sha256\": \"", outputs) + 11;
    const std::string digest = manifest.substr(at, 64);
    return work_.path(fmt::format("out/.cache/objects/{}/{}", digest.substr(0, 2), digest));
  }

  Workplace work_;
};

TEST_F(Cache, TheFirstRunStartsEveryStageOnceAndLaysOutItsFiles) {
  Workplace work;
  const auto first = work.run();
  EXPECT_EQ(first.exit, 0) << first.errors;
  EXPECT_EQ(work.started(),
            std::string("alpha describe\nbeta describe\ngamma describe\n") + all_ran);
  EXPECT_EQ(work.read("out/spec/page.html"), work.read("out/spec/gamma/page.html"));
  EXPECT_TRUE(contains(work.read("out/spec/page.html"), "[draft] page"));
  EXPECT_TRUE(fs::exists(work.path("out/spec/beta/manifest.json")));
  EXPECT_TRUE(contains(first.errors, "alpha: first run"));
  EXPECT_TRUE(contains(first.out, "page: out/spec/page.html"));
}

TEST_F(Cache, ASpecOfOneStageNamesItsFileToo) {
  work_.write("one.yaml", "viscera: 1\nstages:\n  alpha: {in: {volume: volume.txt}}\n");
  const auto one = work_.viscera({"run", "one.yaml"});
  EXPECT_EQ(one.exit, 0) << one.errors;
  EXPECT_TRUE(contains(one.out, "a: out/one/alpha.txt")) << one.out;
}

TEST_F(Cache, ASecondRunStartsNoProcessAndWritesNothing) {
  work_.run();  // digests of files too young to trust are remembered by now, or never
  work_.started();
  const auto before = work_.snapshot();
  const auto second = work_.run();
  EXPECT_EQ(second.exit, 0) << second.errors;
  EXPECT_EQ(work_.started(), "");
  EXPECT_TRUE(contains(second.out, "alpha  cached"));
  auto after = work_.snapshot();
  EXPECT_EQ(before.at("out/spec/page.html"), after.at("out/spec/page.html"));
  EXPECT_EQ(before.at("out/.cache/entries"), after.at("out/.cache/entries"));
  EXPECT_EQ(before.at("out/spec/beta"), after.at("out/spec/beta"));
}

TEST_F(Cache, AChangedParamRunsItsStageAndThoseAfterItAndSaysWhy) {
  const auto run = work_.run({"--set", "beta.size=5mm"});
  EXPECT_EQ(run.exit, 0);
  EXPECT_EQ(work_.started(), "beta run\ngamma run\n");
  EXPECT_TRUE(contains(run.errors, "beta: size 4 mm -> 5 mm (cause)")) << run.errors;
  EXPECT_TRUE(contains(run.errors, "gamma: b changed")) << run.errors;
  EXPECT_TRUE(contains(run.errors, "(cascade)")) << run.errors;
  EXPECT_FALSE(contains(run.errors, "alpha:"));
}

TEST_F(Cache, GoingBackToAnEarlierSettingRunsNothing) {
  work_.run({"--set", "beta.size=5mm"});
  work_.started();
  EXPECT_EQ(work_.run().exit, 0);
  EXPECT_EQ(work_.started(), "");
  EXPECT_TRUE(work_.read("out/spec/beta/beta.txt").ends_with("4"));
}

TEST_F(Cache, CommentsBlanksAndTheOrderOfKeysRunNothing) {
  work_.write("spec.yaml", R"(# a comment
viscera: 1

stages:
  gamma:
    text:   '[draft] page'
  beta: {size: 0.4 cm}   # the same length
  alpha: {in: {volume: volume.txt}}
vars: {input: unused.txt}
)");
  const auto run = work_.run();
  EXPECT_EQ(run.exit, 0) << run.errors;
  EXPECT_EQ(work_.started(), "");
}

TEST_F(Cache, AParamThatIsNotPartOfTheKeyRunsNothing) {
  EXPECT_EQ(work_.run({"--set", "alpha.threads=7"}).exit, 0);
  EXPECT_EQ(work_.started(), "");
}

TEST_F(Cache, AnInputOrAResultThatWasChangedInSecretIsNoticed) {
  const auto change = [](const fs::path& path, const std::string& from, const std::string& to) {
    fs::permissions(path, fs::perms::owner_all);
    const auto time = fs::last_write_time(path);
    std::string text = read_file(path);
    text.replace(text.find(from), from.size(), to);
    std::fstream(path) << text;  // in place: same inode and size
    fs::last_write_time(path, time);
  };
  std::this_thread::sleep_for(std::chrono::milliseconds(2500));
  work_.run();  // by now all digests are remembered
  EXPECT_EQ(work_.started(), "");
  change(work_.path("out/spec/alpha/alpha.txt"), "voxels", "VOXELS");
  const auto run = work_.run();
  EXPECT_TRUE(contains(run.errors, "alpha: cached alpha.txt is damaged")) << run.errors;
  EXPECT_TRUE(contains(work_.read("out/spec/alpha/alpha.txt"), "voxels"));
  work_.started();
  change(work_.path("volume.txt"), "voxels", "pixels");
  EXPECT_EQ(work_.run().exit, 0);
  EXPECT_EQ(work_.started(), all_ran);
  EXPECT_TRUE(contains(work_.read("out/spec/page.html"), "pixels"));
}

TEST_F(Cache, ATouchedInputRunsNothingAndAChangedOneRunsAll) {
  work_.write("volume.txt", "voxels\n");
  work_.run();
  EXPECT_EQ(work_.started(), "");
  work_.write("volume.txt", "other voxels\n");
  const auto run = work_.run();
  EXPECT_EQ(work_.started(), all_ran);
  EXPECT_TRUE(contains(run.errors, "alpha: volume changed (cause)")) << run.errors;
}

TEST_F(Cache, TheDataFileBehindAnImageHeaderCounts) {
  work_.write("body.mhd", "NDims = 3\nElementDataFile = body.raw\n");
  work_.write("body.raw", "0123");
  const std::vector<std::string> input = {"--set", "input=body.mhd"};
  work_.run(input);
  work_.started();
  work_.run(input);
  EXPECT_EQ(work_.started(), "");
  work_.write("body.raw", "0124");
  work_.run(input);
  EXPECT_TRUE(contains(work_.started(), "alpha run"));
}

TEST_F(Cache, ADataFileBehindAHeaderOfAnyNameCounts) {
  work_.write("body.nrrd", "NRRD0004\ndata file: body.raw\n");
  work_.write("body.raw", "0123");
  const std::vector<std::string> input = {"--set", "input=body.nrrd"};
  work_.run(input);
  work_.started();
  work_.write("body.raw", "0124");
  EXPECT_EQ(work_.run(input).exit, 0);
  EXPECT_TRUE(contains(work_.started(), "alpha run"));
}

TEST_F(Cache, AnInputThatChangesAfterTheKeyWasMadeIsNotCachedUnderIt) {
  for (const char* how : {"late_input", "spoil"}) {
    const std::string text = fmt::format("before {}\n", how);
    work_.write("volume.txt", text);
    const auto run = work_.run({}, {std::string("FAKE_alpha=") + how});
    EXPECT_EQ(run.exit, 75) << how << run.errors;
    EXPECT_TRUE(contains(run.errors, "volume.txt")) << run.errors;
    EXPECT_TRUE(fs::is_empty(work_.path("out/.cache/work")));
    work_.write("volume.txt", text);
    work_.started();
    EXPECT_EQ(work_.run().exit, 0);
    EXPECT_EQ(work_.started(), all_ran) << how;
    EXPECT_TRUE(contains(work_.read("out/spec/alpha/alpha.txt"), text));
  }
}

TEST_F(Cache, AResultThatItsStageDisownsServesThisRunOnly) {
  const std::vector<std::string> size = {"--set", "beta.size=6mm"};
  const auto first = work_.run(size, {"FAKE_beta=fickle"});
  EXPECT_EQ(first.exit, 0) << first.errors;
  EXPECT_TRUE(contains(first.errors, "beta: not kept for later runs: the device failed"))
      << first.errors;
  EXPECT_TRUE(work_.read("out/spec/beta/beta.txt").ends_with("6"));
  work_.started();
  EXPECT_EQ(work_.run(size).exit, 0);
  EXPECT_TRUE(contains(work_.started(), "beta run\n"));
  work_.run(size);
  EXPECT_EQ(work_.started(), "");
}

TEST_F(Cache, FiguresOfTheMachineDoNotSpreadToReadersOfTheManifest) {
  const auto metrics = [this] {
    const std::string manifest = work_.read("out/spec/beta/manifest.json");
    return manifest.substr(manifest.find("\"metrics\""));
  };
  const std::string before = metrics();
  fs::remove(object_of("beta"));
  EXPECT_EQ(work_.run().exit, 0);
  EXPECT_NE(metrics(), before);  // its process number
  EXPECT_EQ(work_.started(), "beta run\n");
}

TEST_F(Cache, AnEnvironmentVariableThatAStageHeedsIsPartOfItsKeyWhenSet) {
  const auto run = work_.run({}, {"FAKE_DEVICE="});  // set to nothing is not unset
  EXPECT_EQ(work_.started(), "beta run\n") << run.errors;
  work_.run({}, {"FAKE_DEVICE=1"});
  EXPECT_EQ(work_.started(), "beta run\n");
  work_.run();
  EXPECT_EQ(work_.started(), "");
}

TEST_F(Cache, TheManifestNamesTheKeyOfItsEntry) {
  const std::string manifest = work_.read("out/spec/beta/manifest.json");
  const std::string mark = "\"key\": \"";
  const auto at = manifest.find(mark);
  ASSERT_NE(at, std::string::npos);
  const std::string key = manifest.substr(at + mark.size(), 64);
  EXPECT_TRUE(fs::exists(work_.path("out/.cache/entries/" + key + ".json")));
}

TEST_F(Cache, EqualOutputsStopTheCascade) {
  // Sizes are rounded down in beta's output, and nothing reads beta's manifest here.
  work_.write("spec.yaml",
              "viscera: 1\nstages:\n  alpha: {in: {volume: volume.txt}}\n"
              "  beta: {}\n  echo: {}\n");
  EXPECT_EQ(work_.run().exit, 0);
  work_.started();
  EXPECT_EQ(work_.run({"--set", "beta.size=4.5mm"}).exit, 0);
  EXPECT_EQ(work_.started(), "beta run\n");
}

TEST_F(Cache, AReaderOfTheManifestRunsAgainWhenOnlyAGateMoved) {
  const auto run = work_.run({"--set", "beta.limit=50"});
  EXPECT_EQ(work_.started(), "beta run\ngamma run\n");
  EXPECT_TRUE(contains(run.errors, "gamma: settings or gates behind b changed (cascade)"))
      << run.errors;
}

TEST_F(Cache, ARebuiltStageRunsAgain) {
  fs::remove(work_.path("bin/viscera-beta"));
  fs::copy_file(fs::path(VISCERA_BIN) / "fake_stage", work_.path("bin/viscera-beta"));
  work_.run();
  EXPECT_EQ(work_.started(), "");  // another file of equal content is the same stage
  std::ofstream(work_.path("bin/viscera-beta"), std::ios::app) << "x";
  const auto run = work_.run();
  EXPECT_EQ(work_.started(), "beta describe\nbeta run\n");  // equal output: gamma stays
  EXPECT_TRUE(contains(run.errors, "beta: viscera-beta was rebuilt (cause)")) << run.errors;
}

TEST_F(Cache, ADamagedTruncatedOrMissingObjectIsMadeAgainAndNeverServed) {
  const std::string good = work_.read("out/spec/beta/beta.txt");
  const auto spoil = [this](const std::string& how) {
    const fs::path object = object_of("beta");
    if (how == "missing") {
      fs::remove(object);
      return;
    }
    fs::permissions(object, fs::perms::owner_write, fs::perm_options::add);
    if (how == "truncated") fs::resize_file(object, fs::file_size(object) - 1);
    if (how == "damaged") {
      std::fstream file(object, std::ios::in | std::ios::out);
      file.put('X');
    }
  };
  for (const std::string how : {"damaged", "truncated", "missing"}) {
    spoil(how);
    const auto run = work_.run();
    EXPECT_EQ(run.exit, 0) << how << run.errors;
    EXPECT_EQ(work_.started(), "beta run\n") << how;
    const char* found = how == "missing" ? "is missing" : "is damaged";
    EXPECT_TRUE(contains(run.errors, fmt::format("beta: cached beta.txt {}", found)))
        << how << run.errors;
    EXPECT_EQ(work_.read("out/spec/beta/beta.txt"), good) << how;
    EXPECT_EQ(read_file(object_of("beta")), good) << how;
  }
}

TEST_F(Cache, ADamagedEntryIsMadeAgain) {
  for (const auto& entry : fs::directory_iterator(work_.path("out/.cache/entries"))) {
    std::string text = read_file(entry.path());
    const auto at = text.find("\"wall_s\": ");
    ASSERT_NE(at, std::string::npos);
    text[at + 10] = '7';
    std::ofstream(entry.path()) << text;
  }
  const auto run = work_.run();
  EXPECT_EQ(run.exit, 0);
  EXPECT_EQ(work_.started(), all_ran);
  EXPECT_TRUE(contains(run.errors, "the cache entry is damaged"));
}

TEST_F(Cache, AnOutputThatSomebodyChangedOrRemovedIsLaidOutAgain) {
  fs::remove(work_.path("out/spec/beta/beta.txt"));
  fs::remove(work_.path("out/spec/page.html"));
  work_.write("out/spec/page.html", "edited");
  EXPECT_EQ(work_.run().exit, 0);
  EXPECT_EQ(work_.started(), "");
  EXPECT_TRUE(contains(work_.read("out/spec/page.html"), "[draft] page"));
  EXPECT_TRUE(fs::exists(work_.path("out/spec/beta/beta.txt")));
}

TEST_F(Cache, OneCacheServesSeveralOutputFolders) {
  EXPECT_EQ(work_.run({"--out", "elsewhere", "--cache", "out/.cache"}).exit, 0);
  EXPECT_EQ(work_.started(), "");
  EXPECT_EQ(work_.run({"--out", "third"}, {"VISCERA_CACHE=out/.cache"}).exit, 0);
  EXPECT_EQ(work_.started(), "");
  EXPECT_EQ(work_.read("third/spec/page.html"), work_.read("out/spec/page.html"));
}

TEST_F(Cache, DryRunSaysWhatWouldRunAndLeavesTheTreeAsItIs) {
  const auto before = work_.snapshot();
  const auto dry = work_.run({"--dry-run", "--set", "beta.size=7mm"});
  EXPECT_EQ(dry.exit, 0);
  EXPECT_TRUE(contains(dry.out, "alpha: cached")) << dry.out;
  EXPECT_TRUE(contains(dry.out, "beta: would run: size 4 mm -> 7 mm (cause)")) << dry.out;
  EXPECT_TRUE(contains(dry.out, "gamma: would run unless the outputs of beta stay the same"))
      << dry.out;
  EXPECT_EQ(before, work_.snapshot());
  EXPECT_EQ(work_.started(), "");
}

TEST(DryRun, InAnEmptyFolderMakesNothing) {
  const Workplace work;
  const auto before = work.snapshot();
  const auto dry = work.run({"--dry-run"}, {"FAKE_LOG="});
  EXPECT_EQ(dry.exit, 0) << dry.errors;
  EXPECT_TRUE(contains(dry.out, "alpha: would run: first run")) << dry.out;
  work.started();
  EXPECT_EQ(before, work.snapshot());
}

TEST_F(Cache, UntilStopsEarlyAndFromStartsOver) {
  const auto until = work_.run({"--until", "beta", "--set", "beta.size=6mm"});
  EXPECT_EQ(until.exit, 0);
  EXPECT_EQ(work_.started(), "beta run\n");
  EXPECT_TRUE(contains(until.out, "of an earlier run")) << until.out;
  const auto from = work_.run({"--from", "beta"});
  EXPECT_EQ(work_.started(), "beta run\ngamma run\n");
  EXPECT_TRUE(contains(from.errors, "asked for with --from beta"));
  const auto unknown = work_.run({"--until", "bete"});
  EXPECT_EQ(unknown.exit, 2);
  EXPECT_TRUE(contains(unknown.errors, "did you mean 'beta'?")) << unknown.errors;
}

TEST_F(Cache, RunningAgainNoticesAStageThatIsNotDeterministic) {
  EXPECT_FALSE(contains(work_.run({"--from", "beta"}).errors, "another result"));
  const auto moody = work_.run({"--from", "beta"}, {"FAKE_beta=moody"});
  EXPECT_TRUE(contains(moody.errors, "beta: another result than before")) << moody.errors;
}

TEST_F(Cache, AStageMayTakeFromAFileTheRoleThatItWritesItself) {
  work_.write("foreign.txt", "made elsewhere\n");
  work_.write("import.yaml", "viscera: 1\nstages:\n  refit: {in: {b: foreign.txt}}\n  echo: {}\n");
  const auto first = work_.viscera({"run", "import.yaml"});
  EXPECT_EQ(first.exit, 0) << first.errors;
  work_.started();
  EXPECT_TRUE(contains(work_.read("out/import/refit/refit.txt"), "made elsewhere"));
  EXPECT_TRUE(contains(work_.read("out/import/echo/echo.txt"), "made elsewhere"));
  work_.write("foreign.txt", "made elsewhere, better\n");
  EXPECT_EQ(work_.viscera({"run", "import.yaml"}).exit, 0);
  EXPECT_EQ(work_.started(), "refit run\necho run\n");
  EXPECT_TRUE(contains(work_.read("out/import/echo/echo.txt"), "better"));
}

TEST_F(Cache, AFailedGateIsKeptReportedAgainAndShownByLaterStages) {
  for (const bool first : {true, false}) {
    const auto run = work_.run({"--set", "beta.limit=1"});
    EXPECT_EQ(run.exit, 5) << first;
    EXPECT_EQ(work_.started(), first ? "beta run\ngamma run\n" : "");
    EXPECT_TRUE(contains(run.out, "FAILED: size")) << run.out;
    EXPECT_TRUE(contains(run.errors, "error: ")) << run.errors;
    for (const char* part : {"gate size: 4 mm, required <= 1 mm",
                             "means:   The result is too large.", "remedy:  lower beta.size"})
      EXPECT_TRUE(contains(run.errors, part)) << first << run.errors;
  }
}

TEST_F(Cache, ADivergedStageKeepsItsOutputsAndItsExitCode) {
  for (const bool first : {true, false}) {
    const auto run = work_.run({"--set", "beta.diverge=keep"});
    EXPECT_EQ(run.exit, 7) << first;
    EXPECT_EQ(work_.started(), first ? "beta run\ngamma run\n" : "");
    EXPECT_TRUE(contains(run.out, "DIVERGED")) << run.out;
    EXPECT_TRUE(contains(run.errors, "speed passed all bounds")) << run.errors;
  }
  EXPECT_EQ(work_.run({"--set", "beta.diverge=lose"}).exit, 7);
  EXPECT_FALSE(fs::exists(work_.path("out/spec/beta/beta.txt")));  // of the run before
}

}  // namespace
}  // namespace viscera::test
