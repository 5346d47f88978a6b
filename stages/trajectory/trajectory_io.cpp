#include "stages/trajectory/trajectory_io.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <utility>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/trial_read.hpp"
#include "pipeline/contract/label_name.hpp"
#include "stages/trajectory/hdf5_file.hpp"
#include "stages/trajectory/xdmf.hpp"

namespace viscera {
namespace fs = std::filesystem;
using namespace hdf5;
namespace {

// Debian's is; else another file must not be read or written meanwhile (the checkpoints of a run).
bool is_threadsafe() {
  hbool_t is = false;
  return H5is_library_threadsafe(&is) >= 0 && is;
}

Handle string_type(std::size_t size) {
  Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type.id(), size);
  H5Tset_strpad(type.id(), H5T_STR_NULLPAD);
  H5Tset_cset(type.id(), H5T_CSET_UTF8);
  return type;
}

// A dataset that grows by one chunk per frame.
Handle create_growing(const Handle& file, const fs::path& path, const char* name, hid_t stored,
                      std::vector<hsize_t> shape, const std::vector<hsize_t>& chunk,
                      bool compressed) {
  std::vector<hsize_t> limit = shape;
  limit[0] = H5S_UNLIMITED;
  const int rank = static_cast<int>(shape.size());
  const Handle space(H5Screate_simple(rank, shape.data(), limit.data()), H5Sclose);
  const Handle creation = compressed ? deflated_dataset(chunk) : untimed_dataset();
  if (!compressed) H5Pset_chunk(creation.id(), rank, chunk.data());
  Handle dataset(
      H5Dcreate2(file.id(), name, stored, space.id(), H5P_DEFAULT, creation.id(), H5P_DEFAULT),
      H5Dclose);
  if (!dataset.valid()) throw write_error(path, name);
  return dataset;
}

// Writes `data` as row `row` of a growing dataset whose rows have the shape `row_shape`.
bool append_row(const Handle& dataset, hsize_t row, const std::vector<hsize_t>& row_shape,
                hid_t memory, const void* data) {
  std::vector<hsize_t> extent{row + 1}, start{row}, count{1};
  for (const hsize_t n : row_shape) {
    extent.push_back(n);
    start.push_back(0);
    count.push_back(n);
  }
  if (H5Dset_extent(dataset.id(), extent.data()) < 0) return false;
  const Handle target(H5Dget_space(dataset.id()), H5Sclose);
  const Handle source(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr),
                      H5Sclose);
  return H5Sselect_hyperslab(target.id(), H5S_SELECT_SET, start.data(), nullptr, count.data(),
                             nullptr) >= 0 &&
         H5Dwrite(dataset.id(), memory, source.id(), target.id(), H5P_DEFAULT, data) >= 0;
}

