#include <gtest/gtest.h>

#include <cctype>

#include "stages/labels/stage.hpp"
#include "stages/report/cohort/cohort_stage.hpp"
#include "stages/report/compare/compare_stage.hpp"
#include "stages/report/report_stage.hpp"
#include "stages/simulate/stage.hpp"
#include "stages/surface/stage.hpp"
#include "stages/tetmesh/stage.hpp"

namespace viscera {
namespace {

// A run can judge no gate but those that its stage declares (StageFails/undeclared_gate), so that
// this list is whole.
TEST(Gates, OfEveryStageSayWhatAFailureMeansAndWhatToChange) {
  std::map<std::string, std::size_t> counts;
  for (const Stage& stage : {labels_stage(), surface_stage(), tetmesh_stage(), simulate_stage(),
                             report_stage(), compare_stage(), cohort_stage()}) {
    counts[stage.info.name] = stage.info.gates.size();
    const Json listed = to_json(stage.info)["gates"];
    ASSERT_EQ(listed.size(), stage.info.gates.size());
    for (const auto& gate : listed) {
      const std::string name = gate["name"], meaning = gate["meaning"], remedy = gate["remedy"];
      EXPECT_TRUE(std::isupper(meaning.front()) && meaning.ends_with(".")) << name;
      EXPECT_GT(std::ranges::count(meaning, ' '), 3) << name << ": a sentence";
      EXPECT_GT(std::ranges::count(remedy, ' '), 1) << name << ": what to change, and how";
      EXPECT_FALSE(remedy.ends_with(".")) << name << ": a phrase that messages go on from";
    }
  }
  EXPECT_EQ(counts["labels"], 1u);
  EXPECT_GE(counts["surface"], 6u);
  EXPECT_GE(counts["tetmesh"], 13u);
  EXPECT_GE(counts["simulate"], 32u);
}

}  // namespace
}  // namespace viscera
