// What the README prints, names and promises in lists, held against the programs.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <regex>
#include <set>
#include <sstream>

#include "pipeline/base/atomic_file.hpp"
#include "sim/scene/list.hpp"
#include "tests/docs/figures.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

std::string readme() {
  return read_file("README.md");
}

// The rows of the README's table whose head begins with this column.
std::vector<std::vector<std::string>> table(const std::string& first_column) {
  std::vector<std::vector<std::string>> rows;
  std::istringstream lines(readme());
  bool inside = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("| " + first_column + " |")) inside = true;
    if (!line.starts_with("|")) inside = false;
    if (!inside) continue;
    std::vector<std::string> cells;
    std::istringstream between(line.substr(1));
    for (std::string cell; std::getline(between, cell, '|');) cells.push_back(cell);
    rows.push_back(cells);
  }
  if (rows.size() > 2) rows.erase(rows.begin(), rows.begin() + 2);  // the head
  return rows;
}

std::set<std::string> code_in(const std::string& text) {
  std::set<std::string> found;
  const std::regex code("`([^`]*)`");
  for (std::sregex_iterator match(text.begin(), text.end(), code), end; match != end; ++match) {
    found.insert((*match)[1]);
  }
  return found;
}

TEST(Readme, EveryEffectOfItsTableIsThereAndNoneIsMissing) {
  std::set<std::string> listed, known;
  for (const auto& row : table("effect")) listed.merge(code_in(row.at(0)));
  sim::Effects::for_each([&known]<class Effect, std::size_t>() { known.insert(Effect::name); });
  EXPECT_EQ(listed, known);
}

TEST(Readme, EveryParameterOfAnEffectInItsTableIsOne) {
  std::set<std::string> fields = {"area", "vertices"};  // values of `spread`
  sim::Effects::for_each([&fields]<class Effect, std::size_t>() {
    std::apply([&fields](const auto&... field) { (fields.insert(field.name), ...); },
               Effect::fields());
  });
  for (const auto& row : table("effect")) {
    for (const auto& name : code_in(row.at(2))) EXPECT_TRUE(fields.contains(name)) << name;
  }
}

TEST(Readme, ItsLinksLeadToFilesAndItsTargetsAreThoseOfTheMakefile) {
  const std::string text = readme(), makefile = read_file("Makefile");
  const std::regex link(R"(\]\(([^)#]+)\))"), target(R"([^\w]make ([a-z][a-z-]*))");
  for (std::sregex_iterator match(text.begin(), text.end(), link), end; match != end; ++match) {
    EXPECT_TRUE(fs::exists((*match)[1].str())) << (*match)[1];
  }
  int targets = 0;
  for (std::sregex_iterator match(text.begin(), text.end(), target), end; match != end; ++match) {
    if ((*match)[1] == "for" || (*match)[1] == "and") continue;
    EXPECT_NE(makefile.find("\n" + (*match)[1].str() + ":"), std::string::npos) << (*match)[1];
    ++targets;
  }
  EXPECT_GT(targets, 10);
}

TEST(ArchitectureDocument, ItsExitCodesAreThoseOfThePrograms) {
  const auto numbers = [](const std::string& text, const std::string& pattern) {
    const std::regex regex(pattern);
    std::set<int> found;
    for (std::sregex_iterator match(text.begin(), text.end(), regex), end; match != end; ++match) {
      found.insert(std::stoi((*match)[1]));
    }
    return found;
  };
  const auto codes = numbers(read_file("pipeline/base/exit_code.hpp"), R"(\w+ = (\d+),)");
  EXPECT_GT(codes.size(), 5u);
  EXPECT_EQ(numbers(read_file("ARCHITECTURE.md"), R"(\n\| (\d+) \|)"), codes);
}

#ifdef VISCERA_BIN

// Standard output and messages of a program of the project.
std::string said_by(const std::string& command, const fs::path& folder) {
  const std::string file = (folder / "said").string();
  const int end = std::system(fmt::format("{}/{} >'{}' 2>&1", VISCERA_BIN, command, file).c_str());
  const std::string said = read_file(file);
  EXPECT_EQ(end, 0) << command << "\n" << said;
  return said;
}

// The block of code that holds these words.
std::string block_with(const std::string& words) {
  const std::string text = readme();
  const auto at = text.find(words);
  const auto begin = text.rfind("```\n", at) + 4;
  return text.substr(begin, text.find("```", at) - begin);
}

// Times, memory and the machine's threads are its own.
TEST(Readme, TheDemoPrintsWhatItShows) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const std::string said =
      said_by(fmt::format("viscera run configs/demo.yaml --out '{}'", folder.path().string()),
              folder.path());
  std::istringstream lines(block_with("labels: first run"));
  int compared = 0;
  for (std::string line; std::getline(lines, line);) {
    std::smatch state;
    if (line == "…" || line.starts_with("stage ")) continue;
    if (line.starts_with("report:")) line = "demo/report.html";
    if (const auto device = line.find(" on cpu"); device != std::string::npos) line.erase(device);
    if (std::regex_match(line, state, std::regex(R"((\w+) +(ran) .* MB  (.*))"))) {
      const std::regex row(fmt::format("{} +ran .* MB  {}\n", state[1].str(), state[3].str()));
      EXPECT_TRUE(std::regex_search(said, row)) << line << "\n" << said;
    } else {
      EXPECT_NE(said.find(line), std::string::npos) << line << "\n" << said;
    }
    ++compared;
  }
  EXPECT_EQ(compared, 14);
}

TEST(Readme, TheGateThatItShowsIsDeclaredInTheseWords) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const std::string declared = plain(said_by("viscera-labels describe", folder.path()));
  const std::string text = plain(readme());
  for (const std::string begin : {"The border of the image cuts", "take an image that holds"}) {
    const auto from = text.find(begin);
    ASSERT_NE(from, std::string::npos) << begin;
    const std::string words = text.substr(from, 100);
    EXPECT_NE(declared.find(words), std::string::npos) << words;
  }
}

TEST(Readme, TheParametersOfItsSolversAreThoseOfTheStage) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const std::string declared = said_by("viscera-simulate describe", folder.path());
  int names = 0;
  for (const auto& row : table("`solver`")) {
    for (const std::size_t column : {0u, 2u}) {
      for (const auto& name : code_in(row.at(column))) {
        EXPECT_NE(declared.find("\"" + name + "\""), std::string::npos) << name;
        ++names;
      }
    }
  }
  EXPECT_GT(names, 10);
}

#endif

}  // namespace
}  // namespace viscera
