#include "stages/trajectory/hdf5_file.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace viscera::hdf5 {
namespace fs = std::filesystem;
namespace {

// File locks are advisory and absent on some network file systems: go on without them there.
Handle file_access() {
  Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_file_locking(access.id(), true, true);
  return access;
}

std::string shown(const std::vector<hsize_t>& shape) {
  std::string text;
  for (const hsize_t n : shape) text += fmt::format("[{}]", n);
  return text;
}

// What deflate can make of one byte, rounded up.
constexpr double max_expansion = 1100.0;

// The extents in a header may say anything: what is stored tells how many values there can be.
void check_claim(const Dataset& dataset, const fs::path& path, const char* name,
                 std::size_t value_bytes) {
  double claimed = static_cast<double>(value_bytes);
  for (const hsize_t n : dataset.shape) claimed *= static_cast<double>(n);
  const Handle creation(H5Dget_create_plist(dataset.set.id()), H5Pclose);
  const double stored = std::min(static_cast<double>(H5Dget_storage_size(dataset.set.id())),
                                 static_cast<double>(fs::file_size(path)));
  const double most = H5Pget_nfilters(creation.id()) > 0 ? max_expansion * stored : stored;
  if (claimed > most) {
    throw read_error(path, name,
                     fmt::format("shape {}, {:.0f} bytes stored", shown(dataset.shape), stored),
                     "no more values than are stored");
  }
}

// Bytes that a chunk of any dataset may have. Ours are 8 KB of times and single frames; the chunks
// that h5repack chooses by itself have up to 32 MiB, h5py's up to 1 MiB.
constexpr double min_chunk_limit = 32.0 * 1024 * 1024;

// HDF5 unpacks a whole chunk, in buffers of its size, however few of its values are asked for. So a
// chunk that is large holds no more than a row: of positions a frame, which is read at once.
void check_chunk(const Dataset& dataset, const fs::path& path, const char* name,
                 std::size_t value_bytes) {
  const Handle creation(H5Dget_create_plist(dataset.set.id()), H5Pclose);
  if (H5Pget_layout(creation.id()) != H5D_CHUNKED) return;
  std::vector<hsize_t> chunk(dataset.shape.size());
  H5Pget_chunk(creation.id(), static_cast<int>(chunk.size()), chunk.data());
  double chunk_bytes = static_cast<double>(value_bytes), row_bytes = chunk_bytes;
  for (const hsize_t n : chunk) chunk_bytes *= static_cast<double>(n);
  for (std::size_t i = 1; i < dataset.shape.size(); ++i) {
    row_bytes *= static_cast<double>(dataset.shape[i]);
  }
  const double most = std::max(row_bytes, min_chunk_limit);
  if (chunk_bytes > most) {
    throw read_error(path, name,
                     fmt::format("chunks {} of {:.0f} bytes", shown(chunk), chunk_bytes),
                     fmt::format("chunks of at most {:.0f} bytes", most));
  }
}

// Links, views and external storage lead to other files or devices, and back to themselves: what
// HDF5 follows without end.
void refuse_elsewhere(const fs::path& path, const char* name, bool elsewhere) {
  if (!elsewhere) return;
  throw read_error(path, name, "a link, a view, or values that another file holds",
                   "a dataset whose values are in this file");
}

void check_link(const Handle& file, const fs::path& path, const char* name) {
  H5L_info_t link;
  if (H5Lget_info(file.id(), name, &link, H5P_DEFAULT) < 0) {
    throw read_error(path, name, "missing", "the datasets of a trajectory");
  }
  refuse_elsewhere(path, name, link.type != H5L_TYPE_HARD);
}

void check_storage(const Handle& set, const fs::path& path, const char* name) {
  const Handle creation(H5Dget_create_plist(set.id()), H5Pclose);
  refuse_elsewhere(
      path, name,
      H5Pget_layout(creation.id()) == H5D_VIRTUAL || H5Pget_external_count(creation.id()) != 0);
}

}  // namespace

