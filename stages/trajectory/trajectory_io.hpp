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
#include <memory>
#include <span>
#include <vector>

#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

class TrajectoryWriter {
 public:
  // Creates `folder/trajectory.h5`; throws Error(usage) when it cannot.
  TrajectoryWriter(const std::filesystem::path& folder, const TetMesh& mesh);
  ~TrajectoryWriter();  // closes the file; what was appended stays readable

  void append(double time_s, std::span<const float> positions_mm);  // 3 n values

  // Writes `folder/trajectory.xdmf` for the frames appended so far and closes both.
  void finish();

 private:
  struct File;
  std::unique_ptr<File> file_;
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
