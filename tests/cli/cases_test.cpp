// One spec, many runs: cases, sweeps, what they share, and the stages that gather them.
#include <gtest/gtest.h>

#include <algorithm>

#include "pipeline/base/param.hpp"
#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

namespace fs = std::filesystem;

const char* const head = R"(viscera: 1
vars:
  words: hello
stages:
  alpha: {in: {volume: volume.txt}}
  beta: {size: 4mm}
  echo: {text: "${words}"}
)";

class Cases : public testing::Test {
 protected:
  CommandResult run(const std::string& tail, const std::vector<std::string>& extra = {},
                    const std::vector<std::string>& environment = {}) {
    work_.write("many.yaml", head + tail);
    return work_.run_spec("many.yaml", extra, environment);
  }
  std::size_t starts(const std::string& stage) {
    const std::string text = started_ = work_.started();
    std::size_t count = 0, at = 0;
    while ((at = text.find(stage + " run", at)) != std::string::npos) ++count, ++at;
    return count;
  }
  std::string out(const std::string& file) const { return work_.read("out/many/" + file); }

  Workplace work_;
  std::string started_;
};

TEST_F(Cases, HaveFoldersOfTheirOwnAndShareWhatIsEqual) {
  const auto result = run("cases:\n  one: {words: first}\n  two: {words: second}\n  plain:\n");
  ASSERT_EQ(result.exit, 0) << result.errors;
  EXPECT_EQ(out("one/echo/echo.txt").substr(0, 6), "first\n");
  EXPECT_EQ(out("two/echo/echo.txt").substr(0, 7), "second\n");
  EXPECT_EQ(out("plain/echo.txt").substr(0, 6),
            "hello\n");  // the last stage's, in the case's folder
  EXPECT_EQ(out("one/beta/beta.txt"), out("two/beta/beta.txt"));
  const std::string log = work_.started();
  for (const char* once : {"alpha run", "beta run"}) {
    EXPECT_EQ(log.find(once), log.rfind(once)) << log;
  }
  EXPECT_NE(log.find("echo run"), log.rfind("echo run"));
  EXPECT_EQ(run("cases:\n  one: {words: first}\n  two: {words: second}\n  plain:\n").exit, 0);
  EXPECT_EQ(work_.started().find(" run"), std::string::npos) << "nothing changed, nothing runs";
}

TEST_F(Cases, ASweepTakesEveryValueByEveryValueInItsOrder) {
  const auto result = run("sweep:\n  words: [a, b]\n  beta.size: [2mm, 3 mm]\n");
  ASSERT_EQ(result.exit, 0) << result.errors;
  for (const char* name :
       {"words=a,size=2mm", "words=a,size=3mm", "words=b,size=2mm", "words=b,size=3mm"}) {
    EXPECT_TRUE(fs::exists(work_.path(std::string("out/many/") + name + "/echo.txt"))) << name;
  }
  EXPECT_NE(out("words=b,size=3mm/echo.txt").find("3"), std::string::npos);
  EXPECT_EQ(starts("alpha"), 1u);
  const auto count = [this](const std::string& stage) {
    std::size_t n = 0, at = 0;
    while ((at = started_.find(stage + " run", at)) != std::string::npos) ++n, ++at;
    return n;
  };
  EXPECT_EQ(count("beta"), 2u);
  EXPECT_EQ(count("echo"), 4u);
}

TEST_F(Cases, AListOfSweepsFollowsOneAnotherAndMultipliesTheCases) {
  const auto result =
      run("cases:\n  x: {beta.size: 5mm}\nsweep:\n  - {words: [a, b]}\n  - {words: c}\n");
  ASSERT_EQ(result.exit, 0) << result.errors;
  for (const char* name : {"x,words=a", "x,words=b", "x,words=c"}) {
    EXPECT_TRUE(fs::exists(work_.path(std::string("out/many/") + name))) << name;
  }
}

