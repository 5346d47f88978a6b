// docs/claims.md lists what README.md, ARCHITECTURE.md and docs/results say and what shows it. Here
// every row is held against the documents, the tests, the Makefile and the committed tables.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <regex>
#include <set>
#include <sstream>

#include "pipeline/base/atomic_file.hpp"
#include "tests/docs/figures.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

struct Claim {
  int line = 0;
  std::string document;            // that makes it
  std::vector<std::string> cells;  // claim, shown by, figure, date
};

std::vector<Claim> claims_in(const std::string& text) {
  std::vector<Claim> claims;
  std::string document;
  std::istringstream lines(text);
  int number = 0, row = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    if (line.starts_with("## ")) document = line.substr(3);
    if (!line.starts_with("| ") && !line.starts_with("|-")) {
      row = 0;
      continue;
    }
    if (++row <= 2) continue;  // the head and the line below it
    Claim claim{number, document, {}};
    const std::regex between(R"(^\| *| *\| *)");
    std::sregex_token_iterator cell(line.begin(), line.end(), between, -1), end;
    for (++cell; cell != end; ++cell) claim.cells.push_back(*cell);
    claims.push_back(claim);
  }
  return claims;
}

std::vector<std::string> matches(const std::string& text, const std::string& pattern) {
  const std::regex regex(pattern);
  std::vector<std::string> found;
  for (std::sregex_iterator match(text.begin(), text.end(), regex), end; match != end; ++match) {
    found.push_back((*match)[1]);
  }
  return found;
}

// What a claim may name: Suite.Name of every test, and every program.
struct Project {
  std::set<std::string> tests, suites, programs;
  std::string makefile = read_file("Makefile");

  Project() {
    const std::regex test(R"((?:^|\n)(?:TYPED_)?TEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)\s*\))"),
        program(R"((?:add_executable|viscera_test)\(([\w-]+))");
    for (const char* room : {"tests", "stages", "pipeline"}) {
      for (const auto& entry : fs::recursive_directory_iterator(room)) {
        const bool source = entry.path().extension() == ".cpp";
        if (!source && entry.path().filename() != "CMakeLists.txt") continue;
        const std::string text = read_file(entry.path());
        std::sregex_iterator match(text.begin(), text.end(), source ? test : program), end;
        for (; match != end; ++match) {
          if (!source) programs.insert((*match)[1]);
          if (!source) continue;
          tests.insert((*match)[1].str() + "." + (*match)[2].str());
          suites.insert((*match)[1]);
        }
      }
    }
  }
};

// The words between quotation marks after the colon in `FILE: "WORDS"` must stand in the file.
std::string complaint_about_file(const std::string& span) {
  const auto colon = span.find(": ");
  const std::string path = span.substr(0, colon);
  if (!fs::exists(path)) return "there is no file " + path;
  if (colon == std::string::npos) return "";
  std::string words = plain(span.substr(colon + 2));
  std::erase(words, '"');
  if (plain(read_file(path)).find(words) != std::string::npos) return "";
  return fmt::format("{} does not say \"{}\"", path, words);
}

// What is wrong with one thing in code marks in the column `shown by`, formulas aside.
std::string complaint_about(const std::string& span, const Project& project) {
  std::istringstream stream(span);
  std::string word, second;
  stream >> word >> second;
  if (word == "make") {
    const bool known = project.makefile.find("\n" + second + ":") != std::string::npos;
    return known ? "" : "the Makefile has no target " + second;
  }
  if (std::regex_match(span, std::regex(R"([A-Z]\w*\.(\w+|\*))"))) {
    const bool all = span.ends_with(".*");
    const bool known = all ? project.suites.contains(span.substr(0, span.size() - 2))
                           : project.tests.contains(span);
    return known ? "" : "there is no test " + span;
  }
  if (word.starts_with("bin/") || word.starts_with("viscera")) {
    const std::string name = word.substr(word.starts_with("bin/") ? 4 : 0);
    return project.programs.contains(name) ? "" : "there is no program " + name;
  }
  return complaint_about_file(span);
}

std::string complaint_about_words(const Claim& claim) {
  if (!fs::exists(claim.document)) return "there is no document " + claim.document;
  const std::string text = plain(read_file(claim.document));
  std::istringstream parts(std::regex_replace(plain(claim.cells[0]), std::regex(" ?… ?"), "\n"));
  std::size_t from = 0;
  for (std::string part; std::getline(parts, part);) {
    from = text.find(part, from);
    if (from == std::string::npos) {
      return fmt::format("{} does not say \"{}\"", claim.document, part);
    }
  }
  return "";
}

bool has_figure(const std::string& words, double value) {
  const auto numbers = matches(words, R"((\d*[\d,]*\.?\d+(?:e-?\d+)?))");
  return std::ranges::any_of(numbers,
                             [value](const auto& number) { return is_printed_as(value, number); });
}

// The k-th formula must have the value of the k-th figure; figures stand between semicolons. The
// claim has that figure, too, or the figure says in brackets why it does not.
void add_complaints_about_figures(const Claim& claim, const std::vector<std::string>& formulas,
                                  std::vector<std::string>& found) {
  const std::string words = plain(claim.cells[0]);
  std::istringstream figures(claim.cells[2]);
  for (const auto& formula : formulas) {
    std::string figure;
    std::getline(figures, figure, ';');
    try {
      const double value = value_of(formula);
      if (!is_printed_as(value, figure)) {
        found.push_back(fmt::format("{} is {:.6g} and not {}", formula, value, figure));
      } else if (figure.find('(') == std::string::npos && !has_figure(words, value)) {
        found.push_back(fmt::format("the claim has no figure of {:.6g}", value));
      }
    } catch (const std::exception& error) {
      found.push_back(error.what());
    }
  }
}

