// Runs every hard case under every solver that claims it and writes the table of what came of it.
#include <gtest/gtest.h>

#include "tests/hard_cases/cases.hpp"

namespace viscera::sim {
namespace {

const std::vector<KnownMiss> known_misses = {};

const std::string head = R"(# Hard cases

Written by `test_hard_cases`; do not edit.
)";

TEST(HardCases, EachIsRecoveredOrRefusedWithAReasonOrAKnownMissThatIsNoWorse) {
  std::vector<Row> rows;
  add_shape_cases(rows);
  run_rows(rows);
  write_table("docs/results/hard_cases.md", head, "recovered", rows);
  for (const auto& complaint : complaints(rows, known_misses)) ADD_FAILURE() << complaint;
}

}  // namespace
}  // namespace viscera::sim
