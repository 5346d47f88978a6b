// The CT beside the labels: cut to them on its own grid with its values as they were, measured
// label by label, and refused where it cannot be theirs.
#include <gtest/gtest.h>

#include "pipeline/base/atomic_file.hpp"
#include "stages/image/image_io.hpp"
#include "stages/labels/stage.hpp"
#include "tests/geometry/shapes.hpp"
#include "tests/images/image_bytes.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

class Context : public ::testing::Test {
 protected:
  Context() { write_nrrd(folder_.path() / "labels.nrrd", labels_); }

  // A CT of the phantom's two balls (60 and 20 HU in -90) on a grid of its own, turned by 90
  // degrees and of other voxels, around the same point.
  ScalarImage ct(const std::array<double, 3>& shift = {}) const {
    const auto& f = labels_.frame;
    ScalarImage image;
    image.frame = {.size = {50, 60, 40}, .spacing = {1.7, 1.1, 2.3}};
    image.frame.direction = {0, -1, 0, 1, 0, 0, 0, 0, 1};
    std::array<double, 3> half{}, middle{};
    for (int a = 0; a < 3; ++a) {
      half[a] = -0.5 * (image.frame.size[a] - 1) * image.frame.spacing[a];
      middle[a] = 0.5 * (f.size[a] - 1) * f.spacing[a];
    }
    middle = f.to_lps(middle);
    half = image.frame.to_lps(half);
    for (int a = 0; a < 3; ++a) image.frame.origin[a] = middle[a] + half[a] + shift[a];
    const auto& s = image.frame;
    for (int k = 0; k < s.size[2]; ++k)
      for (int j = 0; j < s.size[1]; ++j)
        for (int i = 0; i < s.size[0]; ++i) {
          const auto at =
              voxel_at(f, s.to_lps({i * s.spacing[0], j * s.spacing[1], k * s.spacing[2]}));
          const int id = at ? labels_.voxels[*at] : 0;
          image.values.push_back(id == 0 ? -90.0f : id == 1 ? 60.0f : 20.0f);
        }
    return image;
  }
  fs::path write(const std::string& name, const ScalarImage& image) {
    write_nrrd(folder_.path() / name, image);
    return folder_.path() / name;
  }
  testing::Outcome run(const fs::path& image) {
    std::vector<std::string> arguments{
        "--in", "volume=" + (folder_.path() / "labels.nrrd").string(), "--out", out().string()};
    if (!image.empty()) arguments.insert(arguments.end(), {"--in", "image=" + image.string()});
    return testing::run_stage(labels_stage(), arguments);
  }
  // A mask and a CT of four DICOM planes, each in its frame of reference.
  testing::Outcome run_dicom(const std::string& of_mask, const std::string& of_ct) {
    for (int k = 0; k < 4; ++k) {
      auto mask = testing::dicom_plane(k), ct_plane = testing::dicom_ct_plane(k, 10 * k);
      mask[0x00200052] = testing::text_element("UI", of_mask);
      ct_plane[0x00200052] = testing::text_element("UI", of_ct);
      for (const auto& [folder, set] : {std::pair("mask", mask), std::pair("ct", ct_plane)}) {
        fs::create_directories(folder_.path() / folder);
        write_atomically(folder_.path() / folder / (std::to_string(k) + ".dcm"),
                         testing::dicom_file(set));
      }
    }
    return testing::run_stage(
        labels_stage(), {"--in", "volume=" + (folder_.path() / "mask").string(), "--in",
                         "image=" + (folder_.path() / "ct").string(), "--set", "min_component=0ml",
                         "--set", "border=accept", "--out", out().string()});
  }
  void expect_refused(const fs::path& image, const std::string& words) {
    const auto outcome = run(image);
    EXPECT_EQ(outcome.code, 4) << outcome.log;
    EXPECT_NE(outcome.log.find(image.filename().string()), std::string::npos) << outcome.log;
    EXPECT_NE(outcome.log.find(words), std::string::npos) << outcome.log;
    EXPECT_TRUE(testing::files_in(out()).empty());
  }
  fs::path out() const { return folder_.path() / "out"; }
  TemporaryFolder folder_{fs::temp_directory_path()};
  LabelImage labels_ = testing::nested_balls();
};

TEST_F(Context, WithoutACtNothingIsWrittenForIt) {
  ASSERT_EQ(run({}).code, 0);
  EXPECT_FALSE(fs::exists(out() / "image.nrrd"));
}

