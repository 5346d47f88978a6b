// A segmentation as it arrives: named masks on one grid, which may overlap. Out of a label volume
// (NIfTI, NRRD, MetaImage), layers of 3D Slicer, DICOM masks, or several of these side by side.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "stages/image/image_io.hpp"
#include "stages/labels/runs.hpp"

namespace viscera {

struct Segment {
  int id = 0;
  std::string name;
  std::vector<Run> runs;
};

struct Segmentation {
  Frame frame;
  std::vector<Segment> segments;  // by id, none empty
  ImageNotes notes;
  std::string
      frame_of_reference;  // DICOM's UID of the coordinates; empty where the source has none
};

// What a file or folder holds:
//   a volume            a segment per value, under the name that its header gives it, or label_N
//   layers (.seg.nrrd)  a segment each; ids are the values, or 1, 2, … where layers repeat them
//   DICOM SEG           a segment each, with its number as id
//   a folder            of DICOM files: one mask, named after it; of folders: a mask each, by name
// Of several sources, each that holds one segment without a name of its own is named after its
// file, and the ids are 1, 2, … in the order given; all must lie on the grid of the first.
//
// Throws Error(bad_input) naming file and field; an empty segmentation is one.
Segmentation read_segmentation(const std::vector<std::filesystem::path>& sources);

// The same of a volume in memory: a segment per value, under its name or label_N. Errors call it
// `called`.
Segmentation segmentation_of(const LabelImage& image, const std::filesystem::path& called);

// The ids that make up one material; the first is its id from here on.
struct Material {
  std::string name;
  std::vector<int> ids;
};

// Voxels that two materials claim.
struct Overlap {
  int kept = 0, lost = 0;  // ids of the materials
  std::size_t voxels = 0;
};

// The volume of the materials. A voxel claimed by several goes to the one named last, or first.
LabelImage paint(const Segmentation& segmentation, const std::vector<Material>& materials,
                 bool last_wins, std::vector<Overlap>& overlaps);

}  // namespace viscera
