// One body written with its axes flipped, permuted and turned, in every format, is one body in LPS.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "pipeline/base/atomic_file.hpp"
#include "stages/image/image_io.hpp"
#include "stages/image/label_field.hpp"
#include "stages/mesh/surface_mesh.hpp"
#include "stages/surface/contour.hpp"
#include "tests/geometry/shapes.hpp"
#include "tests/images/image_bytes.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;
using Point = std::array<double, 3>;

// An ellipsoid with a horn of its own along each axis: no symmetry hides a mirrored axis.
LabelImage horned() {
  LabelImage image = testing::draw(24, {1.5, 1.25, 2.0}, [](double x, double y, double z) {
    const bool body = std::hypot(x / 10.0, y / 8.0, z / 12.0) < 1.0;
    const bool horns = (x > 0 && x < 14 && std::abs(y - 2) < 3 && std::abs(z - 3) < 4) ||
                       (y > 0 && y < 12 && std::abs(x + 3) < 3 && std::abs(z + 4) < 4) ||
                       (z > 0 && z < 18 && std::abs(x - 2) < 3 && std::abs(y + 3) < 3);
    return body || horns ? 1 : 0;
  });
  image.frame.origin = {-40.5, 25.25, 310.0};
  return image;
}

// The same body on a grid whose axis a is axis order[a] of `image`, flipped where `flip` says.
LabelImage rearranged(const LabelImage& image, const std::array<int, 3>& order, int flip) {
  LabelImage result{.names = image.names};
  const Frame& from = image.frame;
  Frame& to = result.frame;
  Point corner{};
  for (int a = 0; a < 3; ++a) {
    const int b = order[a];
    const bool flipped = flip >> a & 1;
    to.size[a] = from.size[b];
    to.spacing[a] = from.spacing[b];
    corner[b] = flipped ? (from.size[b] - 1) * from.spacing[b] : 0.0;
    for (int r = 0; r < 3; ++r)
      to.direction[3 * r + a] = (flipped ? -1.0 : 1.0) * from.direction[3 * r + b];
  }
  to.origin = from.to_lps(corner);
  result.voxels.resize(to.voxels());
  for (int k = 0; k < to.size[2]; ++k)
    for (int j = 0; j < to.size[1]; ++j)
      for (int i = 0; i < to.size[0]; ++i) {
        const int at[3] = {i, j, k};
        int source[3] = {};
        for (int a = 0; a < 3; ++a)
          source[order[a]] = flip >> a & 1 ? to.size[a] - 1 - at[a] : at[a];
        result.voxels[to.index(i, j, k)] =
            image.voxels[from.index(source[0], source[1], source[2])];
      }
  return result;
}

// Centroid of the voxels, and the third moment about it, whose sign a mirror image would turn.
struct Body {
  Point centroid{}, skew{};
  double volume = 0.0;       // mm3
  double surface = 0.0;      // signed volume of its surface, mm3
  Point surface_centroid{};  // by area
};

Body measure(const LabelImage& image) {
  Body body;
  const Frame& frame = image.frame;
  std::vector<Point> inside;
  for (int k = 0; k < frame.size[2]; ++k)
    for (int j = 0; j < frame.size[1]; ++j)
      for (int i = 0; i < frame.size[0]; ++i)
        if (image.voxels[frame.index(i, j, k)])
          inside.push_back(
              frame.to_lps({i * frame.spacing[0], j * frame.spacing[1], k * frame.spacing[2]}));
  const auto count = static_cast<double>(inside.size());
  body.volume = count * frame.voxel_volume();
  for (const auto& p : inside)
    for (int a = 0; a < 3; ++a) body.centroid[a] += p[a] / count;
  for (const auto& p : inside)
    for (int a = 0; a < 3; ++a) {
      const double d = p[a] - body.centroid[a], e = p[(a + 1) % 3] - body.centroid[(a + 1) % 3];
      body.skew[a] += d * d * e / count;
    }
  const auto surface = contour(frame, smooth(frame, testing::mask_of(image, 1), 1.6), 0.5, 1);
  body.surface = check(surface).volume;
  double area = 0.0;
  for (const auto& t : surface.triangles) {
    const auto n = doubled_area_normal(surface, t);
    const double weight = std::hypot(n[0], n[1], n[2]);
    area += weight;
    for (const int corner : t)
      for (int a = 0; a < 3; ++a)
        body.surface_centroid[a] += weight * surface.points[corner][a] / 3.0;
  }
  for (double& x : body.surface_centroid) x /= area;
  return body;
}

void expect_same(const Body& one, const Body& other) {
  EXPECT_NEAR(one.volume / other.volume, 1.0, 1e-9);
  EXPECT_GT(one.surface, 0.0);
  // The same points, but which diagonal splits a four-sided piece depends on the grid's axes.
  EXPECT_NEAR(one.surface / other.surface, 1.0, 2e-3);
  for (int a = 0; a < 3; ++a) {
    EXPECT_NEAR(one.centroid[a], other.centroid[a], 1e-6);
    EXPECT_NEAR(one.skew[a], other.skew[a], 1e-4);  // mm3, of 100 and more
    EXPECT_NEAR(one.surface_centroid[a], other.surface_centroid[a],
                0.01);  // see contour.hpp: values at the level
  }
}