Error write_error(const fs::path& path, const std::string& what) {
  return Error(ExitCode::usage, {.where = path.string(),
                                 .field = what,
                                 .found = "cannot be written",
                                 .remedy = "check the folder's permissions and free space"});
}

Error read_error(const fs::path& path, const std::string& field, const std::string& found,
                 const std::string& allowed) {
  return Error(ExitCode::bad_input, {.where = path.string(),
                                     .field = field,
                                     .found = found,
                                     .allowed = allowed,
                                     .remedy = "write the file again with viscera-simulate"});
}

Handle create_hdf5(const fs::path& path, hsize_t user_bytes) {
  const Handle creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
  H5Pset_userblock(creation.id(), user_bytes);
  H5Pset_obj_track_times(creation.id(), false);
  const Handle access = file_access();
  Handle file(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation.id(), access.id()), H5Fclose);
  if (!file.valid()) throw write_error(path, "file");
  return file;
}

Handle open_hdf5(const fs::path& path) {
  const Handle access = file_access();
  Handle file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, access.id()), H5Fclose);
  if (!file.valid()) {
    throw read_error(path, "file", "cannot be opened as HDF5 (absent, truncated or foreign)",
                     "a file written by viscera-simulate");
  }
  return file;
}

Handle untimed_dataset() {
  Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_obj_track_times(creation.id(), false);
  return creation;
}

Handle deflated_dataset(const std::vector<hsize_t>& chunk) {
  constexpr unsigned level = 4;
  Handle creation = untimed_dataset();
  H5Pset_chunk(creation.id(), static_cast<int>(chunk.size()), chunk.data());
  H5Pset_shuffle(creation.id());
  H5Pset_deflate(creation.id(), level);
  return creation;
}

void write_dataset(const Handle& file, const fs::path& path, const char* name, hid_t stored,
                   hid_t memory, std::initializer_list<hsize_t> shape, const void* data) {
  const Handle space(H5Screate_simple(static_cast<int>(shape.size()), shape.begin(), nullptr),
                     H5Sclose);
  const Handle creation = untimed_dataset();
  const Handle dataset(
      H5Dcreate2(file.id(), name, stored, space.id(), H5P_DEFAULT, creation.id(), H5P_DEFAULT),
      H5Dclose);
  const bool empty = std::find(shape.begin(), shape.end(), 0) != shape.end();
  if (!dataset.valid() ||
      (!empty && H5Dwrite(dataset.id(), memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) < 0)) {
    throw write_error(path, name);
  }
}

Dataset open_dataset(const Handle& file, const fs::path& path, const char* name, H5T_class_t kind,
                     const std::vector<hsize_t>& expected) {
  check_link(file, path, name);
  Handle set(H5Dopen2(file.id(), name, H5P_DEFAULT), H5Dclose);
  if (!set.valid()) throw read_error(path, name, "no dataset", "the datasets of a trajectory");
  check_storage(set, path, name);
  const Handle type(H5Dget_type(set.id()), H5Tclose);
  const Handle space(H5Dget_space(set.id()), H5Sclose);
  std::vector<hsize_t> shape(
      static_cast<std::size_t>(std::max(0, H5Sget_simple_extent_ndims(space.id()))));
  H5Sget_simple_extent_dims(space.id(), shape.data(), nullptr);
  bool fits = H5Tget_class(type.id()) == kind && shape.size() == expected.size();
  for (std::size_t i = 0; fits && i < shape.size(); ++i) {
    fits = expected[i] == 0 || shape[i] == expected[i];
  }
  if (!fits) {
    const char* wanted = kind == H5T_INTEGER ? "integers" : kind == H5T_FLOAT ? "reals" : "texts";
    throw read_error(path, name, "shape " + shown(shape) + " or another type",
                     fmt::format("{} of shape {} (0: any)", wanted, shown(expected)));
  }
  Dataset dataset{std::move(set), std::move(shape)};
  check_chunk(dataset, path, name, H5Tget_size(type.id()));
  check_claim(dataset, path, name, H5Tget_size(type.id()));
  return dataset;
}

}  // namespace viscera::hdf5
