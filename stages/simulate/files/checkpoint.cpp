#include "stages/simulate/files/checkpoint.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "stages/trajectory/hdf5_file.hpp"

namespace viscera {
namespace fs = std::filesystem;
using namespace hdf5;
namespace {

constexpr const char* duals = "/carried";    // of runs in blocks
constexpr const char* added_u = "/added_u";  // by the last substep
constexpr const char* added_v = "/added_v";
constexpr const char* held = "/held";    // of runs whose elements hold their forces
constexpr const char* nodes = "/nodes";  // of finite elements
constexpr const char* of_body = "/body";

// The first bytes of the file, which HDF5 leaves to us (its user block): the digest of all others.
constexpr std::size_t seal_bytes = 512;

std::string seal_of(std::string_view content) {
  std::string seal =
      "viscera checkpoint, sha256 of what follows these 512 bytes:\n" + sha256(content) + "\n";
  seal.resize(seal_bytes, ' ');
  return seal;
}

void seal(const fs::path& path) {
  const std::string bytes = read_file(path);
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file << seal_of(std::string_view(bytes).substr(seal_bytes));
  if (!file.flush()) throw write_error(path, "file");
}

// HDF5 1.10 crashes on some damaged files, so they are told apart before it sees them.
void check_seal(const fs::path& path) {
  const std::string bytes = read_file(path);
  if (bytes.size() > seal_bytes &&
      bytes.starts_with(seal_of(std::string_view(bytes).substr(seal_bytes))))
    return;
  throw read_error(path, "file", "a checksum that is missing or not that of the content",
                   "a whole checkpoint of this version of viscera");
}

void write_reals(const Handle& file, const fs::path& path, const char* name,
                 std::initializer_list<hsize_t> shape, const void* data) {
  write_dataset(file, path, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, shape, data);
}

std::vector<double> read_reals(const Handle& file, const fs::path& path, const char* name,
                               const std::vector<hsize_t>& shape) {
  const Dataset set = open_dataset(file, path, name, H5T_FLOAT, shape);
  return read_values<double>(set, path, name, H5T_NATIVE_DOUBLE);
}

std::vector<sim::Vec3<double>> read_vectors(const Handle& file, const fs::path& path,
                                            const char* name, std::size_t count) {
  const std::vector<double> numbers = read_reals(file, path, name, {count, 3});
  if (!std::ranges::all_of(numbers, [](double x) { return std::isfinite(x); })) {
    throw read_error(path, name, "values that are not finite", "finite values");
  }
  std::vector<sim::Vec3<double>> vectors;
  for (std::size_t i = 0; i < numbers.size() / 3; ++i) {
    vectors.push_back({numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]});
  }
  return vectors;
}

}  // namespace

double fingerprint_of(const sim::Model& model) {
  const auto bytes_of = [](const auto& values) {
    return std::string_view(reinterpret_cast<const char*>(values.data()),
                            values.size() * sizeof(values[0]));
  };
  const std::string digest = sha256(std::string(bytes_of(model.rest)).append(bytes_of(model.tets)));
  return static_cast<double>(std::stoull(digest.substr(0, 13), nullptr, 16));  // 52 bits
}

void write_checkpoint(const fs::path& path, const sim::State& state, double substep_s,
                      std::optional<double> body) {
  const QuietHdf5 quiet;
  static_assert(sizeof(sim::Vec3<double>) == 3 * sizeof(double));
  Handle file = create_hdf5(path, seal_bytes);
  const hsize_t n = state.u.size();
  write_reals(file, path, "/u", {n, 3}, state.u.data());
  write_reals(file, path, "/v", {n, 3}, state.v.data());
  if (!state.added_u.empty()) {
    write_reals(file, path, added_u, {n, 3}, state.added_u.data());
    write_reals(file, path, added_v, {n, 3}, state.added_v.data());
  }
  write_reals(file, path, "/history", {state.history.size()}, state.history.data());
  if (!state.duals.empty()) {
    write_reals(file, path, duals, {state.duals.size(), 3}, state.duals.data());
  }
  if (!state.held.empty()) write_reals(file, path, held, {state.held.size()}, state.held.data());
  if (!state.nodes.empty())
    write_reals(file, path, nodes, {state.nodes.size()}, state.nodes.data());
  write_dataset(file, path, "/step", H5T_STD_U64LE, H5T_NATIVE_UINT64, {1}, &state.step);
  write_reals(file, path, "/substep", {1}, &substep_s);
  if (body) write_reals(file, path, of_body, {1}, &*body);
  if (!file.reset()) throw write_error(path, "file");
  seal(path);
}

sim::State read_checkpoint(const fs::path& path, std::size_t vertices, const sim::TimeGrid& time,
                           std::optional<double> body) {
  const QuietHdf5 quiet;
  check_seal(path);
  const Handle file = open_hdf5(path);
  const double substep = read_reals(file, path, "/substep", {1})[0];
  if (substep != time.substep_s()) {
    throw read_error(path, "/substep", fmt::format("{} s", substep),
                     fmt::format("{} s, the scene's", time.substep_s()));
  }
  if (body && H5Lexists(file.id(), of_body, H5P_DEFAULT) > 0 &&
      read_reals(file, path, of_body, {1})[0] != *body) {
    throw read_error(path, of_body, "that of another mesh with as many vertices",
                     "a checkpoint of a run on this mesh");
  }
  sim::State state{read_vectors(file, path, "/u", vertices),
                   read_vectors(file, path, "/v", vertices)};
  const Dataset step = open_dataset(file, path, "/step", H5T_INTEGER, {1});
  state.step = read_values<std::uint64_t>(step, path, "/step", H5T_NATIVE_UINT64)[0];
  state.history = read_reals(file, path, "/history", {0});
  if (H5Lexists(file.id(), added_u, H5P_DEFAULT) > 0) {
    state.added_u = read_vectors(file, path, added_u, vertices);
    state.added_v = read_vectors(file, path, added_v, vertices);
  }
  if (H5Lexists(file.id(), duals, H5P_DEFAULT) > 0) {
    state.duals = read_vectors(file, path, duals, 0);
  }
  if (H5Lexists(file.id(), held, H5P_DEFAULT) > 0) state.held = read_reals(file, path, held, {0});
  if (H5Lexists(file.id(), nodes, H5P_DEFAULT) > 0)
    state.nodes = read_reals(file, path, nodes, {0});
  const double reached = static_cast<double>(state.step) * substep;
  if (state.step % time.substeps != 0 || reached > time.end_s) {
    throw read_error(path, "/step", fmt::format("{}, time {:.6g} s", state.step, reached),
                     fmt::format("whole frames of {} substeps, up to the end at {:.6g} s",
                                 time.substeps, time.end_s));
  }
  return state;
}

}  // namespace viscera
