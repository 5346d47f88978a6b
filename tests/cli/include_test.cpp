// Specs that go on from others, and variables that come from the environment.
#include <gtest/gtest.h>

#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

namespace fs = std::filesystem;

const char* const base = R"(viscera: 1
vars:
  words: hello
  input: volume.txt
stages:
  alpha:
    in:
      volume: ${input}
  beta: {size: 4mm}
  echo: {text: "${words}"}
)";

class Include : public testing::Test {
 protected:
  Include() {
    fs::create_directories(work_.path("specs/parts"));
    work_.write("specs/parts/volume.txt", "voxels of the part\n");
    work_.write("specs/parts/base.yaml", base);
  }
  CommandResult run(const std::string& spec, const std::vector<std::string>& extra = {},
                    const std::vector<std::string>& environment = {}) {
    work_.write("specs/top.yaml", "viscera: 1\n" + spec);
    return work_.run_spec("specs/top.yaml", extra, environment);
  }
  std::string out(const std::string& file) const { return work_.read("out/top/" + file); }
  void expect_refused(const CommandResult& run, const std::vector<std::string>& says) const {
    EXPECT_EQ(run.exit, 3) << run.errors;
    for (const auto& part : says)
      EXPECT_TRUE(contains(run.errors, part)) << part << "\n" << run.errors;
    EXPECT_FALSE(fs::exists(work_.path("out/top")));
  }

  Workplace work_;
};

TEST_F(Include, ASpecGoesOnFromAnotherAndHasTheLastWord) {
  const auto result =
      run("include: parts/base.yaml\nvars: {words: mine}\nstages:\n  beta: {size: 6mm}\n");
  ASSERT_EQ(result.exit, 0) << result.errors;
  EXPECT_TRUE(contains(out("echo/echo.txt"), "mine"));
  EXPECT_TRUE(contains(out("beta/manifest.json"), "6"));
  EXPECT_TRUE(contains(out("alpha/manifest.json"), "parts/volume.txt"))
      << "a path is relative to the file that names it";
}

TEST_F(Include, OfSeveralTheLaterHasTheLastWordAndInputsAreReplacedRoleByRole) {
  work_.write("specs/other.txt", "other voxels\n");
  work_.write("specs/parts/words.yaml", "viscera: 1\nvars: {words: later}\n");
  const auto result =
      run("include: [parts/base.yaml, parts/words.yaml]\n"
          "stages:\n  alpha:\n    in: {volume: other.txt}\n");
  ASSERT_EQ(result.exit, 0) << result.errors;
  EXPECT_TRUE(contains(out("echo/echo.txt"), "later"));
  EXPECT_TRUE(contains(out("alpha/manifest.json"), "other.txt"));
  EXPECT_FALSE(contains(out("alpha/manifest.json"), "parts/volume.txt"));
}

TEST_F(Include, CasesAreThoseOfTheFileWithTheLastWord) {
  work_.write("specs/parts/many.yaml",
              std::string(base) + "cases:\n  one: {words: first}\n  two: {words: second}\n");
  ASSERT_EQ(run("include: parts/many.yaml\n").exit, 0);
  EXPECT_TRUE(contains(out("two/echo/echo.txt"), "second"));
  ASSERT_EQ(run("include: parts/many.yaml\ncases:\n  three: {words: third}\n").exit, 0);
  EXPECT_TRUE(contains(out("three/echo/echo.txt"), "third"));
}

TEST_F(Include, AFileIncludedTwiceIsReadOnce) {
  work_.write("specs/parts/left.yaml", "viscera: 1\ninclude: base.yaml\nvars: {words: left}\n");
  work_.write("specs/parts/right.yaml", "viscera: 1\ninclude: base.yaml\n");
  ASSERT_EQ(run("include: [parts/left.yaml, parts/right.yaml]\n").exit, 0);
  EXPECT_TRUE(contains(out("echo/echo.txt"), "left")) << "the base does not come back";
}

TEST_F(Include, WhatIsWrongInAnIncludedFileIsNamedThere) {
  work_.write("specs/parts/base.yaml", std::string(base) + "  gamma: {nmae: x}\n");
  expect_refused(run("include: parts/base.yaml\n"), {"specs/parts/base.yaml:11:", "gamma.nmae"});
  work_.write("specs/parts/base.yaml", "viscera: 1\nstage: {}\n");
  expect_refused(run("include: parts/base.yaml\n"),
                 {"specs/parts/base.yaml:2:1", "did you mean 'stages'?"});
  work_.write("specs/parts/base.yaml", "stages: {}\n");
  expect_refused(run("include: parts/base.yaml\n"), {"specs/parts/base.yaml:1:1", "viscera: 1"});
}

