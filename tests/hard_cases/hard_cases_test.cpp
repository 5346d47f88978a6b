// Runs every hard case under every solver that claims it and writes the table of what came of it.
#include <gtest/gtest.h>

#include <algorithm>

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
  add_material_cases(rows);
  add_scale_cases(rows);
  add_contact_cases(rows);
  add_input_cases(rows);
  std::ranges::stable_sort(rows, {}, [](const Row& row) { return std::stoi(row.section); });
  run_rows(rows);
  write_table("docs/results/hard_cases.md", head, "recovered", rows);
  for (const auto& complaint : complaints(rows, known_misses)) ADD_FAILURE() << complaint;
}

}  // namespace
}  // namespace viscera::sim