// Virtual datasets /frames/0, /frames/1, … that show one frame of /positions each.
bool write_frame_views(const Handle& file, const Handle& positions, hsize_t frames,
                       hsize_t points) {
  const Handle group_creation(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
  H5Pset_obj_track_times(group_creation.id(), false);
  const Handle group(
      H5Gcreate2(file.id(), "/frames", H5P_DEFAULT, group_creation.id(), H5P_DEFAULT), H5Gclose);
  const std::vector<hsize_t> shape{points, 3}, count{1, points, 3};
  const Handle view(H5Screate_simple(2, shape.data(), nullptr), H5Sclose);
  const Handle source(H5Dget_space(positions.id()), H5Sclose);
  bool good = group.valid();
  for (hsize_t frame = 0; good && frame < frames; ++frame) {
    const std::vector<hsize_t> start{frame, 0, 0};
    const Handle creation = untimed_dataset();
    H5Sselect_hyperslab(source.id(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr);
    H5Pset_virtual(creation.id(), view.id(), ".", "/positions", source.id());
    const Handle dataset(H5Dcreate2(group.id(), fmt::format("{}", frame).c_str(), H5T_IEEE_F32LE,
                                    view.id(), H5P_DEFAULT, creation.id(), H5P_DEFAULT),
                         H5Dclose);
    good = dataset.valid();
  }
  return good;
}

}  // namespace

struct TrajectoryWriter::File {
  fs::path folder, path;
  std::size_t points, tets;
  Handle file, times_set, positions_set;
  std::vector<double> times;
};

TrajectoryWriter::TrajectoryWriter(const fs::path& folder, const TetMesh& mesh) {
  const QuietHdf5 quiet;
  const fs::path path = folder / trajectory_name;
  if (mesh.points.empty() || mesh.labels.size() != mesh.tets.size()) {
    throw Error(ExitCode::bad_input,
                {.where = path.string(),
                 .field = "mesh",
                 .found = fmt::format("{} points, {} tets, {} labels", mesh.points.size(),
                                      mesh.tets.size(), mesh.labels.size()),
                 .allowed = "at least one point, and one label a tet"});
  }
  Handle file = create_hdf5(path);

  const hsize_t n = mesh.points.size(), m = mesh.tets.size(), k = mesh.label_names.size();
  std::vector<std::int32_t> ids;
  std::size_t longest = 1;
  for (const auto& [id, name] : mesh.label_names) {
    ids.push_back(id);
    longest = std::max(longest, name.size());
  }
  std::string names;  // k fields of `longest` bytes, padded with zeros
  for (const auto& [id, name] : mesh.label_names) {
    names += name + std::string(longest - name.size(), '\0');
  }
  const Handle text = string_type(longest);
  write_dataset(file, path, "/points", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, {n, 3},
                mesh.points.data());
  write_dataset(file, path, "/tets", H5T_STD_I32LE, H5T_NATIVE_INT, {m, 4}, mesh.tets.data());
  write_dataset(file, path, "/labels", H5T_STD_I32LE, H5T_NATIVE_INT, {m}, mesh.labels.data());
  write_dataset(file, path, "/label_ids", H5T_STD_I32LE, H5T_NATIVE_INT32, {k}, ids.data());
  write_dataset(file, path, "/label_names", text.id(), text.id(), {k}, names.data());
  Handle times = create_growing(file, path, "/times", H5T_IEEE_F64LE, {0}, {1024}, false);
  Handle positions =
      create_growing(file, path, "/positions", H5T_IEEE_F32LE, {0, n, 3}, {1, n, 3}, true);
  file_ = std::make_unique<File>(File{folder,
                                      path,
                                      mesh.points.size(),
                                      mesh.tets.size(),
                                      std::move(file),
                                      std::move(times),
                                      std::move(positions),
                                      {}});
}

TrajectoryWriter::~TrajectoryWriter() {
  if (writing_.valid()) writing_.wait();
}

void TrajectoryWriter::wait() {
  if (writing_.valid()) writing_.get();
}

void TrajectoryWriter::append(double time_s, std::vector<float> positions_mm) {
  File& f = *file_;
  if (positions_mm.size() != 3 * f.points) {
    throw Error(ExitCode::internal, {.where = f.path.string(),
                                     .field = "positions",
                                     .found = fmt::format("{} values", positions_mm.size()),
                                     .allowed = fmt::format("{} values, 3 a point", 3 * f.points)});
  }
  wait();
  if (!is_threadsafe()) return write(time_s, positions_mm);
  writing_ = std::async(std::launch::async, [this, time_s, positions = std::move(positions_mm)] {
    write(time_s, positions);
  });
}

void TrajectoryWriter::write(double time_s, const std::vector<float>& positions_mm) {
  const QuietHdf5 quiet;
  File& f = *file_;
  const hsize_t row = f.times.size();
  // Flushed every frame, so that a killed run leaves its frames readable.
  if (!append_row(f.positions_set, row, {f.points, 3}, H5T_NATIVE_FLOAT, positions_mm.data()) ||
      !append_row(f.times_set, row, {}, H5T_NATIVE_DOUBLE, &time_s) ||
      H5Fflush(f.file.id(), H5F_SCOPE_GLOBAL) < 0) {
    throw write_error(f.path, fmt::format("frame {}", row));
  }
  f.times.push_back(time_s);
}

void TrajectoryWriter::finish() {
  wait();
  const QuietHdf5 quiet;
  File& f = *file_;
  if (!write_frame_views(f.file, f.positions_set, f.times.size(), f.points)) {
    throw write_error(f.path, "/frames");
  }
  const bool closed = f.positions_set.reset() & f.times_set.reset() & f.file.reset();
  if (!closed) throw write_error(f.path, "file");
  write_atomically(f.folder / "trajectory.xdmf", xdmf(f.points, f.tets, f.times, "", {}));
}

struct TrajectoryReader::File {
  fs::path path;
  TetMesh mesh;
  std::vector<double> times;
};

namespace {

std::map<int, std::string> read_label_names(const Handle& file, const fs::path& path) {
  const auto id_set = open_dataset(file, path, "/label_ids", H5T_INTEGER, {0});
  const auto ids = read_values<int>(id_set, path, "/label_ids", H5T_NATIVE_INT);
  const auto name_set = open_dataset(file, path, "/label_names", H5T_STRING, {id_set.shape[0]});
  const Handle type(H5Dget_type(name_set.set.id()), H5Tclose);
  if (H5Tis_variable_str(type.id()) > 0) {
    throw read_error(path, "/label_names", "strings of variable length", "fixed-length strings");
  }
  const std::size_t size = H5Tget_size(type.id());
  std::vector<char> bytes(size * ids.size());
  if (!bytes.empty() &&
      H5Dread(name_set.set.id(), type.id(), H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data()) < 0) {
    throw read_error(path, "/label_names", "unreadable (truncated or damaged)", "a whole file");
  }
  std::map<int, std::string> names;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const char* begin = bytes.data() + i * size;
    std::string& name = names[ids[i]];
    if (size > 0) name.assign(begin, strnlen(begin, size));  // a damaged type may have none
    check_label_name(name, ExitCode::bad_input, path.string(), "/label_names");
  }
  return names;
}

TetMesh read_mesh(const Handle& file, const fs::path& path) {
  TetMesh mesh;
  const auto points = open_dataset(file, path, "/points", H5T_FLOAT, {0, 3});
  // Without a copy: a compressed file may hold a thousand times its size.
  mesh.points = read_values<std::array<double, 3>>(points, path, "/points", H5T_NATIVE_DOUBLE);
  for (const auto& point : mesh.points) {
    if (std::ranges::all_of(point, [](double x) { return std::isfinite(x); })) continue;
    throw read_error(path, "/points", "a coordinate that is not finite", "finite coordinates");
  }
  if (mesh.points.empty()) throw read_error(path, "/points", "no points", "at least one point");

  const auto tets = open_dataset(file, path, "/tets", H5T_INTEGER, {0, 4});
  mesh.tets = read_values<std::array<int, 4>>(tets, path, "/tets", H5T_NATIVE_INT);
  if (mesh.tets.empty()) throw read_error(path, "/tets", "no tets", "at least one tet");
  const int n = static_cast<int>(mesh.points.size());
  for (const auto& tet : mesh.tets) {
    if (std::ranges::all_of(tet, [n](int i) { return i >= 0 && i < n; })) continue;
    throw read_error(path, "/tets", "a point index out of range", fmt::format("0 to {}", n - 1));
  }

  const auto labels = open_dataset(file, path, "/labels", H5T_INTEGER, {tets.shape[0]});
  mesh.labels = read_values<int>(labels, path, "/labels", H5T_NATIVE_INT);
  mesh.label_names = read_label_names(file, path);
  return mesh;
}

}  // namespace

