#include "pipeline/base/units.hpp"

#include <gtest/gtest.h>

namespace viscera {
namespace {

double read(const char* text, const char* unit) {
  return parse_quantity(text, unit, "here", "field");
}

TEST(Units, EveryWayOfWritingAQuantityGivesItsValueInTheNamedUnit) {
  EXPECT_DOUBLE_EQ(read("5mm", "mm"), 5.0);
  EXPECT_DOUBLE_EQ(read(" 0.5 cm", "mm"), 5.0);
  EXPECT_DOUBLE_EQ(read("5 kPa", "Pa"), 5000.0);
  EXPECT_DOUBLE_EQ(read("9.81 m/s^2", "m/s2"), 9.81);
  EXPECT_DOUBLE_EQ(read("1060 kg/m³", "kg/m3"), 1060.0);
  EXPECT_DOUBLE_EQ(read("1.06g/cm3", "kg/m3"), 1060.0);
  EXPECT_DOUBLE_EQ(read("1e-3", "1"), 1e-3);
  EXPECT_DOUBLE_EQ(read("30 %", "1"), 0.3);
  EXPECT_DOUBLE_EQ(read("+2", "1"), 2.0);
  EXPECT_DOUBLE_EQ(read("10 1/s", "1/s"), 10.0);
  EXPECT_DOUBLE_EQ(read("10/s", "1/s"), 10.0);
}

TEST(Units, MissingUnknownAndForeignUnitsAreRefusedWithTheFieldNamed) {
  for (const char* text : {"5", "5 parsec", "5 kPa", "five mm", "", "nan mm", "inf mm", "5 mm x"}) {
    try {
      read(text, "mm");
      FAIL() << "accepted '" << text << "'";
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::bad_config) << text;
      EXPECT_EQ(e.problem().field, "field");
      EXPECT_NE(e.problem().allowed.find("mm"), std::string::npos) << e.what();
    }
  }
}

}  // namespace
}  // namespace viscera
