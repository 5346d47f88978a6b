// Volumes on disk, of labels or of measured numbers: NIfTI, NRRD and MetaImage in, labels out as
// NRRD, through ITK.
//
// Everything is LPS millimetres (ITK turns NIfTI's RAS round). At most 2^29 voxels; ids 0 to 65535.
#pragma once

#include <filesystem>

#include "stages/common/label_image.hpp"

namespace viscera {

struct ImageNotes {
  std::string pixel_type;       // as stored, "uint8"
  double frame_shift_mm = 0.0;  // how far orthonormalising the axes moved a corner; 0: untouched
  double frame_skew = 0.0;      // largest |D^T D - 1| found
};

struct ReadImage {
  LabelImage image;
  ImageNotes notes;
};

// Throws Error(bad_input) naming the file for: not an image, truncated, not three-dimensional,
// more than one component, too large, values that are not whole numbers in [0, 65535], axes whose
// repair would move a corner by more than half a voxel.
//
// Axes that are not quite orthonormal are replaced by the nearest orthonormal ones (polar
// decomposition) about the centre of the volume; `notes` says by how much that moved the corners.
ReadImage read_image(const std::filesystem::path& path);

// A volume of numbers, laid out as label_image.hpp says.
struct ScalarImage {
  Frame frame;
  std::vector<float> values;
};

// As read_image, of any numbers.
ScalarImage read_scalar_image(const std::filesystem::path& path);

// gzip NRRD, uint8 when every id fits, otherwise uint16; names as key/value pairs `label_ID`.
// Deterministic bytes.
void write_nrrd(const std::filesystem::path& path, const LabelImage& image);

}  // namespace viscera
