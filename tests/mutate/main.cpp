// The steps of `make mutate`; .ci/mutate calls them one after the other.
//   mutate write ROOT COPY OUT     choose mutants, write the copy and OUT/mutants.tsv; those of
//   OUT/dropped.txt stay out mutate drop OUT LOG            add to OUT/dropped.txt those that LOG's
//   errors name; 3 where there are none mutate run OUT BIN SOURCE [--jobs N] [--from N] [--to N]
//   [--only N] [--quick] [--patience X] mutate table OUT FILE EXPLAINED
#include <fmt/format.h>

#include <exception>
#include <fstream>
#include <set>
#include <span>
#include <stdexcept>

#include "tests/mutate/choose.hpp"
#include "tests/mutate/run.hpp"
#include "tests/mutate/table.hpp"

namespace {

using namespace viscera::mutate;

std::set<int> dropped_of(const std::string& out) {
  std::set<int> numbers;
  std::ifstream in(out + "/dropped.txt");
  for (int number; in >> number;) numbers.insert(number);
  return numbers;
}

int write(const std::string& root, const std::string& copy, const std::string& out) {
  auto mutants = choose(root, root + "/tests/mutate/by_hand.tsv");
  const std::set<int> dropped = dropped_of(out);
  std::erase_if(mutants, [&](const Mutant& m) { return dropped.count(m.number) > 0; });
  write_copy(root, copy, mutants);
  write_list(out + "/mutants.tsv", mutants);
  fmt::print("mutate: {} mutants, {} dropped\n", mutants.size(), dropped.size());
  return 0;
}

int drop(const std::string& out, const std::string& log) {
  const auto numbers = blamed(read_text(log), read_list(out + "/mutants.tsv"));
  std::ofstream file(out + "/dropped.txt", std::ios::app);
  for (const int number : numbers) file << number << "\n";
  fmt::print("mutate: {} mutants do not compile\n", numbers.size());
  return numbers.empty() ? 3 : 0;
}

int run(const std::string& out, std::span<char*> words) {
  RunOptions options{.bin = words[0], .source = words[1], .out = out};
  for (std::size_t i = 2; i < words.size(); ++i) {
    const std::string word = words[i];
    if (word == "--quick") {
      options.quick = true;
      continue;
    }
    if (i + 1 == words.size()) throw std::runtime_error("mutate: " + word + " needs a number");
    const std::string value = words[++i];
    if (word == "--jobs") options.jobs = std::stoi(value);
    if (word == "--from" || word == "--only") options.from = std::stoi(value);
    if (word == "--to" || word == "--only") options.to = std::stoi(value);
    if (word == "--patience") options.patience = std::stod(value);
  }
  run_all(read_list(out + "/mutants.tsv"), options);
  return 0;
}

std::string first_line(const std::string& file) {
  std::string line;
  std::ifstream in(file);
  std::getline(in, line);
  return line;
}

}  // namespace

int main(int count, char** words) {
  try {
    const std::string step = count > 1 ? words[1] : "";
    if (step == "write" && count == 5) return write(words[2], words[3], words[4]);
    if (step == "drop" && count == 4) return drop(words[2], words[3]);
    if (step == "run" && count >= 5) return run(words[2], std::span(words + 3, words + count));
    if (step == "table" && count == 5) {
      const std::string out = words[2];
      viscera::mutate::write_table(words[3], read_list(out + "/mutants.tsv"), read_results(out),
                                   words[4], dropped_of(out).size(),
                                   first_line(out + "/commit.txt"));
      return 0;
    }
    fmt::print(stderr, "usage: mutate write|drop|run|table …; see tests/mutate/main.cpp\n");
    return 2;
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 1;
  }
}
