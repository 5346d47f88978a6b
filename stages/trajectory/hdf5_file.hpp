// What files in HDF5 share: identifiers that close themselves, errors that name file and dataset,
// whole datasets written and read. Time stamps are off: equal content gives equal bytes.
#pragma once

#include <hdf5.h>

#include <filesystem>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

#include "pipeline/base/error.hpp"

namespace viscera::hdf5 {

// Our errors say what HDF5's error stack says, so its own printing is off while one of our
// functions runs. Every function that calls HDF5 begins with one.
class QuietHdf5 {
 public:
  QuietHdf5() {
    // As the program ends HDF5 would once more write what a full disk has refused, and crash
    // (1.10.8); whoever opens a file here closes it.
    [[maybe_unused]] static const herr_t has_no_exit_handler = H5dont_atexit();
    H5Eget_auto2(H5E_DEFAULT, &print_, &data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  ~QuietHdf5() { H5Eset_auto2(H5E_DEFAULT, print_, data_); }
  QuietHdf5(const QuietHdf5&) = delete;
  QuietHdf5& operator=(const QuietHdf5&) = delete;

 private:
  H5E_auto2_t print_ = nullptr;
  void* data_ = nullptr;
};

// Owns one HDF5 identifier.
class Handle {
 public:
  using Close = herr_t (*)(hid_t);
  Handle(hid_t id, Close close) : id_(id), close_(close) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  Handle& operator=(Handle&&) = delete;
  ~Handle() { reset(); }

  bool valid() const { return id_ >= 0; }
  hid_t id() const { return id_; }
  bool reset() {
    const QuietHdf5 quiet;  // closing writes what was held back, which may fail
    return id_ < 0 || close_(std::exchange(id_, -1)) >= 0;
  }

 private:
  hid_t id_;
  Close close_;
};

Error write_error(const std::filesystem::path& path, const std::string& what);
Error read_error(const std::filesystem::path& path, const std::string& field,
                 const std::string& found, const std::string& allowed);

// Throw Error(usage) and Error(bad_input). The first `user_bytes` of the file (0, or a power of 2
// from 512) stay the caller's own.
Handle create_hdf5(const std::filesystem::path& path, hsize_t user_bytes = 0);
Handle open_hdf5(const std::filesystem::path& path);

Handle untimed_dataset();                                    // creation properties
Handle deflated_dataset(const std::vector<hsize_t>& chunk);  // likewise, shuffled before
void write_dataset(const Handle& file, const std::filesystem::path& path, const char* name,
                   hid_t stored, hid_t memory, std::initializer_list<hsize_t> shape,
                   const void* data);

struct Dataset {
  Handle set;
  std::vector<hsize_t> shape;
};

// Opens a dataset and checks its class, shape and chunks; 0 in `expected` stands for any extent.
Dataset open_dataset(const Handle& file, const std::filesystem::path& path, const char* name,
                     H5T_class_t kind, const std::vector<hsize_t>& expected);

// T is one value of the type in memory, or an array of some that stand side by side.
template <class T>
std::vector<T> read_values(const Dataset& dataset, const std::filesystem::path& path,
                           const char* name, hid_t memory) {
  std::size_t count = 1;
  for (const hsize_t n : dataset.shape) count *= n;
  std::vector<T> values(count * H5Tget_size(memory) / sizeof(T));
  if (count > 0 &&
      H5Dread(dataset.set.id(), memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0) {
    throw read_error(path, name, "unreadable (truncated or damaged)", "a whole file");
  }
  return values;
}

}  // namespace viscera::hdf5