TEST_F(Context, TheCtIsCutToTheLabelsWithItsValuesWhereTheyWere) {
  const ScalarImage whole = ct();
  ASSERT_EQ(run(write("ct.nrrd", whole)).code, 0);
  const ScalarImage part = read_scalar_image(out() / "image.nrrd");
  EXPECT_LT(part.values.size(), whole.values.size());
  const auto& f = part.frame;
  for (int k = 0; k < f.size[2]; ++k)
    for (int j = 0; j < f.size[1]; ++j)
      for (int i = 0; i < f.size[0]; ++i) {
        const auto at =
            voxel_at(whole.frame, f.to_lps({i * f.spacing[0], j * f.spacing[1], k * f.spacing[2]}));
        ASSERT_TRUE(at);
        ASSERT_EQ(part.values[f.index(i, j, k)], whole.values[*at]);
      }
  EXPECT_EQ(read_image_header(out() / "image.nrrd").pixel_type, "int16");
}

TEST_F(Context, EachLabelIsMeasured) {
  ASSERT_EQ(run(write("ct.nrrd", ct())).code, 0);
  const Json found = testing::metric(out(), "image");
  EXPECT_EQ(found["covered"], 1.0);
  EXPECT_EQ(found["lo_hu"], -90.0);
  EXPECT_EQ(found["hi_hu"], 60.0);
  ASSERT_EQ(found["labels"].size(), 2u);
  EXPECT_NEAR(found["labels"][0]["mean_hu"].get<double>(), 60.0, 8.0);  // voxels at the rim differ
  EXPECT_NEAR(found["labels"][1]["mean_hu"].get<double>(), 20.0, 8.0);
}

TEST_F(Context, ASeriesInAnotherFrameOfReferenceIsRefused) {
  const auto outcome = run_dicom("1.2.840.1", "1.2.840.2");
  EXPECT_EQ(outcome.code, 4) << outcome.log;
  EXPECT_NE(outcome.log.find("0.dcm: FrameOfReferenceUID: 1.2.840.2"), std::string::npos)
      << outcome.log;
  EXPECT_TRUE(testing::files_in(out()).empty());
}

TEST_F(Context, AFolderOfDicomPlanesIsRead) {
  const auto outcome = run_dicom("1.2.840.1", "1.2.840.1");
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const ScalarImage image = read_scalar_image(out() / "image.nrrd");
  EXPECT_EQ(image.frame.size, (std::array<int, 3>{6, 5, 4}));
  EXPECT_EQ(image.values.front(), 0.0f);
  EXPECT_EQ(image.values.back(), 30.0f);
  EXPECT_EQ(testing::metric(out(), "image")["labels"][0]["mean_hu"], 15.0);
}

TEST_F(Context, ACtThatCoversAPartIsKeptAndTheRestCounted) {
  const auto outcome = run(write("ct.nrrd", ct({30.0, 0.0, 0.0})));
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const double covered = testing::metric(out(), "image")["covered"];
  EXPECT_GT(covered, 0.3);
  EXPECT_LT(covered, 0.95);
  EXPECT_NE(outcome.log.find("lie outside of it"), std::string::npos) << outcome.log;
}

TEST_F(Context, ACtOfAnotherPlaceIsRefused) {
  expect_refused(write("far.nrrd", ct({500.0, 0.0, 0.0})), "meets no label");
}

TEST_F(Context, WhatIsNoCtIsRefusedByTheReaders) {
  ScalarImage holes = ct();
  holes.values[holes.frame.index(25, 30, 20)] = std::nanf("");
  expect_refused(write("holes.nrrd", holes), "voxel values");
  write_atomically(folder_.path() / "cut.nii", testing::NiftiFile().bytes().substr(0, 500));
  expect_refused(folder_.path() / "cut.nii", "dim");
  fs::create_directory(folder_.path() / "empty");
  expect_refused(folder_.path() / "empty", "an empty folder");
  write_atomically(folder_.path() / "lone.dcm", testing::dicom_file(testing::dicom_ct_plane(0, 1)));
  expect_refused(folder_.path() / "lone.dcm", "SOPClassUID");
  const auto labels = run(folder_.path() / "labels.nrrd");
  EXPECT_EQ(labels.code, 0);
  EXPECT_NE(labels.log.find("no value below 0"), std::string::npos) << labels.log;
}

}  // namespace
}  // namespace viscera
