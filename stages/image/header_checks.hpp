// What the headers of the three formats have in common; used by their readers only.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "stages/image/image_header.hpp"

namespace viscera {

// One file's header under examination: each check throws Error(bad_input) in its name.
class HeaderChecks {
 public:
  explicit HeaderChecks(std::filesystem::path path) : path_(std::move(path)) {}
  const std::filesystem::path& path() const { return path_; }

  [[noreturn]] void refuse(std::string field, std::string found, std::string allowed) const;

  // Three axes of at least one voxel; further ones must have exactly one.
  std::array<int, 3> size(const std::string& field, const std::vector<std::int64_t>& sizes,
                          std::int64_t layers) const;
  void finite(const std::string& field, const std::vector<double>& values) const;
  // Columns of the axes: finite, and not in one plane.
  void spans_volume(const std::string& field, const std::array<double, 9>& axes) const;

  // Numbers of a text field, separated by blanks, commas and brackets ("nan" and "inf" are
  // numbers).
  std::vector<double> numbers(const std::string& field, const std::string& text) const;
  std::vector<std::int64_t> integers(const std::string& field, const std::string& text) const;

 private:
  std::filesystem::path path_;
};

enum class Encoding { raw, text, hex, deflated };  // deflated: gzip or zlib

// Where the pixels lie. Offsets count in the file; for a gzip file as a whole (NIfTI) in what it
// expands to.
struct StoredData {
  std::filesystem::path file;
  std::string field;  // that gives the size
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;   // expanded
  std::uint64_t values = 0;  // numbers that make up these bytes
  Encoding encoding = Encoding::raw;
  bool ends_file = false;  // the data are the last `bytes` of the file
};

// That the promised bytes are there, and not far more of them. Expands at most what was promised.
void check_stored(const HeaderChecks& checks, const StoredData& data);

// A file that a header names: beside or below it, never above or elsewhere.
std::filesystem::path detached_file(const HeaderChecks& checks, const std::string& field,
                                    const std::string& name);

struct NoCase {
  bool operator()(const std::string& a, const std::string& b) const;
};

// The lines of a text header by their names, upper and lower case taken for equal.
struct TextHeader {
  std::map<std::string, std::string, NoCase> fields;
  std::map<std::string, std::string> pairs;  // NRRD "key:=value", as written
  std::uint64_t end = 0;                     // where the data of an attached header begin

  const std::string& field(const HeaderChecks& checks, const std::string& name) const;
  bool has(const std::string& name) const { return fields.count(name) > 0; }
};

std::string trimmed(const std::string& text);

// Line by line, at most `longest` characters each and 16 MiB in all; nothing at the end of the
// file.
class HeaderLines {
 public:
  HeaderLines(const HeaderChecks& checks, std::size_t longest);
  std::optional<std::string> next();
  std::uint64_t position() const { return position_; }

 private:
  const HeaderChecks& checks_;
  std::ifstream file_;
  std::size_t longest_;
  std::uint64_t position_ = 0;
};

ImageHeader read_nifti_header(const HeaderChecks& checks);
ImageHeader read_nrrd_header(const HeaderChecks& checks);
ImageHeader read_meta_header(const HeaderChecks& checks);

}  // namespace viscera
