// Volumes on disk, of labels or of measured numbers: NIfTI through its own library, NRRD and
// MetaImage through ITK; out as NRRD.
//
// Everything is LPS millimetres (NIfTI's RAS is turned round). At most 2^29 voxels; ids 0 to 65535.
#pragma once

#include <filesystem>
#include <optional>

#include "stages/image/frame_repair.hpp"
#include "stages/image/image_header.hpp"
#include "stages/image/label_image.hpp"

namespace viscera {

struct ImageNotes {
  std::string pixel_type;  // as stored, "uint8"
  FrameRepair repair;      // of axes that were not quite orthonormal
};

// A file as it is stored: one or several layers of ids.
struct Volume {
  Frame frame;
  std::vector<std::vector<std::uint16_t>> layers;
  ImageHeader header;
  ImageNotes notes;
};

struct ReadImage {
  LabelImage image;
  ImageNotes notes;
};

// Throws Error(bad_input) naming file and field for: whatever read_image_header refuses, values
// that are not whole numbers in [0, 65535], axes that orthonormalise (frame_repair.hpp) refuses.
Volume read_volume(const std::filesystem::path& path);

// The same for a volume of one layer, with the names that the file gives its ids.
ReadImage read_image(const std::filesystem::path& path);

// A volume of numbers, laid out as label_image.hpp says.
struct ScalarImage {
  Frame frame;
  std::vector<float> values;
};

// As read_image, of any numbers.
ScalarImage read_scalar_image(const std::filesystem::path& path);

// The voxel that holds a point (LPS mm), whose reach is half its size beyond its centre.
std::optional<std::size_t> voxel_at(const Frame& frame, const std::array<double, 3>& lps);

// gzip NRRD, uint8 when every id fits, otherwise uint16; names as key/value pairs `label_ID`.
// Deterministic bytes.
void write_nrrd(const std::filesystem::path& path, const LabelImage& image);

// The frame that read_image gives of the file that write_nrrd makes of this one, whose axes must be
// orthonormal: files hold the product of spacing and direction, which rounds.
Frame as_read_back(Frame frame);

// The same for numbers: int16 when each is whole and fits (Hounsfield units), otherwise float32.
void write_nrrd(const std::filesystem::path& path, const ScalarImage& image);

}  // namespace viscera
