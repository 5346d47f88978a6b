// Cases as a table beside the spec: what it says, and where it is wrong.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

namespace fs = std::filesystem;

class CaseTable : public testing::Test {
 protected:
  CommandResult run(const std::string& table, const std::vector<std::string>& extra = {}) const {
    work_.write("cases.csv", table);
    return work_.run_spec("cohort.yaml", extra);
  }
  void SetUp() override { write_spec("cases.csv"); }
  void write_spec(const std::string& table) const {
    work_.write("cohort.yaml",
                "viscera: 1\nvars: {words: hello, input: volume.txt}\nstages:\n"
                "  alpha: {in: {volume: \"${input}\"}}\n  beta: {}\n"
                "  echo: {text: \"${words}\"}\ncases: " +
                    table + "\n");
  }
  std::string first_line(const std::string& name) const {
    const std::string text = work_.read(fmt::format("out/cohort/{}/echo.txt", name));
    return text.substr(0, text.find('\n'));
  }
  const Workplace work_;
};

TEST_F(CaseTable, HasQuotesCommentsEmptyCellsAndAnyLineEnds) {
  const auto result =
      run("\xef\xbb\xbf# a comment, with a comma\r\ncase,words, beta.size\r\nplain,,\r\n\r\n"
          "quoted,\"a, \"\"b\"\"\",2 mm\nlast, spaced out ,3mm");
  ASSERT_EQ(result.exit, 0) << result.errors;
  EXPECT_EQ(first_line("plain"), "hello");
  EXPECT_EQ(first_line("quoted"), "a, \"b\"");
  EXPECT_EQ(first_line("last"), "spaced out");
  EXPECT_TRUE(work_.read("out/cohort/quoted/beta/beta.txt").ends_with("2"));
  EXPECT_TRUE(work_.read("out/cohort/plain/beta/beta.txt").ends_with("4"));
}

TEST_F(CaseTable, NamesFilesBesideTheSpec) {
  fs::create_directories(work_.path("deep"));
  fs::rename(work_.path("cohort.yaml"), work_.path("deep/cohort.yaml"));
  work_.write("deep/one.txt", "one\n");
  work_.write("deep/cases.csv", "case,input\na,one.txt\n");
  const auto result = work_.viscera({"run", "deep/cohort.yaml"});
  EXPECT_EQ(result.exit, 0) << result.errors;
}

struct BadTable {
  const char* name;
  const char* table;
  std::vector<std::string> says;
};
class CaseTableRefused : public CaseTable, public testing::WithParamInterface<BadTable> {};

TEST_F(CaseTable, RefusesANameThatIsTooLongForAFolder) {
  EXPECT_EQ(run("case,words\n" + std::string(200, 'a') + ",b\n").exit, 0);
  const auto result = run("case,words\na,b\n" + std::string(201, 'a') + ",b\n");
  EXPECT_EQ(result.exit, 3) << result.errors;
  EXPECT_TRUE(contains(result.errors, "cases.csv:3:1")) << result.errors;
  EXPECT_TRUE(contains(result.errors, "at most 200 bytes")) << result.errors;
}

TEST_P(CaseTableRefused, WithItsLineAndColumn) {
  const auto result = run(GetParam().table);
  EXPECT_EQ(result.exit, 3) << result.errors;
  for (const auto& part : GetParam().says) {
    EXPECT_TRUE(contains(result.errors, part)) << part << "\n" << result.errors;
  }
  EXPECT_FALSE(fs::exists(work_.path("out/cohort")));
}

const std::vector<BadTable> bad = {
    {"Empty", "# nothing\n", {"cases.csv", "no row"}},
    {"NamesOnly", "case,words\n", {"cases.csv:1:1", "a row for each case"}},
    {"FirstColumn", "name,words\na,b\n", {"cases.csv:1:1", "'name'"}},
    {"CellMissing", "case,words\na,b\nc\n", {"cases.csv:3:1", "1 cells"}},
    {"CellTooMany", "case,words\na,b,c\n", {"cases.csv:2:1", "3 cells"}},
    {"OpenQuote", "case,words\na,\"b\n", {"cases.csv:2:3", "without its end"}},
    {"TextAfterQuote", "case,words\na,\"b\"c\n", {"cases.csv:2:6", "after a closing quote"}},
    {"Twice", "case,words\na,b\na,c\n", {"cases.csv:3:1", "two cases"}},
    {"FolderName", "case,words\n../up,b\n", {"cases.csv:2:1", "'../up'"}},
    {"NoName", "case,words\n,b\n", {"cases.csv:2:1", "can name a folder"}},
    {"RunsOwnFile", "case,words\na,b\nruns.json,c\n", {"cases.csv:3:1", "the run itself"}},
    {"Formula", "case,words\n=1+1,b\n", {"cases.csv:2:1", "'=1+1'", "at its beginning"}},
    {"Option", "case,words\n--case,b\n", {"cases.csv:2:1", "'--case'"}},
    {"UnknownVariable", "case,wrods\na,b\n", {"cases.csv:2:3", "did you mean 'words'?"}},
    {"UnknownParam", "case,beta.siz\na,1mm\n", {"cases.csv:2:3", "did you mean 'size'?"}},
    {"OutOfRange", "case,beta.size\na,1mm\nb,40mm\n", {"cases.csv:3:3", "1 to 10 mm"}},
    {"BrokenValue", "case,beta.size\na,\"[1\"\n", {"cases.csv:2:3", "beta.size"}},
    {"ListForVariable", "case,words\na,\"[1, 2]\"\n", {"cases.csv:2:3", "not a plain value"}},
};
INSTANTIATE_TEST_SUITE_P(Each, CaseTableRefused, testing::ValuesIn(bad),
                         [](const auto& instance) { return std::string(instance.param.name); });

TEST_F(CaseTable, OutsideTheSpecsFolderIsNotRead) {
  fs::create_directories(work_.path("inside"));
  fs::rename(work_.path("cohort.yaml"), work_.path("inside/cohort.yaml"));
  work_.write("cases.csv", "case,words\na,b\n");
  fs::create_symlink(work_.path("cases.csv"), work_.path("inside/link.csv"));
  for (const std::string& table :
       {std::string("../cases.csv"), work_.path("cases.csv").string(), std::string("link.csv")}) {
    write_spec(table);
    fs::rename(work_.path("cohort.yaml"), work_.path("inside/cohort.yaml"));
    const auto result = work_.viscera({"run", "inside/cohort.yaml"});
    EXPECT_EQ(result.exit, 3) << table;
    EXPECT_TRUE(contains(result.errors, "in the spec's folder or below")) << result.errors;
  }
}

TEST_F(CaseTable, OfAThousandCasesOneIsReadAlone) {
  std::string table = "case,words\n";
  for (int i = 0; i < 1000; ++i) table += fmt::format("c{},w\n", i);
  EXPECT_EQ(run(table, {"--case", "c7"}).exit, 0);
  EXPECT_TRUE(fs::exists(work_.path("out/cohort/c7/echo.txt")));
  EXPECT_FALSE(fs::exists(work_.path("out/cohort/c8")));
}

}  // namespace
}  // namespace viscera::test