void TrajectoryReader::open(const fs::path& path) {
  const QuietHdf5 quiet;
  const Handle file = open_hdf5(path);
  TetMesh mesh = read_mesh(file, path);
  const auto time_set = open_dataset(file, path, "/times", H5T_FLOAT, {0});
  auto times = read_values<double>(time_set, path, "/times", H5T_NATIVE_DOUBLE);
  const auto positions =
      open_dataset(file, path, "/positions", H5T_FLOAT, {0, mesh.points.size(), 3});
  // A run that was killed between the two writes of a frame has one position more than times.
  times.resize(std::min<std::size_t>(times.size(), positions.shape[0]));
  file_ = std::make_unique<File>(File{path, std::move(mesh), std::move(times)});
}

TrajectoryReader::TrajectoryReader(const fs::path& path) {
  const auto read_all = [this, &path] {
    open(path);
    for (std::size_t frame = 0; frame < times_s().size(); ++frame) positions_mm(frame);
  };
  const std::string broken = what_breaks_reading(path, read_all);
  if (!broken.empty()) throw read_error(path, "file", broken, "a whole file");
  open(path);
}

TrajectoryReader::~TrajectoryReader() = default;

const TetMesh& TrajectoryReader::mesh() const {
  return file_->mesh;
}

const std::vector<double>& TrajectoryReader::times_s() const {
  return file_->times;
}

std::vector<float> TrajectoryReader::positions_mm(std::size_t frame) const {
  const QuietHdf5 quiet;
  const File& f = *file_;
  if (frame >= f.times.size()) {
    throw Error(ExitCode::internal, {.where = f.path.string(),
                                     .field = "frame",
                                     .found = fmt::format("{}", frame),
                                     .allowed = fmt::format("below {}", f.times.size())});
  }
  const std::size_t n = f.mesh.points.size();
  const Handle file = open_hdf5(f.path);
  const auto positions = open_dataset(file, f.path, "/positions", H5T_FLOAT, {0, n, 3});
  const std::vector<hsize_t> start{frame, 0, 0}, count{1, n, 3};
  const Handle source(H5Dget_space(positions.set.id()), H5Sclose);
  const Handle target(H5Screate_simple(3, count.data(), nullptr), H5Sclose);
  H5Sselect_hyperslab(source.id(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr);
  std::vector<float> values(3 * n);
  const std::string field = fmt::format("/positions of frame {}", frame);
  if (H5Dread(positions.set.id(), H5T_NATIVE_FLOAT, target.id(), source.id(), H5P_DEFAULT,
              values.data()) < 0) {
    throw read_error(f.path, field, "unreadable (truncated or damaged)", "a whole file");
  }
  if (!std::all_of(values.begin(), values.end(), [](float x) { return std::isfinite(x); })) {
    throw read_error(f.path, field, "a coordinate that is not finite", "finite coordinates");
  }
  return values;
}

std::string hdf5_version() {
  const QuietHdf5 quiet;
  unsigned major = 0, minor = 0, release = 0;
  H5get_libversion(&major, &minor, &release);
  return fmt::format("{}.{}.{}", major, minor, release);
}

}  // namespace viscera