TEST_F(Cases, AGatheringStageReadsWhatEveryCaseMadeAndKnowsTheirNames) {
  const std::string tail =
      "cases:\n  one: {words: first}\n  two: {words: second}\n"
      "gather:\n  many: {text: all}\n";
  const auto result = run(tail);
  ASSERT_EQ(result.exit, 0) << result.errors;
  const std::string text = out("many.txt");
  EXPECT_EQ(text.substr(0, text.find('\n')), "all [\"one\",\"two\"]");
  EXPECT_LT(text.find("first"), text.find("second"));
  EXPECT_EQ(out("many/many.txt"), text);
  EXPECT_EQ(starts("many"), 1u);
  ASSERT_EQ(run(tail, {"--set", "echo.text=same"}).exit, 0);
  EXPECT_EQ(starts("many"), 1u) << "what it gathers has changed";
}

TEST_F(Cases, AGatheringStageIsToldMoreThanASystemCallTakes) {
  const std::string text(200000, 'x');  // as the names of thousands of cases
  const auto result = run("cases:\n  one: {}\n  two: {}\ngather:\n  many: {text: " + text + "}\n");
  ASSERT_EQ(result.exit, 0) << result.errors;
  EXPECT_EQ(out("many.txt").substr(text.size(), 14), " [\"one\",\"two\"]");
}

TEST_F(Cases, AGatheringStageDoesWithoutTheCaseThatMadeNothing) {
  const auto result =
      run("cases:\n  one: {words: first}\n  two: {beta.diverge: lose}\n"
          "gather:\n  many: {}\n");
  EXPECT_EQ(result.exit, 7) << result.errors;
  const std::string text = out("many.txt");
  EXPECT_EQ(text.substr(0, text.find('\n')), "hello [\"one\"]");
}

TEST_F(Cases, AStageThatReadsHowAllOfThemWentIsDoneAsLongAsThatStays) {
  const std::string tail = "cases:\n  one: {words: first}\n  two: {}\ngather:\n  census: {}\n";
  ASSERT_EQ(run(tail).exit, 0);
  const auto why = [this] { return work_.viscera({"why", "many.yaml", "census"}).out; };
  EXPECT_EQ(why(), "census: cached\n");
  work_.write("many.yaml", head + tail + "  many: {}\n");
  EXPECT_EQ(why(), "census: cached\n") << "other stages that gather are no part of it";
  EXPECT_EQ(starts("census"), 1u);
}

TEST_F(Cases, OneOfThemRunsAlone) {
  const std::string tail = "cases:\n  one: {words: first}\n  two: {}\ngather:\n  many: {}\n";
  EXPECT_EQ(run(tail, {"--case", "two"}).exit, 0);
  EXPECT_FALSE(fs::exists(work_.path("out/many/one")));
  EXPECT_FALSE(fs::exists(work_.path("out/many/many")));
  const auto wrong = run(tail, {"--case", "tow"});
  EXPECT_EQ(wrong.exit, 2);
  EXPECT_NE(wrong.errors.find("did you mean 'two'?"), std::string::npos) << wrong.errors;
}

TEST_F(Cases, TheCommandLineHasTheLastWord) {
  EXPECT_EQ(run("cases:\n  one: {words: first}\n", {"--set", "words=mine"}).exit, 0);
  EXPECT_EQ(out("one/echo.txt").substr(0, 5), "mine\n");
}

TEST_F(Cases, ADryRunSaysWhatEachWouldDoAndWritesNothing) {
  const std::string tail = "cases:\n  one: {words: first}\n  two: {}\n";
  ASSERT_EQ(run(tail).exit, 0);
  work_.write("many.yaml", head + tail);
  const auto before = work_.snapshot();
  const auto dry = work_.viscera({"run", "many.yaml", "--dry-run", "--set", "words=new"});
  EXPECT_NE(dry.out.find("one/alpha: cached"), std::string::npos) << dry.out;
  EXPECT_NE(dry.out.find("two/echo: would run: text \"hello\""), std::string::npos) << dry.out;
  auto after = work_.snapshot();
  std::erase_if(after, [](const auto& file) { return file.first == "started.log"; });
  auto expected = before;
  std::erase_if(expected, [](const auto& file) { return file.first == "started.log"; });
  EXPECT_EQ(after, expected);
}

