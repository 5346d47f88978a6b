// What the header of a volume promises, read by bounded code of our own and held against the bytes
// that are there before a library allocates by it: a file of 400 bytes may ask for gigabytes, and a
// gzip stream may hold a thousand times its size.
//
// Pixel formats: whole and floating numbers of 1 to 8 bytes, one per voxel (NRRD: several layers,
// as 3D Slicer writes them where segments overlap). At most 2^29 numbers in all.
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>

#include "pipeline/base/error.hpp"

namespace viscera {

enum class ImageFormat { nifti, nrrd, meta };

struct ImageHeader {
  std::filesystem::path path;
  ImageFormat format = ImageFormat::nrrd;
  std::array<int, 3> size{};                  // voxels
  int layers = 1;                             // numbers per voxel
  std::string pixel_type;                     // "uint8"
  std::map<std::string, std::string> fields;  // NRRD: its key/value pairs ("Segment0_Name")
  std::string extension;                      // NIfTI: text of its header extensions

  std::size_t voxels() const {
    return static_cast<std::size_t>(size[0]) * static_cast<std::size_t>(size[1]) *
           static_cast<std::size_t>(size[2]);
  }
};

// Throws Error(bad_input) naming file and field: another format, fields that are missing or make no
// sense, sizes out of range, spacings or axes that are not finite or span no volume, data that are
// cut off or far longer than promised, a detached data file that is absent or lies outside the
// header's folder.
ImageHeader read_image_header(const std::filesystem::path& path);

// The error of a volume: exit code bad_input.
Error bad_image(const std::filesystem::path& path, std::string field, std::string found,
                std::string allowed, std::string remedy);

inline constexpr const char* image_formats =
    "a whole NIfTI (.nii, .nii.gz), NRRD (.nrrd, .nhdr) or MetaImage (.mha, .mhd)";

}  // namespace viscera
