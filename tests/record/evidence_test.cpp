// Which rows of the tests' tables a run is shown: those of its solver and its effects.
#include "pipeline/record/evidence.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "pipeline/record/credibility.hpp"
#include "tests/record/sample.hpp"

namespace viscera::engine {
namespace {

Setting drop() {
  return {.method = "xpbd",
          .scheme = "gauss_seidel",
          .precision = "fp32",
          .element = "smoothed",
          .effects = {"gravity", "viscosity", "smoothed_neo_hookean", "ground"}};
}

bool has_case(const Json& rows, const std::string& part) {
  return std::ranges::any_of(rows, [&](const Json& row) {
    return row["case"].get<std::string>().find(part) != std::string::npos;
  });
}

TEST(Evidence, EverySectionOfTheTablesIsKnown) {
  for (const bool on_device : {false, true}) {
    for (const ResultTable& table : result_tables(on_device)) {
      EXPECT_GT(table.rows.size(), 50u) << table.file;
      EXPECT_EQ(table.dated.size(), 10u) << table.file << " dated " << table.dated;
      EXPECT_TRUE(table.program.starts_with("test_")) << table.program;
      for (const auto& row : table.rows)
        EXPECT_NE(subject_of(row[0]), "") << table.file << " section " << row[0];
    }
  }
}

TEST(Evidence, RowsAreThoseOfTheSolverOfTheRun) {
  for (const Json& row : verification_rows(drop())) {
    const std::string solver = row["solver"];
    EXPECT_TRUE(solver.starts_with("xpbd gauss_seidel") || solver.starts_with("any")) << solver;
  }
  Setting fem = drop();
  fem.method = "fem";
  fem.scheme = "";
  EXPECT_FALSE(verification_rows(fem).empty());
  EXPECT_FALSE(has_case(verification_rows(fem), "slides down"));
}

TEST(Evidence, RowsOfEffectsThatTheRunLacksAreNotShown) {
  EXPECT_TRUE(has_case(verification_rows(drop()), "slides down"));
  Setting floating = drop();
  std::erase(floating.effects, "ground");
  EXPECT_FALSE(has_case(verification_rows(floating), "slides down"));
  EXPECT_FALSE(has_case(verification_rows(floating), "resting on the ground"));
  EXPECT_TRUE(has_case(verification_rows(floating), "random scramble"));
}

TEST(Evidence, RowsOfSettingsThatTheRunLacksAreNotShown) {
  EXPECT_FALSE(has_case(verification_rows(drop()), "stiffness jump"));
  EXPECT_FALSE(has_case(verification_rows(drop()), "accuracy_limit"));
  Setting mixed = drop();
  mixed.several_materials = true;
  EXPECT_TRUE(has_case(verification_rows(mixed), "stiffness jump 1e4"));
  EXPECT_FALSE(has_case(verification_rows(mixed), "accuracy_limit"));
  mixed.accuracy_limit = true;
  EXPECT_TRUE(has_case(verification_rows(mixed), "accuracy_limit"));
}

TEST(Evidence, OfTwoPrecisionsTheRunsIsShownAndAnotherSaysSo) {
  bool other = false, own = false;
  for (const Json& row : verification_rows(drop())) {
    EXPECT_FALSE(row["case"] == "stopping distance" && row["precision"] != "fp32") << row;
    const auto differs = row["differs"].get<std::vector<std::string>>();
    const bool has_own =
        row["solver"].get<std::string>().find("smoothed elements") != std::string::npos;
    EXPECT_EQ(std::ranges::count(differs, "linear tets"), has_own ? 0 : 1) << row;
    own = own || has_own;
    other = other || std::ranges::count(differs, "fp64") > 0;
  }
  EXPECT_TRUE(other) << "equilibria are verified in fp64 alone";
  EXPECT_TRUE(own) << "rows of smoothed elements are of the run's own";
}

TEST(Evidence, AFailedRowSaysSo) {
  bool failed = false;
  for (const Json& row : verification_rows(drop())) failed = failed || row["outcome"] == "failed";
  EXPECT_TRUE(failed) << "scrambled vertices at nu .45 are not recovered";
}

TEST(Evidence, MeasuredBodiesAreNoTestProblems) {
  EXPECT_FALSE(has_case(verification_rows(drop()), "silicone beam"));
  Setting double_precision = drop();
  double_precision.precision = "fp64";
  EXPECT_TRUE(has_case(measured_rows(double_precision), "silicone beam"));
}

TEST(Evidence, OfMeasuredBodiesTheRowsOfTheRunsSolverAreShown) {
  int found = 0;
  for (const Json& row : measured_rows(drop())) {
    if (row["table"] != "measured.csv") continue;
    EXPECT_EQ(row["solver"], "xpbd (default)");
    found += row["body"] == "Truth Cube";
  }
  EXPECT_EQ(found, 2) << "two states";
}

TEST(Evidence, ErrorBarsAreThoseOfTheElements) {
  EXPECT_FALSE(error_bar_rows("smoothed").empty());
  for (const Json& row : error_bar_rows("smoothed")) EXPECT_EQ(row["element"], "smoothed");
  EXPECT_TRUE(error_bar_rows("none").empty());
}

TEST(Credibility, FactorsStandInTheOrderOfTheStandard) {
  const FinishedRun run = sample_run();
  std::vector<std::string> names;
  for (const Json& factor : credibility_factors(run, evidence_for(run)))
    names.push_back(factor["factor"]);
  const std::vector<std::string> standard = {
      "Software quality assurance",
      "Numerical code verification",
      "Discretization error",
      "Numerical solver error",
      "Use error",
      "Model form",
      "Model inputs",
      "Test samples",
      "Test conditions",
      "Equivalency of input parameters",
      "Output comparison",
      "Relevance of the quantities of interest",
      "Relevance of the validation activities to the context of use"};
  EXPECT_EQ(names, standard);
}

TEST(Credibility, WhatNothingSpeaksAboutIsNotAssessed) {
  const FinishedRun run = sample_run();
  const Json factors = credibility_factors(run, evidence_for(run));
  EXPECT_EQ(factors[2]["state"], "not assessed") << "the run was not certified";
  EXPECT_NE(factors[2]["statements"][0].get<std::string>().find("simulate.certify=true"),
            std::string::npos);
  EXPECT_EQ(factors[8]["state"], "not assessed");
  EXPECT_EQ(factors[12]["state"], "not assessed");
  EXPECT_EQ(error_bar_of(run)["state"], "not asked for");
}

TEST(Credibility, AnErrorBarIsToldWithItsParts) {
  FinishedRun run = sample_run();
  for (const auto& [name, value] : std::map<std::string, double>{{"error_total", 1.5},
                                                                 {"error_total_share", 0.05},
                                                                 {"error_solver", 0.1},
                                                                 {"error_element", 0.9},
                                                                 {"error_mesh", 0.5},
                                                                 {"error_support", 0.0},
                                                                 {"error_surface", 0.2},
                                                                 {"error_largest", 4.0}})
    run.stages[0].manifest.metrics.push_back({name, value, "mm"});
  const Json factors = credibility_factors(run, evidence_for(run));
  EXPECT_EQ(factors[2]["state"], "assessed");
  const std::string text = factors[2]["statements"][0];
  EXPECT_NE(text.find("1.5 mm"), std::string::npos) << text;
  EXPECT_NE(text.find("5 %"), std::string::npos) << text;
  EXPECT_EQ(error_bar_of(run)["element"], 0.9);
  const auto of_surface = [](const FinishedRun& one) {
    return credibility_factors(one, evidence_for(one))[2]["statements"][1].get<std::string>();
  };
  EXPECT_NE(of_surface(run).find("0.2 mm"), std::string::npos) << of_surface(run);
  for (auto& metric : run.stages[0].manifest.metrics) {
    if (metric.name == "error_surface") metric.value = Json();
  }
  EXPECT_NE(of_surface(run).find("not known"), std::string::npos) << of_surface(run);
}

TEST(Credibility, AFailedGateIsToldUnderUseError) {
  FinishedRun run = sample_run();
  run.stages[0].manifest.gates.push_back({"rest_time", 9.0, "<=", 8.0, "s"});
  const std::string text = credibility_factors(run, evidence_for(run))[4]["statements"].dump();
  EXPECT_NE(text.find("1 passed, 1 failed"), std::string::npos) << text;
  EXPECT_NE(text.find("gate rest_time: 9 s"), std::string::npos) << text;
}

}  // namespace
}  // namespace viscera::engine
