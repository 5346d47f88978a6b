// trajectory.h5 and trajectory.xdmf: the mesh, and the positions of its points frame by frame.
//
//   /points     float64 [n][3]     rest positions, mm, LPS
//   /tets       int32   [m][4]
//   /labels     int32   [m]
//   /label_ids  int32   [k], /label_names  string [k]
//   /times      float64 [frames]          s
//   /positions  float32 [frames][n][3]    mm, LPS; chunked by frame, shuffled and deflated
//   /frames/0…  float32 [n][3]            views of /positions, one a frame, once the run is
//                                         finished: not every XDMF reader takes slabs
//
// HDF5's time stamps are off: equal content gives equal bytes. trajectory.xdmf opens in
// ParaView 5.11.
#pragma once

#include <filesystem>
#include <future>
#include <memory>
#include <vector>

#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

class TrajectoryWriter {
 public:
  // Creates `folder/trajectory.h5`; throws Error(usage) when it cannot.
  TrajectoryWriter(const std::filesystem::path& folder, const TetMesh& mesh);
  // Closes the file. What was appended stays readable, also after a kill, which may take the last.
  ~TrajectoryWriter();

  // 3 n values. Where this machine's HDF5 allows that, they are compressed and written while the
  // caller goes on: what goes wrong is thrown by the next call.
  void append(double time_s, std::vector<float> positions_mm);

  // Writes `folder/trajectory.xdmf` for the frames appended so far and closes both.
  void finish();

 private:
  struct File;
  void write(double time_s, const std::vector<float>& positions_mm);
  void wait();  // for the frame at hand

  std::unique_ptr<File> file_;
  std::future<void> writing_;
};

// Opens its file for as long as it reads: a study has thousands.
class TrajectoryReader {
 public:
  explicit TrajectoryReader(const std::filesystem::path& path);  // throws Error(bad_input)
  ~TrajectoryReader();

  const TetMesh& mesh() const;
  const std::vector<double>& times_s() const;
  std::vector<float> positions_mm(std::size_t frame) const;  // 3 n values

 private:
  struct File;
  void open(const std::filesystem::path& path);
  std::unique_ptr<File> file_;
};

std::string hdf5_version();

}  // namespace viscera
