// trajectory.h5 under libFuzzer. The fuzzer's bytes choose what is wrong with a file that HDF5
// itself takes for whole (hostile_hdf5.hpp), and it is read in this process. With FUZZ_BYTES they
// are the file, in which HDF5 crashes now and then: the reader finds that out in another process
// (trial_read.hpp), which is slow.
#include <cstdlib>

#include "stages/trajectory/trajectory_io.hpp"
#include "tests/fuzz/fuzz_file.hpp"
#ifndef FUZZ_BYTES
#include "pipeline/base/trial_read.hpp"
#include "tests/fuzz/hostile_hdf5.hpp"

// In place of the library's: no other process.
std::string viscera::what_breaks_reading(const std::filesystem::path&,
                                         const std::function<void()>&) {
  return "";
}
#endif

namespace {

using namespace viscera;
namespace fs = std::filesystem;

// What a user of the reader may rely on.
void check(const TrajectoryReader& reader) {
  const TetMesh& mesh = reader.mesh();
  if (mesh.labels.size() != mesh.tets.size()) std::abort();
  for (const auto& tet : mesh.tets)
    for (const int corner : tet)
      if (corner < 0 || static_cast<std::size_t>(corner) >= mesh.points.size()) std::abort();
  for (std::size_t frame = 0; frame < reader.times_s().size(); ++frame)
    if (reader.positions_mm(frame).size() != 3 * mesh.points.size()) std::abort();
}

#ifndef FUZZ_BYTES
// Two tets, two frames.
const std::vector<fuzz::Expected>& expected() {
  static const std::vector<fuzz::Expected> datasets = {
      {"/points", true, {5, 3}, {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1}},
      {"/tets", false, {2, 4}, {0, 1, 2, 3, 1, 4, 2, 3}},
      {"/labels", false, {2}, {1, 7}},
      {"/label_ids", false, {2}, {1, 7}},
      {"/label_names", false, {2}, {}, 6, std::string("liver\0tumour", 12)},
      {"/times", true, {2}, {0.0, 0.04}},
      {"/positions", true, {2, 5, 3}, {}}};
  return datasets;
}
#endif

fs::path file_of(const std::uint8_t* bytes, std::size_t size) {
#ifdef FUZZ_BYTES
  return fuzz::as_file("trajectory.h5", bytes, size);
#else
  const fs::path path = fuzz::folder() / "trajectory.h5";
  fuzz::Choices choices(bytes, size);
  fuzz::write_hostile_hdf5(path, 0, expected(), choices);
  return path;
#endif
}

}  // namespace

#ifndef FUZZ_BYTES
extern "C" int LLVMFuzzerInitialize(int*, char***) {
  check(TrajectoryReader(file_of(nullptr, 0)));  // throws unless the file is as it should be
  return 0;
}
#endif

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  const fs::path path = file_of(bytes, size);
  fuzz::may_refuse([&path] { check(TrajectoryReader(path)); });
  return 0;
}
