// The paragraph on methods names what a run used, with its sources, and forgets nothing that there
// is.
#include "pipeline/record/methods.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "sim/scene/list.hpp"
#include "tests/record/sample.hpp"

namespace viscera::engine {
namespace {

TEST(Methods, EveryEffectHasItsSentence) {
  sim::Effects::for_each([]<class Effect, std::size_t>() {
    EXPECT_TRUE(has_method("effect", Effect::name)) << Effect::name;
  });
}

TEST(Methods, EveryStageHasItsSentence) {
  int stages = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator("stages")) {
    if (entry.path().filename() != "main.cpp") continue;
    std::string name = entry.path().parent_path().filename().string();
    if (name == "live") continue;  // a tool and no stage
    ++stages;
    EXPECT_TRUE(has_method("stage", name)) << name;
  }
  EXPECT_EQ(stages, 7);
}

TEST(Methods, EverySolverSchemeAndElementHasItsSentence) {
  for (const char* solver : {"xpbd", "pbd", "tled", "fem"})
    EXPECT_TRUE(has_method("solver", solver)) << solver;
  for (const char* scheme : {"gauss_seidel", "block_gauss_seidel", "jacobi"})
    EXPECT_TRUE(has_method("scheme", scheme)) << scheme;
  for (const char* element : {"linear", "smoothed", "quadratic"})
    EXPECT_TRUE(has_method("element", element)) << element;
  EXPECT_FALSE(has_method("effect", "no_such_effect"));
}

TEST(Methods, AParagraphNamesWhatTheRunUsedAndNothingElse) {
  const Json methods = methods_of(sample_run());
  const std::string text = methods["paragraph"];
  for (const char* part : {"XPBD", "64 substeps", "after 126 frames", "2.1 s", "Kelvin-Voigt",
                           "edge-based smoothed finite elements", "Coulomb friction", "BDF2"})
    EXPECT_NE(text.find(part), std::string::npos) << part << "\n" << text;
  for (const char* other : {"quadratic", "TLED", "Prony", "{", "}"})
    EXPECT_EQ(text.find(other), std::string::npos) << other << "\n" << text;
}

TEST(Methods, ASourceThatTwoMethodsHaveHasOneNumber) {
  const Json methods = methods_of(sample_run());
  int of_xpbd = 0;
  for (const auto& source : methods["sources"])
    of_xpbd += source.get<std::string>().find("XPBD:") != std::string::npos;
  EXPECT_EQ(of_xpbd, 1);
  const std::string text = methods["paragraph"];
  EXPECT_NE(text.find(fmt::format("{}]", methods["sources"].size())), std::string::npos) << text;
}

TEST(Methods, ASentenceWhoseFigureTheRunLacksIsLeftOut) {
  FinishedRun run = sample_run();
  for (Metric& metric : run.stages[0].manifest.metrics) {
    if (metric.name == "rest_time") metric.value = nullptr;
  }
  const std::string text = methods_of(run)["paragraph"];
  EXPECT_EQ(text.find("came to rest"), std::string::npos) << text;
  EXPECT_NE(text.find("64 substeps"), std::string::npos) << text;
}

}  // namespace
}  // namespace viscera::engine
