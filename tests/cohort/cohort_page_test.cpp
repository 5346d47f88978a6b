// What the page of a cohort is made from: outliers, rows, and what is no cohort.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "stages/report/cohort/cohort_stage.hpp"
#include "stages/report/cohort/outliers.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

TEST(Outliers, StandOutByTheirModifiedZScore) {
  // median 10, MAD 1: z = 3.5 at 10 + 3.5 * 1.4826 = 15.19
  const ValueSpread spread = spread_of({9, 10, 11, 9, 11, 10, 15.1, 15.3});
  EXPECT_EQ(spread.median, 10.5);
  EXPECT_EQ(spread_of({9, 10, 11, 8, 12, 10, 15.1}).outlier,
            (std::vector<bool>{false, false, false, false, false, false, false}));
  EXPECT_EQ(spread_of({9, 10, 11, 9, 11, 10, 15.3}).outlier,
            (std::vector<bool>{false, false, false, false, false, false, true}));
}

TEST(Outliers, AmongEqualValuesAreJudgedByTheMeanDistance) {
  std::vector<double> values(11, 5.0);
  values.push_back(6.0);
  EXPECT_EQ(spread_of(values).outlier.back(), true);
  EXPECT_EQ(spread_of(values).outlier.front(), false);
  values.back() = 5.0 + 1e-12;  // rounding
  EXPECT_EQ(spread_of(values).outlier.back(), false);
}

TEST(Outliers, AreNotCalledSoAmongAFew) {
  EXPECT_EQ(spread_of({1, 1, 1, 100}).outlier, (std::vector<bool>(4, false)));
  EXPECT_EQ(spread_of({7}).median, 7.0);
}

class CohortPage : public testing::Test {
 protected:
  int run(const std::string& runs) const {
    write_atomically(folder_.path() / "runs.json", runs);
    const std::string in = fmt::format("runs={}", (folder_.path() / "runs.json").string());
    const std::string out = (folder_.path() / "out").string();
    std::vector<std::string> words = {"viscera-cohort", "run", "--quiet", "--in", in, "--out", out};
    std::vector<char*> arguments;
    for (auto& word : words) arguments.push_back(word.data());
    return stage_main(static_cast<int>(arguments.size()), arguments.data(), cohort_stage());
  }
  std::string read(const char* file) const { return read_file(folder_.path() / "out" / file); }

  TemporaryFolder folder_{fs::temp_directory_path()};
};

std::string case_json(const char* name, double volume) {
  return fmt::format(
      R"({{"case": "{}", "settings": {{"E": "5 kPa"}}, "state": "ok", "message": "", "stages": [
        {{"stage": "labels", "exit": 0, "message": "",
          "gates": [{{"name": "g", "value": 1, "comparison": "<=", "limit": 0, "unit": "1",
                      "passed": false}}],
          "metrics": [{{"name": "volume", "value": {}, "unit": "ml"}}]}}]}},)",
      name, volume);
}

TEST_F(CohortPage, HasARowForEveryCaseAndAColumnForEveryFigure) {
  std::string cases = case_json("first, \\\"one\\\"", 10);
  for (const double volume : {11.0, 9.0, 10.5, 9.5}) cases += case_json("c", volume);
  cases += case_json("far", 99) + case_json("=1+1", 10);
  cases +=
      "{\"case\": \"odd\", \"settings\": {}, \"state\": \"refused\", \"message\": \"no\", "
      "\"stages\": []}";
  ASSERT_EQ(run(fmt::format(R"({{"schema": 1, "run": "r", "cases": [{}]}})", cases)), 0);
  const std::string table = read("cohort.csv");
  EXPECT_EQ(table.substr(0, table.find('\n')), "case,state,failed_gates,outliers,labels.volume_ml");
  EXPECT_NE(table.find("\"first, \"\"one\"\"\",ok,1,0,10\n"), std::string::npos) << table;
  EXPECT_NE(table.find("far,ok,1,1,99\n"), std::string::npos) << table;
  EXPECT_NE(table.find("'=1+1,ok,1,0,10\n"), std::string::npos) << table;
  EXPECT_NE(table.find("odd,refused,0,0,\n"), std::string::npos) << table;
  EXPECT_NE(read("cohort.html").find("\"state\":\"refused\""), std::string::npos);
}

TEST_F(CohortPage, RefusesWhatIsNoCohort) {
  for (const char* text : {"", "[]", "{\"schema\": 1, \"cases\": []}", "{\"schema\": 2}",
                           "{\"schema\": 1, \"cases\": [{\"case\": 1}]}"}) {
    EXPECT_EQ(run(text), 4) << text;
    EXPECT_FALSE(fs::exists(folder_.path() / "out"));
  }
}

}  // namespace
}  // namespace viscera
