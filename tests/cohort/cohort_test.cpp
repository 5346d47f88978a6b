// A cohort through Snakemake, on this machine and on a Slurm cluster of one node: one job for each
// case and stage, and a case that fails is a row and stops nobody.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "pipeline/base/param.hpp"
#include "tests/cli/workplace.hpp"
#include "tests/common/needs.hpp"

namespace viscera::test {
namespace {

namespace fs = std::filesystem;

class Cohort : public testing::Test {
 protected:
  void SetUp() override {
    VISCERA_NEEDS(installed("snakemake"), "snakemake is not installed");
    fs::create_directories(work_.path("pipeline"));
    fs::copy(fs::path(VISCERA_ROOT) / "pipeline/cohort", work_.path("pipeline/cohort"),
             fs::copy_options::recursive);
    work_.write("cohort.yaml", R"(viscera: 1
vars: {words: hello}
stages:
  alpha: {in: {volume: volume.txt}}
  beta: {size: 4mm}
  echo: {text: "${words}"}
cases: cohort.csv
gather:
  many: {}
  census: {}
)");
    write_table("two");
    fs::create_symlink("/bin/sh", work_.path("bin/sh"));
  }

  void write_table(const std::string& second) const {
    work_.write("cohort.csv",
                fmt::format("case,words,beta.size\none,first,\ntwo,{},3 mm\nthree,,2mm\n", second));
  }

  // CI: Snakemake then asks a cluster every second, not every ten.
  CommandResult shell(const std::string& command) const {
    return work_.finish(work_.start_program(
        "bin/sh", {"-c", command}, {"XDG_CACHE_HOME=" + work_.path("cache").string(), "CI=true"}));
  }
  std::string snakemake(const std::string& profile, const std::string& more = "") const {
    return fmt::format(
        "snakemake --snakefile pipeline/cohort/Snakefile --profile pipeline/cohort/{} "
        "--config spec=cohort.yaml viscera=bin/viscera {}",
        profile, more);
  }
  // Of each case its state, from what the cohort's report is made of.
  std::string states() const {
    std::string text;
    const Json report = Json::parse(work_.read("out/cohort/runs.json"));
    for (const auto& one : report["cases"]) {
      text += one["case"].get<std::string>() + ": " + one["state"].get<std::string>() + "\n";
    }
    return text;
  }

  Workplace work_;
};

constexpr const char* all_ok = "one: ok\ntwo: ok\nthree: ok\n";

TEST_F(Cohort, RunsEachStageOfEachCaseAndThenNothingUntilARowChanges) {
  const auto first = shell(snakemake("local"));
  ASSERT_EQ(first.exit, 0) << first.out << first.errors;
  EXPECT_EQ(states(), all_ok);
  EXPECT_EQ(work_.read("out/cohort/one/echo/echo.txt").substr(0, 6), "first\n");
  const std::string started = work_.started();
  EXPECT_EQ(count(started, "alpha run"), 1) << "equal stages are made once";
  EXPECT_EQ(count(started, "echo run"), 3);
  const auto second = shell(snakemake("local"));
  EXPECT_EQ(second.exit, 0);
  EXPECT_TRUE(contains(second.errors, "Nothing to be done")) << second.errors;
  write_table("changed");
  const auto third = shell(snakemake("local"));
  EXPECT_EQ(third.exit, 0) << third.errors;
  EXPECT_EQ(count(work_.started(), " run"), 3) << "echo of that case, and what gathers";
  EXPECT_EQ(work_.read("out/cohort/two/echo/echo.txt").substr(0, 8), "changed\n");
}

TEST_F(Cohort, ACaseThatFailsOrIsRefusedIsARowAndStopsNobody) {
  work_.write("cohort.csv",
              "case,words,beta.size,beta.limit\none,first,,\ntwo,fail,3 mm,\nodd,,30 mm,\n"
              "three,,5mm,1\n");
  const auto run = shell(snakemake("local"));
  EXPECT_EQ(run.exit, 1);
  EXPECT_TRUE(contains(run.errors, "case odd: cohort.csv:4:6")) << run.errors;
  EXPECT_EQ(states(), "one: ok\ntwo: failed\nthree: gates failed\nodd: refused\n");
  const std::string census = work_.read("out/cohort/census/census.txt");
  EXPECT_TRUE(contains(census, "echo: volume.txt: text fail")) << census;
  EXPECT_TRUE(contains(census, "1 to 10 mm")) << census;
  EXPECT_TRUE(contains(work_.read("out/cohort/many/many.txt"), "[\"one\",\"three\"]"));
  work_.write("cohort.csv", "case,words\none,first\ntwo,mended\n");
  EXPECT_EQ(shell(snakemake("local")).exit, 0);
  EXPECT_EQ(states(), "one: ok\ntwo: ok\n");
}

TEST_F(Cohort, TheEngineAloneMakesTheSame) {
  ASSERT_EQ(shell(snakemake("local")).exit, 0);
  const std::string report = work_.read("out/cohort/runs.json");
  work_.started();
  const auto run = work_.viscera({"run", "cohort.yaml", "--keep-going", "--jobs", "3"});
  EXPECT_EQ(run.exit, 0) << run.errors;
  EXPECT_EQ(count(work_.started(), " run"), 0) << "both share one cache";
  EXPECT_EQ(work_.read("out/cohort/runs.json"), report);
}

TEST_F(Cohort, RunsOnASlurmClusterOfOneNode) {
  work_.write("cohort.csv", "case,words,beta.size\none,first,\ntwo,fail,3 mm\n");
  fs::create_directories(work_.path("cluster"));
  const auto run = shell(fmt::format("exec '{}/tests/cohort/slurm_cluster' cluster {}",
                                     VISCERA_ROOT, snakemake("slurm", "--latency-wait 5")));
  VISCERA_NEEDS(run.exit != 77, run.errors);  // why no cluster can be started
  EXPECT_EQ(run.exit, 1) << run.errors;       // of case two
  EXPECT_TRUE(contains(run.errors, "with external jobid")) << run.errors;
  EXPECT_EQ(states(), "one: ok\ntwo: failed\n") << run.errors;
  EXPECT_TRUE(fs::exists(work_.path("out/cohort/one/echo/manifest.json")));
  EXPECT_FALSE(fs::exists(work_.path("out/cohort/two/echo/manifest.json")));
}

}  // namespace
}  // namespace viscera::test