std::string meta_bytes(const LabelImage& image) {
  const Frame& f = image.frame;
  std::string matrix, offset, spacing, size;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) matrix += fmt::format(" {:.17g}", f.direction[3 * r + c]);
    offset += fmt::format(" {:.17g}", f.origin[c]);
    spacing += fmt::format(" {:.17g}", f.spacing[c]);
    size += fmt::format(" {}", f.size[c]);
  }
  std::string bytes = fmt::format(
      "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
      "TransformMatrix ={}\nOffset ={}\nElementSpacing ={}\nDimSize ={}\n"
      "ElementType = MET_USHORT\nElementDataFile = LOCAL\n",
      matrix, offset, spacing, size);
  return bytes.append(reinterpret_cast<const char*>(image.voxels.data()), 2 * image.voxels.size());
}

// NIfTI keeps its affine in single precision; so by its sform, and by its qform.
std::string nifti_bytes(const LabelImage& image) {
  const Frame& f = image.frame;
  std::array<float, 12> sform{};
  for (int r = 0; r < 3; ++r) {
    const double ras = r < 2 ? -1.0 : 1.0;
    for (int c = 0; c < 3; ++c)
      sform[4 * r + c] = static_cast<float>(ras * f.direction[3 * r + c] * f.spacing[c]);
    sform[4 * r + 3] = static_cast<float>(ras * f.origin[r]);
  }
  testing::NiftiFile file(sform);
  for (int a = 0; a < 3; ++a) file.header.dim[a + 1] = static_cast<short>(f.size[a]);
  file.voxels.assign(reinterpret_cast<const char*>(image.voxels.data()), 2 * image.voxels.size());
  return file.bytes();
}

class Space : public ::testing::Test {
 protected:
  Body through(const std::string& name, const std::string& bytes) {
    write_atomically(folder_.path() / name, bytes);
    return measure(read_image(folder_.path() / name).image);
  }
  Body through_nrrd(const LabelImage& image) {
    write_nrrd(folder_.path() / "a.nrrd", image);
    return measure(read_image(folder_.path() / "a.nrrd").image);
  }
  const LabelImage body_ = horned();
  TemporaryFolder folder_{fs::temp_directory_path()};
};

constexpr std::array<std::array<int, 3>, 6> orders = {
    {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}}};

TEST_F(Space, EightFlipsAndSixPermutationsAreOneBodyInEveryFormat) {
  const Body expected = measure(body_);
  for (const auto& order : orders)
    for (int flip = 0; flip < 8; ++flip) {
      SCOPED_TRACE(fmt::format("{}{}{} flipped {}", order[0], order[1], order[2], flip));
      const LabelImage image = rearranged(body_, order, flip);
      expect_same(through_nrrd(image), expected);
      if (order == orders[0] || flip == 0) {
        expect_same(through("a.mha", meta_bytes(image)), expected);
        expect_same(through("a.nii", nifti_bytes(image)), expected);
      }
    }
}

TEST_F(Space, AnObliqueGridIsTurnedOnceAndFlipsOfItAreTheSameBody) {
  LabelImage oblique = body_;
  // Rotation of the quaternion (4, 1, -2, 3) / sqrt(30).
  for (int d = 0; d < 9; ++d)
    oblique.frame.direction[d] =
        std::array{4., -28., -10., 20., 10., -20., 22., -4., 20.}[d] / 30.0;
  const Body expected = measure(oblique), straight = measure(body_);
  EXPECT_NEAR(expected.volume, straight.volume, 1e-6);
  // The centroid by the matrix itself.
  Point by_hand = oblique.frame.to_lps(body_.frame.from_lps(straight.centroid));
  for (int a = 0; a < 3; ++a) EXPECT_NEAR(expected.centroid[a], by_hand[a], 1e-9);
  for (int flip = 0; flip < 8; ++flip) {
    SCOPED_TRACE(flip);
    const LabelImage image = rearranged(oblique, orders[1], flip);
    expect_same(through_nrrd(image), expected);
    expect_same(through("a.mha", meta_bytes(image)), expected);
    const Body rounded = through("a.nii", nifti_bytes(image));  // 300 mm in single precision
    for (int a = 0; a < 3; ++a) EXPECT_NEAR(rounded.centroid[a], expected.centroid[a], 5e-5);
    EXPECT_GT(rounded.surface, 0.0);
  }
}

TEST_F(Space, AFrameReadBackIsToldToTheBitWithoutAFile) {
  std::mt19937 generator(7);
  std::uniform_real_distribution<double> length(0.3, 5.0), place(-400.0, 400.0);
  std::normal_distribution<double> normal;
  for (int k = 0; k < 100; ++k) {
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> axes =
        Eigen::Quaterniond(normal(generator), normal(generator), normal(generator),
                           normal(generator))
            .normalized()
            .toRotationMatrix();
    if (k % 2) axes.col(0) *= -1.0;
    LabelImage image{.frame = {.size = {2, 3, 4},
                               .spacing = {length(generator), length(generator), length(generator)},
                               .origin = {place(generator), place(generator), place(generator)}},
                     .voxels = std::vector<std::uint16_t>(24, 1)};
    std::copy_n(axes.data(), 9, image.frame.direction.begin());
    write_nrrd(folder_.path() / "a.nrrd", image);
    const Frame read = read_image(folder_.path() / "a.nrrd").image.frame;
    const Frame told = as_read_back(image.frame);
    EXPECT_EQ(told.spacing, read.spacing) << k;
    EXPECT_EQ(told.origin, read.origin) << k;
    EXPECT_EQ(told.direction, read.direction) << k;
  }
}

}  // namespace
}  // namespace viscera
