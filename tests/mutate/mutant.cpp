#include "tests/mutate/mutant.hpp"

#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>

namespace viscera::mutate {

std::string key_of(const Mutant& mutant) {
  const Place& at = mutant.place;
  return fmt::format("{} {} | {} -> {}", at.file, at.kind, at.original, at.changed);
}

void write_list(const std::string& file, const std::vector<Mutant>& mutants) {
  std::ofstream out(file);
  for (const Mutant& m : mutants) {
    out << fmt::format("{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\n", m.number, m.group, m.place.file,
                       m.place.line, m.place.last_line, m.place.kind, m.place.original,
                       m.place.changed);
  }
}

std::vector<Mutant> read_list(const std::string& file) {
  std::vector<Mutant> mutants;
  for (auto& column : read_columns(file)) {
    column.resize(8);
    Mutant mutant{std::stoi(column[0]), column[1], {}};
    mutant.place.file = column[2];
    mutant.place.line = std::stoi(column[3]);
    mutant.place.last_line = std::stoi(column[4]);
    mutant.place.kind = column[5];
    mutant.place.original = column[6];
    mutant.place.changed = column[7];
    mutants.push_back(mutant);
  }
  return mutants;
}

std::vector<std::vector<std::string>> read_columns(const std::string& file) {
  std::vector<std::vector<std::string>> rows;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    std::vector<std::string> columns;
    std::istringstream parts(line);
    for (std::string part; std::getline(parts, part, '\t');) columns.push_back(part);
    if (!columns.empty()) rows.push_back(columns);
  }
  return rows;
}

std::string read_text(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw std::runtime_error("mutate: cannot read " + file);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace viscera::mutate
