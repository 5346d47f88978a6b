// A place of the sources that can be changed on purpose, and a chosen one with its number.
#pragma once

#include <string>
#include <vector>

namespace viscera::mutate {

struct Place {
  std::string file;  // relative to the root
  int line = 0, last_line = 0;
  std::string kind;                // "sign", "factor 2", …
  std::string original, changed;   // in one line, for the reader; changed "": dropped
  std::size_t begin = 0, end = 0;  // of what is replaced, bytes of the file
  std::string text;                // what replaces it; @ stands for the number
};

struct Mutant {
  int number = 0;
  std::string group;  // "sim/effects", …
  Place place;
};

/// The name under which a result is kept. It has no line, so that a result outlasts changes
/// elsewhere in the file; choose() takes no two mutants of one name.
std::string key_of(const Mutant& mutant);

/// One mutant a line, columns parted by tabs: all that running and the table need.
void write_list(const std::string& file, const std::vector<Mutant>& mutants);
std::vector<Mutant> read_list(const std::string& file);

/// Columns of every line of a file whose columns are parted by tabs; none where there is no file.
std::vector<std::vector<std::string>> read_columns(const std::string& file);

/// A file's text; throws std::runtime_error where it cannot be read.
std::string read_text(const std::string& file);

}  // namespace viscera::mutate