std::vector<std::string> complaints(const Claim& claim, const Project& project) {
  if (claim.cells.size() != 4) return {fmt::format("has {} cells, not 4", claim.cells.size())};
  std::vector<std::string> found;
  const auto add = [&found](const std::string& complaint) {
    if (!complaint.empty()) found.push_back(complaint);
  };
  for (const auto& cell : claim.cells) {
    if (cell.empty()) add("has an empty cell");
  }
  add(complaint_about_words(claim));
  const std::string& shown_by = claim.cells[1];
  const auto spans = matches(shown_by, "`([^`]*)`");
  if (spans.empty() && shown_by.find("by hand") == std::string::npos) {
    add("names nothing that shows it and does not say that it was measured by hand");
  }
  std::vector<std::string> formulas;
  bool needs_gpu = false;
  for (const auto& span : spans) {
    if (span.starts_with("=")) {
      formulas.push_back(span.substr(1));
    } else {
      add(complaint_about(span, project));
    }
    needs_gpu |= span.starts_with("Cuda.") || span.find("h200/") != std::string::npos ||
                 span.find("_cuda.md") != std::string::npos || span == "make test-gpu";
  }
  add_complaints_about_figures(claim, formulas, found);
  if (needs_gpu && shown_by.find("a GPU node") == std::string::npos) {
    add("does not say that it takes a GPU node");
  }
  if (!claim.cells[3].empty() &&
      !std::regex_match(claim.cells[3], std::regex(R"(\d{4}-\d\d-\d\d|at every test)"))) {
    add("has no date, but \"" + claim.cells[3] + "\"");
  }
  return found;
}

TEST(Claims, OfTheDocumentsAreShownByWhatTheyName) {
  const Project project;
  const auto claims = claims_in(read_file("docs/claims.md"));
  EXPECT_GT(claims.size(), 100u) << "run from the repository's root";
  for (const auto& claim : claims) {
    for (const auto& complaint : complaints(claim, project)) {
      ADD_FAILURE() << "docs/claims.md:" << claim.line << ": " << complaint;
    }
  }
}

// The check itself: a row that holds, and the same with one thing wrong.
TEST(Claims, ThatAreBrokenAreNoticed) {
  const Project project;
  const auto complaints_of = [&project](const std::string& row) {
    const auto claims = claims_in(
        "## README.md\n\n| claim | shown by | figure | date |\n|---|---|---|---|\n" + row);
    return claims.size() == 1 ? complaints(claims.front(), project)
                              : std::vector<std::string>{"is no row"};
  };
  const std::string ratio =
      "`=solver_speed.csv{scheme=gauss_seidel, precision=fp64, threads=1}.ns_per_tet_substep / "
      "solver_speed.csv{scheme=gauss_seidel, precision=fp64, threads=2}.ns_per_tet_substep`";
  const std::string holds =
      "| Not for clinical use. | `Claims.ThatAreBrokenAreNoticed`, `make test`, " + ratio +
      " | 1.57 (not quoted) | 2026-11-21 |\n";
  EXPECT_EQ(complaints_of(holds), std::vector<std::string>{});
  const auto with = [&holds](const std::string& from, const std::string& to) {
    std::string row = holds;
    return row.replace(row.find(from), from.size(), to);
  };
  for (const auto& broken :
       {with("1.57", "1.58"), with("1.57", "none"), with(" (not quoted)", ""),
        with("threads=2", "threads=3"), with("fp64, threads=1", "threads=1"),
        with("solver_speed", "solver_sped"), with("Noticed`", "Notice`"),
        with("make test", "make tests"), with("clinical", "medical"), with("2026-11-21", "lately"),
        with("2026-11-21", ""), with(" | 2026-11-21", ""), with("`make test`", "`docs/absent.md`"),
        with("`make test`", "`bin/test_absent`"),
        with("`make test`", "`README.md: \"for clinical use only\"`"),
        with("`make test`", "`Cuda.TwoRunsGiveTheSameBits`")}) {
    EXPECT_EQ(complaints_of(broken).size(), 1u) << broken;
  }
}

TEST(Claims, FiguresAreThoseOfTheirTablesToTheDigitsPrinted) {
  EXPECT_TRUE(is_printed_as(24.186, "24 ×"));
  EXPECT_TRUE(is_printed_as(24.186, "24.2"));
  EXPECT_FALSE(is_printed_as(24.186, "23 times"));
  EXPECT_FALSE(is_printed_as(24.186, "24.1"));
  EXPECT_TRUE(is_printed_as(0.1686, "(.17 %)"));
  EXPECT_TRUE(is_printed_as(-0.08, "-.080"));
  EXPECT_TRUE(is_printed_as(5.53e-5, "at most 5.5e-5 L"));
  EXPECT_FALSE(is_printed_as(5.53e-5, "5.4e-5"));
  EXPECT_TRUE(is_printed_as(10246, "10,246 tets"));
  EXPECT_FALSE(is_printed_as(1.0, "none"));
  EXPECT_DOUBLE_EQ(value_of("1 + 2 * (3 - 1) / 4"), 2.0);
  EXPECT_THROW(value_of("1 +"), std::exception);
  EXPECT_THROW(value_of("absent.csv{a=b}.c"), std::exception);
}

}  // namespace
}  // namespace viscera
