// Well-formed image files as bytes, to be written, or spoilt first.
#pragma once

#include <nifti1.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace viscera::testing {

// A NIfTI-1 file of 8 x 6 x 4 int16 voxels with a block of `value` in it, and an sform.
struct NiftiFile {
  explicit NiftiFile(const std::array<float, 12>& sform = {2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0},
                     std::int16_t value = 1);
  nifti_1_header header{};
  std::string extensions;  // bytes between header and voxels; bytes() sets vox_offset
  std::string voxels;
  bool own_offset = false;  // leave vox_offset as it stands in `header`
  std::string bytes() const;
};

// One extension of a NIfTI header, padded to 16 bytes, its size and code in front.
std::string nifti_extension(const std::string& text);

std::string gzip(const std::string& bytes);

// A DICOM data set in explicit VR little endian: elements by tag (group << 16 | element).
struct DicomElement {
  std::string vr, value;
};
using DicomSet = std::map<std::uint32_t, DicomElement>;

std::string dicom_bytes(const DicomSet& set);
std::string dicom_file(const DicomSet& set, const std::string& syntax = "1.2.840.10008.1.2.1");

DicomElement text_element(const char* vr, std::string value);
DicomElement number_element(std::uint16_t value);
DicomElement sequence_element(const std::vector<DicomSet>& items);

// Plane k of a mask of 6 x 5 pixels of 1.5 x 1.25 mm (between columns, rows), planes 2 mm apart:
// 255 in columns 1 to 3 and rows 1 to 2 of every plane.
DicomSet dicom_plane(int k);
inline constexpr int dicom_columns = 6, dicom_rows = 5;

// The same place as plane k of a CT: 16 bits, `hu` everywhere, stored with slope 2 and intercept
// -1000.
DicomSet dicom_ct_plane(int k, int hu);

// A segmentation object of 8 x 4 pixels with the segments liver (planes 0 to 2) and tumour (plane 1
// alone), of 1.5 x 1.25 x 2 mm; liver covers columns 1 to 6 and rows 1 to 2, tumour the columns
// 2, 3.
DicomSet dicom_segmentation();

}  // namespace viscera::testing
