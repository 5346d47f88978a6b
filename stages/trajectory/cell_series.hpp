// What the tets of a trajectory have in every frame, beside it: NAME.h5 and NAME.xdmf, which opens
// both in ParaView.
//
//   /FIELD/0…   float32 [tets], one a frame; deflated
#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace viscera {

class CellSeriesWriter {
 public:
  // Throws Error(usage) when the file cannot be written. Names of fields have their unit.
  CellSeriesWriter(const std::filesystem::path& folder, const std::string& name,
                   std::vector<std::string> fields, std::size_t points, std::size_t tets);
  ~CellSeriesWriter();

  // [fields][tets], of the next frame of the trajectory.
  void append(double time_s, std::span<const std::vector<float>> values);
  void finish();

 private:
  struct File;
  std::unique_ptr<File> file_;
};

}  // namespace viscera
