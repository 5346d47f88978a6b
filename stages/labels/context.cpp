#include "stages/labels/context.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "stages/image/image_io.hpp"
#include "stages/labels/dicom_stack.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

// Of two machines or sessions: equal numbers are other places then.
void check_frame(const DicomPlane& plane, const std::string& wanted) {
  const std::string& found = plane.frame_of_reference;
  if (wanted.empty() || found.empty() || found == wanted) return;
  throw bad_image(plane.file, "FrameOfReferenceUID", found, wanted + ", that of the labels",
                  "give the series that was segmented, or one registered to it");
}

ScalarImage read_series(const fs::path& folder, const std::string& frame_of_reference) {
  std::vector<DicomPlane> planes;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with('.') && name != "DICOMDIR")
      planes.push_back(read_dicom_values(entry.path()));
  }
  if (planes.empty())
    throw bad_image(folder, "", "an empty folder", "the DICOM files of one series", "");
  std::sort(planes.begin(), planes.end(),
            [](const DicomPlane& a, const DicomPlane& b) { return a.file < b.file; });
  check_frame(planes.front(), frame_of_reference);
  DicomStack stack = stack_planes(std::move(planes), false);
  orthonormalise(folder, stack.frame);
  return {stack.frame, std::move(stack.values)};
}

ScalarImage read_any(const fs::path& path, const std::string& frame_of_reference) {
  if (fs::is_directory(path)) return read_series(path, frame_of_reference);
  if (is_dicom(path)) {
    throw bad_image(path, "SOPClassUID", "a single DICOM file", "the folder of the series",
                    "give the folder");
  }
  return read_scalar_image(path);
}

using Point = std::array<double, 3>;
struct Box {
  Point lo, hi;
};

// Of the voxel centres, in LPS or, given the frame of another grid, in that one's voxels.
Box box_of(const Frame& frame, const Frame* in = nullptr) {
  Box box;
  box.lo.fill(std::numeric_limits<double>::infinity());
  box.hi.fill(-box.lo[0]);
  for (int corner = 0; corner < 8; ++corner) {
    Point p;
    for (int a = 0; a < 3; ++a) p[a] = (corner >> a & 1 ? frame.size[a] - 1 : 0) * frame.spacing[a];
    p = frame.to_lps(p);
    if (in != nullptr) p = in->from_lps(p);
    for (int a = 0; a < 3; ++a) {
      const double x = in == nullptr ? p[a] : p[a] / in->spacing[a];
      box.lo[a] = std::min(box.lo[a], x);
      box.hi[a] = std::max(box.hi[a], x);
    }
  }
  return box;
}

std::string text(const Box& box) {
  const auto& [lo, hi] = box;
  return fmt::format("({:.0f}, {:.0f}, {:.0f}) to ({:.0f}, {:.0f}, {:.0f}) mm, LPS", lo[0], lo[1],
                     lo[2], hi[0], hi[1], hi[2]);
}

Error elsewhere(const fs::path& path, const Frame& image, const Frame& labels) {
  return bad_image(path, "grid",
                   fmt::format("it spans {} and meets no label; the labels span {}",
                               text(box_of(image)), text(box_of(labels))),
                   "the CT that was segmented, in its patient's coordinates",
                   "give that CT, or leave 'image' out");
}

