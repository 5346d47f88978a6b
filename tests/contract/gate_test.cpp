#include "pipeline/contract/gate.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

#include "pipeline/base/json_value.hpp"

namespace viscera {
namespace {

const GateInfo angle("min_dihedral", ">=", "deg", "The mesh has slivers.", "lower cell_size");
const GateInfo holes("open_edges", "<=", "1", "The surface has holes.", "raise sigma");

TEST(Gate, CannotBeDeclaredWithoutSayingWhatItsFailureMeansAndWhatToChange) {
  EXPECT_THROW(GateInfo("g", "<=", "1", "", "change it"), std::invalid_argument);
  EXPECT_THROW(GateInfo("g", "<=", "1", "It is bad.", ""), std::invalid_argument);
  EXPECT_THROW(GateInfo("g", "<", "1", "It is bad.", "change it"), std::invalid_argument);
  EXPECT_NO_THROW(GateInfo("g", "<=", "1", "It is bad.", "change it"));
}

TEST(Gate, AFailureIsToldWithMeaningPlaceAndRemedyAndWithoutStraySpaces) {
  EXPECT_EQ(failure_message(judged(holes, 9, 0)),
            "gate open_edges: 9, required <= 0\n"
            "  means:   The surface has holes.\n"
            "  remedy:  raise sigma");
  EXPECT_EQ(failure_message(
                judged(angle, 2.5, 10,
                       {.of = "liver", .where = "at the hilum", .at = {{1, -2.25, 3}, {4, 5, 6}}})),
            "gate liver.min_dihedral: 2.5 deg, required >= 10 deg\n"
            "  means:   The mesh has slivers.\n"
            "  where:   at the hilum; at (1.0, -2.2, 3.0) mm, (4.0, 5.0, 6.0) mm\n"
            "  remedy:  lower cell_size");
}

TEST(Gate, OfManyPlacesAMessageHoldsAFewAndTheManifestMore) {
  const Gate gate = judged(holes, 150, 0, {.at = std::vector<std::array<double, 3>>(150)});
  EXPECT_EQ(gate.at.size(), 100u);
  EXPECT_NE(failure_message(gate).find("(0.0, 0.0, 0.0) mm and 97 more"), std::string::npos);
}

TEST(Gate, AValueThatIsTheLimitPasses) {
  EXPECT_TRUE(judged(holes, 3, 3).passed());
  EXPECT_TRUE(judged(angle, 10, 10).passed());
}

TEST(Gate, WhatTheRunKnowsBetterThanTheDeclarationIsTheRemedy) {
  EXPECT_EQ(judged(holes, 9, 0, {.remedy = "set sigma: 2 mm"}).remedy, "set sigma: 2 mm");
}

TEST(Gate, OnANumberThatDoesNotExistFailsAndSaysSo) {
  const Gate gate = judged(angle, std::numeric_limits<double>::quiet_NaN(), 10);
  EXPECT_FALSE(gate.passed());
  EXPECT_EQ(failure_message(gate).find("gate min_dihedral: none, required >= 10 deg"), 0u);
  const Json json = to_json(gate);
  EXPECT_FALSE(gate_from_json({json, "manifest.json"}).passed());
}

TEST(Gate, IsReadFromManifestsOfVersionsThatHadNoTexts) {
  const Json json{{"name", "g"}, {"value", 1}, {"comparison", "<="}, {"limit", 0}, {"unit", "1"}};
  const Gate gate = gate_from_json({json, "manifest.json"});
  EXPECT_EQ(failure_message(gate), "gate g: 1, required <= 0");
}

TEST(Gate, IsDeclaredByItsNameAndByThatOfOneOfSeveral) {
  EXPECT_TRUE(is_declared(judged(holes, 0, 0), {holes}));
  EXPECT_TRUE(is_declared(judged(holes, 0, 0, {.of = "liver"}), {angle, holes}));
  EXPECT_FALSE(is_declared(judged(holes, 0, 0), {angle}));
}

}  // namespace
}  // namespace viscera