TEST_F(Include, FilesOutsideTheSpecsFolderAreRefused) {
  work_.write("outside.yaml", base);
  fs::create_symlink(work_.path("outside.yaml"), work_.path("specs/link.yaml"));
  work_.write("specs/parts/climbs.yaml", "viscera: 1\ninclude: ../../outside.yaml\n");
  for (const std::string name :
       {"../outside.yaml", "link.yaml", "/etc/passwd", "parts/../../outside.yaml"}) {
    expect_refused(run("include: " + name + "\n"), {"specs/top.yaml:2:10", "include", name});
  }
  expect_refused(run("include: parts/climbs.yaml\n"), {"specs/parts/climbs.yaml:2:10"});
}

TEST_F(Include, CirclesAbsentFilesAndTooManyAreRefused) {
  work_.write("specs/parts/base.yaml", "viscera: 1\ninclude: ../top.yaml\n");
  expect_refused(run("include: parts/base.yaml\n"), {"specs/parts/base.yaml:2:10", "circle"});
  expect_refused(run("include: top.yaml\n"), {"specs/top.yaml:2:10", "circle"});
  expect_refused(run("include: parts/absent.yaml\n"), {"specs/top.yaml:2:10", "absent.yaml"});
  expect_refused(run("include: {file: parts/base.yaml}\n"), {"specs/top.yaml:2:10", "list"});
  std::string many = "include: [";
  for (int i = 0; i < 40; ++i) {
    const std::string name = "parts/part" + std::to_string(i) + ".yaml";
    work_.write("specs/" + name, "viscera: 1\n");
    many += name + ", ";
  }
  expect_refused(run(many + "]\n"), {"specs/top.yaml:2:", "at most 32 files"});
}

TEST_F(Include, WithoutAnyStageIsRefused) {
  work_.write("specs/parts/base.yaml", "viscera: 1\nvars: {words: mine}\n");
  expect_refused(run("include: parts/base.yaml\n"), {"specs/top.yaml", "stages", "missing"});
}

TEST_F(Include, AChangeOfAnIncludedFileRunsWhatItTouches) {
  ASSERT_EQ(run("include: parts/base.yaml\n").exit, 0);
  work_.started();
  work_.write("specs/parts/words.yaml", "viscera: 1\nvars: {words: later}\n");
  ASSERT_EQ(run("include: [parts/base.yaml, parts/words.yaml]\n").exit, 0);
  EXPECT_EQ(count(work_.started(), " run"), 1) << "echo alone";
}

TEST_F(Include, AVariableOfTheEnvironmentHasItsValueAndIsAskedForByName) {
  const std::string spec = "include: parts/base.yaml\nvars: {words: \"${env:WORDS}\"}\n";
  ASSERT_EQ(run(spec, {}, {"WORDS=from outside"}).exit, 0);
  EXPECT_TRUE(contains(out("echo/echo.txt"), "from outside"));
  ASSERT_EQ(run(spec, {"--set", "words=said"}, {"WORDS=from outside"}).exit, 0);
  EXPECT_TRUE(contains(out("echo/echo.txt"), "said"));
  fs::remove_all(work_.path("out"));
  expect_refused(run(spec), {"specs/parts/base.yaml:10:", "WORDS", "--set words=VALUE"});
}

TEST_F(Include, APathOfTheEnvironmentIsRelativeToTheCurrentFolder) {
  work_.write("mine.txt", "my voxels\n");
  const std::string spec = "include: parts/base.yaml\nvars: {input: \"${env:SCAN}\"}\n";
  const auto result = run(spec, {}, {"SCAN=mine.txt"});
  ASSERT_EQ(result.exit, 0) << result.errors;
  EXPECT_TRUE(contains(out("alpha/manifest.json"), "mine.txt"));
}

TEST_F(Include, TheEnvironmentIsReadUnderVarsAlone) {
  expect_refused(run("include: parts/base.yaml\nstages:\n  echo: {text: \"${env:HOME}\"}\n"),
                 {"specs/top.yaml:4:", "${env:HOME}", "vars: {NAME:"});
  expect_refused(run("include: parts/base.yaml\nvars: {words: \"at ${env:HOME}\"}\n"),
                 {"specs/top.yaml:3:", "${env:NAME} alone"});
}

}  // namespace
}  // namespace viscera::test