// The part of the image that the box of the labels lies in, a voxel more on each side.
ScalarImage cut(const fs::path& path, const ScalarImage& image, const Frame& labels) {
  const Frame& from = image.frame;
  const Box box = box_of(labels, &from);
  std::array<int, 3> first{};
  ScalarImage part{.frame = from};
  for (int a = 0; a < 3; ++a) {
    const double last = std::min(std::ceil(box.hi[a]) + 1.0, from.size[a] - 1.0);
    const double begin = std::max(std::floor(box.lo[a]) - 1.0, 0.0);
    if (!(begin <= last)) throw elsewhere(path, from, labels);
    first[a] = static_cast<int>(begin);
    part.frame.size[a] = static_cast<int>(last) - first[a] + 1;
  }
  part.frame.origin = from.to_lps(
      {first[0] * from.spacing[0], first[1] * from.spacing[1], first[2] * from.spacing[2]});
  const auto& size = part.frame.size;
  part.values.reserve(part.frame.voxels());
  for (int k = 0; k < size[2]; ++k)
    for (int j = 0; j < size[1]; ++j) {
      const auto row = image.values.begin() + static_cast<std::ptrdiff_t>(
                                                  from.index(first[0], first[1] + j, first[2] + k));
      part.values.insert(part.values.end(), row, row + size[0]);
    }
  return part;
}

void check_finite(const fs::path& path, const ScalarImage& image) {
  const auto bad = std::find_if_not(image.values.begin(), image.values.end(),
                                    [](float value) { return std::isfinite(value); });
  if (bad == image.values.end()) return;
  throw bad_image(path, "voxel values",
                  fmt::format("{} at voxel {}", *bad, bad - image.values.begin()),
                  "finite numbers (Hounsfield units)", "export the CT again");
}

// What the image measures in the voxels of one label.
struct Measured {
  std::size_t voxels = 0, covered = 0;
  double sum = 0.0, squares = 0.0;
  double mean() const { return sum / static_cast<double>(covered); }
  double deviation() const {
    return std::sqrt(std::max(0.0, squares / static_cast<double>(covered) - mean() * mean()));
  }
};

std::map<int, Measured> measure(const ScalarImage& image, const LabelImage& labels) {
  std::map<int, Measured> found;
  const Frame& frame = labels.frame;
  for (int k = 0; k < frame.size[2]; ++k)
    for (int j = 0; j < frame.size[1]; ++j)
      for (int i = 0; i < frame.size[0]; ++i) {
        const int id = labels.voxels[frame.index(i, j, k)];
        if (id == 0) continue;
        Measured& measured = found[id];
        ++measured.voxels;
        const auto at = voxel_at(
            image.frame,
            frame.to_lps({i * frame.spacing[0], j * frame.spacing[1], k * frame.spacing[2]}));
        if (!at) continue;
        ++measured.covered;
        const double value = image.values[*at];
        measured.sum += value;
        measured.squares += value * value;
      }
  return found;
}

}  // namespace

void pass_on_image(StageRun& run, const LabelImage& labels, const std::string& frame_of_reference) {
  const fs::path path = run.input("image");
  const ScalarImage part = cut(path, read_any(path, frame_of_reference), labels.frame);
  check_finite(path, part);
  Json list = Json::array();
  Measured all;
  for (const auto& [id, found] : measure(part, labels)) {
    all.voxels += found.voxels;
    all.covered += found.covered;
    if (found.covered == 0) continue;
    list.push_back({{"name", labels.names.at(id)},
                    {"id", id},
                    {"mean_hu", found.mean()},
                    {"deviation_hu", found.deviation()}});
  }
  if (all.covered == 0) throw elsewhere(path, part.frame, labels.frame);
  const auto [lo, hi] = std::minmax_element(part.values.begin(), part.values.end());
  const double covered = static_cast<double>(all.covered) / static_cast<double>(all.voxels);
  log::info("image: {:g} to {:g} HU around the labels", *lo, *hi);
  if (covered < 1.0)
    log::warn("{}: {:.1f} % of the labelled voxels lie outside of it", path.string(),
              100.0 * (1.0 - covered));
  if (*lo >= 0.0f) {
    log::warn("{}: no value below 0: a CT in Hounsfield units holds air and fat", path.string());
  }
  run.metric("image", Json{{"lo_hu", *lo}, {"hi_hu", *hi}, {"covered", covered}, {"labels", list}});
  write_nrrd(run.out("image.nrrd"), part);
}

}  // namespace viscera