struct BadCases {
  const char* name;
  const char* tail;  // begins at line 8
  std::vector<std::string> says;
};

class CasesRefused : public testing::TestWithParam<BadCases> {};

TEST_P(CasesRefused, WithPlaceAndNothingWritten) {
  const Workplace work;
  work.write("bad.yaml", std::string(head) + GetParam().tail);
  const auto run = work.viscera({"run", "bad.yaml"});
  EXPECT_EQ(run.exit, 3) << run.errors;
  for (const auto& part : GetParam().says) {
    EXPECT_NE(run.errors.find(part), std::string::npos) << part << "\n" << run.errors;
  }
  EXPECT_FALSE(fs::exists(work.path("out/bad")));
}

const std::vector<BadCases> bad = {
    {"NoMap", "cases: [a, b]\n", {"bad.yaml:8:8", "cases", "not a map"}},
    {"FolderName", "cases:\n  ../up: {}\n", {"bad.yaml:9:3", "'../up'"}},
    {"Twice", "cases:\n  a: {}\n  a: {}\n", {"bad.yaml:10:3", "given twice"}},
    {"UnknownVariable",
     "cases:\n  a: {wrods: x}\n",
     {"bad.yaml:9:7", "wrods", "did you mean 'words'?"}},
    {"UnknownStage",
     "cases:\n  a: {betta.size: 3mm}\n",
     {"bad.yaml:9:7", "betta.size", "did you mean 'beta'?"}},
    {"UnknownParam",
     "cases:\n  a: {beta.siz: 3mm}\n",
     {"bad.yaml:9:7", "beta.siz", "did you mean 'size'?"}},
    {"OutOfRange", "sweep:\n  beta.size: [3mm, 30mm]\n", {"bad.yaml:9:20", "1 to 10 mm"}},
    {"NoList", "sweep:\n  beta.size: {a: 3mm}\n", {"bad.yaml:9:14", "not a list of values"}},
    {"EqualNames", "sweep:\n  words: [a/b, ab]\n", {"bad.yaml:9:", "two cases", "'words=ab'"}},
    {"NoRounds", "rounds: 0\n", {"bad.yaml:8:9", "rounds", "1 to 20"}},
    {"RoundsInWords", "rounds: two\n", {"bad.yaml:8:9", "rounds", "'two'"}},
    {"RoundsWithoutAnythingToPassOn",
     "rounds: 2\n",
     {"bad.yaml", "rounds", "no stage reads the role 'size_field'"}},
    {"TooMany",
     "sweep:\n  words: [0,1,2,3,4,5,6,7,8,9]\n  alpha.text: [0,1,2,3,4,5,6,7,8,9]\n"
     "  beta.text: [0,1,2,3,4,5,6,7,8,9]\n  echo.text: [0,1,2,3,4,5,6,7,8,9]\n"
     "  beta.size: [1mm, 2mm]\n",
     {"bad.yaml:13:14", "at most 10000"}},
    {"NamedLikeAGatheringStage",
     "cases:\n  many: {}\ngather:\n  many: {}\n",
     {"bad.yaml:9:3", "'many', which the run itself"}},
    {"NamedLikeAFileOfTheRun",
     "cases:\n  many.txt: {}\ngather:\n  many: {}\n",
     {"bad.yaml:9:3", "'many.txt', which the run itself"}},
    {"GathersIntoOneFile",
     "cases:\n  a: {}\n  b: {}\ngather:\n  loop_one: {in: {c: volume.txt}}\n  refit: {}\n",
     {"refit.in.b", "2 files"}},
};

INSTANTIATE_TEST_SUITE_P(Each, CasesRefused, testing::ValuesIn(bad),
                         [](const auto& instance) { return std::string(instance.param.name); });

}  // namespace
}  // namespace viscera::test
