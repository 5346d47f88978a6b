// DICOM files plane by plane, through DCMTK: masks as single-frame images (0 and one other value)
// or as segmentation objects (DICOM SEG, binary or fractional), and the planes of a CT. Pixels are
// plain (little or big endian) or compressed without loss: RLE, JPEG, JPEG-LS.
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "stages/labels/runs.hpp"

namespace viscera {

struct DicomPlane {
  std::filesystem::path file;
  std::string series;                   // its UID
  std::string frame_of_reference;       // UID: planes with the same one share coordinates
  int segment = 1;                      // number within a segmentation object
  int value = 0;                        // of the mask in the file, 255; 0 when the plane is empty
  std::array<double, 3> position{};     // LPS mm, centre of the first pixel
  std::array<double, 6> orientation{};  // LPS directions along a row, along a column
  std::array<double, 2> spacing{};      // mm between rows, between columns
  double depth_spacing = 0.0;           // mm between planes, where the file says so
  std::array<int, 2> size{};            // columns, rows
  std::vector<Run> runs;                // pixel indices, row after row
  std::vector<float> values;            // of a CT: rescaled (HU), row after row; no runs then
};

struct DicomFile {
  std::vector<DicomPlane> planes;
  std::map<int, std::string> segments;  // names by number; empty for an image
};

// Whether the file begins as DICOM files do.
bool is_dicom(const std::filesystem::path& path);

// Throws Error(bad_input) naming file and attribute: attributes that are missing or no numbers,
// pixels compressed otherwise, sizes that the file cannot hold, values that are no mask.
DicomFile read_dicom(const std::filesystem::path& path);

// One plane of a CT, whatever its values. Throws as read_dicom.
DicomPlane read_dicom_values(const std::filesystem::path& path);

}  // namespace viscera
