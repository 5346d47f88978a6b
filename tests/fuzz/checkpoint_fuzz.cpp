// checkpoint.h5 under libFuzzer. The fuzzer's bytes choose what is wrong with a file that HDF5
// takes for whole (hostile_hdf5.hpp); it gets the checksum that belongs to it, since one that does
// not is refused before anything is read.
#include <cmath>
#include <cstdlib>

#include "pipeline/base/digest.hpp"
#include "pipeline/base/trial_read.hpp"
#include "stages/simulate/files/checkpoint.hpp"
#include "tests/fuzz/fuzz_file.hpp"
#include "tests/fuzz/hostile_hdf5.hpp"

// In place of the library's: no other process.
std::string viscera::what_breaks_reading(const std::filesystem::path&,
                                         const std::function<void()>&) {
  return "";
}

namespace {

using namespace viscera;
namespace fs = std::filesystem;

constexpr sim::TimeGrid grid{.substeps = 32, .end_s = 4};
constexpr std::size_t vertices = 4, seal_bytes = 512;

const std::vector<fuzz::Expected>& expected() {
  static const std::vector<fuzz::Expected> datasets = {{"/substep", true, {1}, {grid.substep_s()}},
                                                       {"/step", false, {1}, {64}},
                                                       {"/u", true, {vertices, 3}, {}},
                                                       {"/v", true, {vertices, 3}, {}},
                                                       {"/history", true, {0}, {}},
                                                       {"/added_u", true, {vertices, 3}, {}},
                                                       {"/added_v", true, {vertices, 3}, {}},
                                                       {"/carried", true, {6, 3}, {}},
                                                       {"/held", true, {5}, {}},
                                                       {"/nodes", true, {7}, {}}};
  return datasets;
}

fs::path file_of(const std::uint8_t* bytes, std::size_t size) {
  const fs::path path = fuzz::folder() / "checkpoint.h5";
  fuzz::Choices choices(bytes, size);
  fuzz::write_hostile_hdf5(path, seal_bytes, expected(), choices);
  std::string whole = read_file(path);
  std::string seal = "viscera checkpoint, sha256 of what follows these 512 bytes:\n" +
                     sha256(std::string_view(whole).substr(seal_bytes)) + "\n";
  seal.resize(seal_bytes, ' ');
  write_atomically(path, whole.replace(0, seal_bytes, seal));
  return path;
}

void check(const sim::State& state) {
  if (state.u.size() != vertices || state.v.size() != vertices) std::abort();
  if (!state.finite() || state.step % grid.substeps != 0) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  check(read_checkpoint(file_of(nullptr, 0), vertices, grid));  // throws unless it is whole
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  const fs::path path = file_of(bytes, size);
  fuzz::may_refuse([&path] { check(read_checkpoint(path, vertices, grid)); });
  return 0;
}
