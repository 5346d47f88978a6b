// HDF5 files that are well formed and still not what a reader of ours expects: datasets that are
// missing, of another type, rank or extent, stored otherwise or elsewhere, and with values that no
// run has. A fuzzer's bytes choose what is wrong; bytes of zero make the whole file.
#pragma once

#include <hdf5.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace viscera::fuzz {

// Bytes that choose; when they have run out, they are zeros.
class Choices {
 public:
  Choices(const std::uint8_t* bytes, std::size_t size) : at_(bytes), end_(bytes + size) {}
  std::uint8_t byte() { return at_ == end_ ? 0 : *at_++; }
  bool rarely() { return byte() % 16 == 15; }
  template <class T, std::size_t n>
  T one_of(const T (&choices)[n]) {
    return choices[byte() % n];
  }

 private:
  const std::uint8_t *at_, *end_;
};

// A dataset as its reader expects it: of numbers, or, with a `text_bytes`, of texts so long.
struct Expected {
  const char* name;
  bool real;
  std::vector<hsize_t> shape;
  std::vector<double> values;
  std::size_t text_bytes = 0;
  std::string text = {};
};

// Writes the file; its first `user_bytes` are left to the caller.
void write_hostile_hdf5(const std::filesystem::path& path, hsize_t user_bytes,
                        const std::vector<Expected>& datasets, Choices& choices);

}  // namespace viscera::fuzz
