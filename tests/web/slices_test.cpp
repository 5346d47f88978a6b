// The slices of the CT show what lies at their places, as a radiologist looks at them, whatever the
// grids of CT and labels are.
#include "stages/report/slices.hpp"

#include <gtest/gtest.h>
#include <zlib.h>

#include "pipeline/base/atomic_file.hpp"
#include "stages/image/image_io.hpp"
#include "tests/geometry/shapes.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

// Of one plane, its middle slice.
struct Slice {
  int width = 0, height = 0;
  double across = 0.0;  // mm
  std::vector<std::uint8_t> grey, ids;
  int grey_at(int x, int y) const { return grey[static_cast<std::size_t>(y * width + x)]; }
  int id_at(int x, int y) const { return ids[static_cast<std::size_t>(y * width + x)]; }
};

class SlicesOfACt : public ::testing::Test {
 protected:
  // HU is `slope` times the LPS coordinate `axis` from the balls' middle.
  ScalarImage ramp(int axis, const std::array<double, 9>& direction) const {
    ScalarImage image;
    image.frame = {.size = {60, 50, 40}, .spacing = {1.5, 1.8, 2.2}, .direction = direction};
    std::array<double, 3> half{};
    for (int a = 0; a < 3; ++a) half[a] = -0.5 * (image.frame.size[a] - 1) * image.frame.spacing[a];
    half = image.frame.to_lps(half);
    for (int a = 0; a < 3; ++a) image.frame.origin[a] = middle()[a] + half[a];
    const auto& f = image.frame;
    for (int k = 0; k < f.size[2]; ++k)
      for (int j = 0; j < f.size[1]; ++j)
        for (int i = 0; i < f.size[0]; ++i) {
          const auto p = f.to_lps({i * f.spacing[0], j * f.spacing[1], k * f.spacing[2]});
          image.values.push_back(40.0f + 4.0f * static_cast<float>(p[axis] - middle()[axis]));
        }
    return image;
  }
  std::array<double, 3> middle() const {
    std::array<double, 3> p{};
    for (int a = 0; a < 3; ++a) p[a] = 0.5 * (labels_.frame.size[a] - 1) * labels_.frame.spacing[a];
    return labels_.frame.to_lps(p);
  }
  std::vector<Slice> shown(const ScalarImage& image) {
    write_nrrd(folder_.path() / "ct.nrrd", image);
    write_nrrd(folder_.path() / "labels.nrrd", labels_);
    const Slices made = slices_of(folder_.path() / "ct.nrrd", folder_.path() / "labels.nrrd");
    std::size_t total = 0;
    for (const auto& plane : made.meta["planes"])
      total += 2 * plane["at_mm"].size() * plane["width"].get<std::size_t>() *
               plane["height"].get<std::size_t>();
    std::vector<std::uint8_t> bytes(total);
    uLongf size = total;
    EXPECT_EQ(uncompress(bytes.data(), &size, reinterpret_cast<const Bytef*>(made.packed.data()),
                         made.packed.size()),
              Z_OK);
    EXPECT_EQ(size, total);
    std::vector<Slice> slices;
    auto at = bytes.begin();
    for (const auto& plane : made.meta["planes"]) {
      Slice slice{.width = plane["width"], .height = plane["height"]};
      const auto pixels = static_cast<std::ptrdiff_t>(slice.width) * slice.height;
      const std::size_t number = plane["at_mm"].size(), chosen = number / 2;
      slice.across = plane["at_mm"][chosen];
      const auto begin = at + static_cast<std::ptrdiff_t>(2 * chosen) * pixels;
      slice.grey.assign(begin, begin + pixels);
      slice.ids.assign(begin + pixels, begin + 2 * pixels);
      slices.push_back(slice);
      at += static_cast<std::ptrdiff_t>(2 * number) * pixels;
    }
    return slices;
  }
  TemporaryFolder folder_{fs::temp_directory_path()};
  LabelImage labels_ = testing::nested_balls();
};

constexpr std::array<double, 9> straight{1, 0, 0, 0, 1, 0, 0, 0, 1};

TEST_F(SlicesOfACt, LeftFrontAndHeadLieWhereARadiologistLooksForThem) {
  for (const auto& direction : {straight, std::array<double, 9>{0, -1, 0, 1, 0, 0, 0, 0, 1},
                                std::array<double, 9>{-1, 0, 0, 0, 0, 1, 0, -1, 0}}) {
    const auto check = [](const Slice& s, int right, int down) {
      const int x = s.width / 2, y = s.height / 2;
      EXPECT_EQ((s.grey_at(x + 8, y) > s.grey_at(x, y)) - (s.grey_at(x + 8, y) < s.grey_at(x, y)),
                right);
      EXPECT_EQ((s.grey_at(x, y + 8) > s.grey_at(x, y)) - (s.grey_at(x, y + 8) < s.grey_at(x, y)),
                down);
    };
    const auto left = shown(ramp(0, direction));  // brighter to the patient's left
    check(left[0], 1, 0);
    check(left[1], 1, 0);
    check(left[2], 0, 0);
    const auto back = shown(ramp(1, direction));
    check(back[0], 0, 1);
    check(back[1], 0, 0);
    check(back[2], 1, 0);
    const auto head = shown(ramp(2, direction));
    check(head[0], 0, 0);
    check(head[1], 0, -1);
    check(head[2], 0, -1);
  }
}

TEST_F(SlicesOfACt, LabelsAreNumberedBySizeAndLieAtTheirPlaces) {
  const auto slices = shown(ramp(0, straight));
  for (const Slice& s : slices) {
    EXPECT_EQ(s.id_at(0, 0), 0);
    EXPECT_GT(std::count(s.ids.begin(), s.ids.end(), 1), 300);
  }
  EXPECT_GT(std::count(slices[0].ids.begin(), slices[0].ids.end(), 2), 20);
}

TEST_F(SlicesOfACt, WhatLiesOutsideOfTheCtIsNoGrey) {
  ScalarImage image = ramp(0, straight);
  image.frame.origin[0] += 50.0;
  const auto slices = shown(image);
  EXPECT_EQ(slices[0].grey_at(2, slices[0].height / 2), 0);
  EXPECT_GT(slices[0].grey_at(slices[0].width - 2, slices[0].height / 2), 0);
}

}  // namespace
}  // namespace viscera
