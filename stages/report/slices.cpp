#include "stages/report/slices.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "stages/image/image_io.hpp"
#include "stages/report/packed.hpp"

namespace viscera {
namespace {

constexpr double window_centre = 40.0, window_width = 400.0;  // HU: soft tissue
constexpr double margin = 12.0;                               // mm around the labels
constexpr int slices_across = 12, longest_side = 160;         // slices a plane, pixels

using Point = std::array<double, 3>;

struct Plane {
  const char* name;
  int across, right, down;  // LPS axes
  double right_sign, down_sign;
};

constexpr Plane planes[] = {{"axial", 2, 0, 1, 1.0, 1.0},
                            {"coronal", 1, 0, 2, 1.0, -1.0},
                            {"sagittal", 0, 1, 2, 1.0, -1.0}};

struct Box {
  Point lo, hi;
};

Box labelled_box(const LabelImage& labels) {
  Box box;
  box.lo.fill(std::numeric_limits<double>::infinity());
  box.hi.fill(-box.lo[0]);
  const Frame& frame = labels.frame;
  for (int k = 0; k < frame.size[2]; ++k)
    for (int j = 0; j < frame.size[1]; ++j)
      for (int i = 0; i < frame.size[0]; ++i) {
        if (labels.voxels[frame.index(i, j, k)] == 0) continue;
        const Point p =
            frame.to_lps({i * frame.spacing[0], j * frame.spacing[1], k * frame.spacing[2]});
        for (int a = 0; a < 3; ++a) {
          box.lo[a] = std::min(box.lo[a], p[a]);
          box.hi[a] = std::max(box.hi[a], p[a]);
        }
      }
  return box;
}

char grey(float hu) {
  const double t = (hu - window_centre) / window_width + 0.5;
  return static_cast<char>(1 + std::lround(254.0 * std::clamp(t, 0.0, 1.0)));
}

class Sampler {
 public:
  Sampler(const ScalarImage& image, const LabelImage& labels) : image_(image), labels_(labels) {
    std::map<int, std::size_t> sizes;
    for (const int id : labels.voxels) ++sizes[id];
    sizes.erase(0);
    std::vector<std::pair<std::size_t, int>> largest_first;
    for (const auto& [id, size] : sizes) largest_first.emplace_back(size, id);
    std::sort(largest_first.rbegin(), largest_first.rend());
    for (const auto& [size, id] : largest_first) {
      if (ids_.size() < 255) ids_.push_back(id);
      index_[id] = static_cast<int>(ids_.size());  // the smallest of very many share a number
    }
    index_[0] = 0;
  }
  const Json& ids() const { return ids_; }

  void add(const Point& p, std::string& greys, std::string& ids) const {
    const auto in_image = voxel_at(image_.frame, p), in_labels = voxel_at(labels_.frame, p);
    greys += in_image ? grey(image_.values[*in_image]) : '\0';
    ids += static_cast<char>(in_labels ? index_.at(labels_.voxels[*in_labels]) : 0);
  }

 private:
  const ScalarImage& image_;
  const LabelImage& labels_;
  std::map<int, int> index_;
  Json ids_ = Json::array();
};

}  // namespace

Slices slices_of(const std::filesystem::path& image_file,
                 const std::filesystem::path& labels_file) {
  const ScalarImage image = read_scalar_image(image_file);
  const LabelImage labels = read_image(labels_file).image;
  const Sampler sampler(image, labels);
  if (sampler.ids().empty()) {
    throw bad_image(labels_file, "voxel values", "all zero", "at least one labelled voxel",
                    "give the labels.nrrd of viscera-labels");
  }
  const Box body = labelled_box(labels);
  double pixel = *std::min_element(labels.frame.spacing.begin(), labels.frame.spacing.end());
  for (int a = 0; a < 3; ++a)
    pixel = std::max(pixel, (body.hi[a] - body.lo[a] + 2.0 * margin) / longest_side);

  Json meta{{"window_hu", {{"centre", window_centre}, {"width", window_width}}},
            {"pixel_mm", pixel},
            {"ids", sampler.ids()},
            {"planes", Json::array()}};
  std::string bytes;
  for (const Plane& plane : planes) {
    const auto pixels = [&](int axis) {
      return static_cast<int>(std::ceil((body.hi[axis] - body.lo[axis] + 2.0 * margin) / pixel));
    };
    const auto along = [&](int axis, double sign, int i) {
      const double middle = 0.5 * (body.lo[axis] + body.hi[axis]);
      return middle + sign * pixel * (i - 0.5 * (pixels(axis) - 1));
    };
    const int width = pixels(plane.right), height = pixels(plane.down);
    Json places = Json::array();
    for (int slice = 0; slice < slices_across; ++slice) {
      Point p{};
      p[plane.across] = body.lo[plane.across] + (slice + 0.5) / slices_across *
                                                    (body.hi[plane.across] - body.lo[plane.across]);
      places.push_back(p[plane.across]);
      std::string greys, ids;
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
          p[plane.right] = along(plane.right, plane.right_sign, x);
          p[plane.down] = along(plane.down, plane.down_sign, y);
          sampler.add(p, greys, ids);
        }
      bytes += greys + ids;
    }
    meta["planes"].push_back(
        {{"name", plane.name}, {"width", width}, {"height", height}, {"at_mm", places}});
  }
  return {std::move(meta), deflated(bytes)};
}

}  // namespace viscera
