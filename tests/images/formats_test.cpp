// The formats and layouts that segmentations arrive in, each read into the same materials.
#include <gtest/gtest.h>

#include "pipeline/base/atomic_file.hpp"
#include "stages/labels/segmentation.hpp"
#include "stages/labels/stage.hpp"
#include "tests/geometry/shapes.hpp"
#include "tests/images/image_bytes.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

class Formats : public ::testing::Test {
 protected:
  fs::path write(const std::string& name, const std::string& bytes) {
    fs::create_directories((folder_.path() / name).parent_path());
    write_atomically(folder_.path() / name, bytes);
    return folder_.path() / name;
  }
  fs::path write_series(const std::string& folder) {
    for (int k = 0; k < 4; ++k)  // names in another order than places
      write(folder + "/" + std::to_string((k * 3) % 4) + ".dcm",
            testing::dicom_file(testing::dicom_plane(k)));
    return folder_.path() / folder;
  }
  static std::size_t voxels(const Segmentation& s, const std::string& name) {
    for (const auto& segment : s.segments)
      if (segment.name == name) return voxels_in(segment.runs);
    return 0;
  }
  static std::string words(const std::vector<fs::path>& sources) {
    try {
      read_segmentation(sources);
    } catch (const Error& e) {
      return e.what();
    }
    return "read";
  }
  TemporaryFolder folder_{fs::temp_directory_path()};
};

constexpr const char* nrrd_head =
    "NRRD0004\ntype: uchar\ndimension: 3\nspace: right-anterior-superior\nsizes: 4 3 2\n"
    "space directions: (2,0,0) (0,3,0) (0,0,4)\nspace origin: (10,20,30)\nencoding: raw\n";

TEST_F(Formats, TotalSegmentatorsLabelTableNamesTheIds) {
  testing::NiftiFile file;
  file.extensions = testing::nifti_extension(
      "<CaretExtension><LabelTable>\n<Label Key=\"0\" Red=\"0\"><![CDATA[???]]></Label>"
      "<Label Key=\"1\" Red=\"0.0\" Alpha=\"1\"><![CDATA[kidney_left]]></Label></LabelTable>");
  const auto read = read_segmentation({write("organs.nii", file.bytes())});
  ASSERT_EQ(read.segments.size(), 1u);
  EXPECT_EQ(read.segments[0].name, "kidney_left");
  EXPECT_EQ(voxels_in(read.segments[0].runs), 16u);
  const auto zipped = read_image(write("organs.nii.gz", testing::gzip(file.bytes())));
  EXPECT_EQ(zipped.image.names.at(1), "kidney_left");
}

TEST_F(Formats, OneNiftiPerOrganIsNamedAfterItsFile) {
  const auto liver = write("liver.nii", testing::NiftiFile().bytes());
  testing::NiftiFile other({2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0}, 255);
  const auto spleen = write("spleen.nii.gz", testing::gzip(other.bytes()));
  const auto read = read_segmentation({liver, spleen});
  ASSERT_EQ(read.segments.size(), 2u);
  EXPECT_EQ(read.segments[0].name + " " + read.segments[1].name, "liver spleen");
  EXPECT_EQ(read.segments[1].id, 2);
  const auto elsewhere =
      write("moved.nii", testing::NiftiFile({2, 0, 0, 5, 0, 2, 0, 0, 0, 0, 2, 0}).bytes());
  EXPECT_NE(words({liver, elsewhere}).find("moved.nii: grid"), std::string::npos);
}

TEST_F(Formats, ANiftiPairIsReadFromItsTwoFiles) {
  testing::NiftiFile file;
  std::copy_n("ni1", 4, file.header.magic);
  file.own_offset = true;
  write("pair.img", file.voxels);
  const auto read = read_image(write("pair.hdr", file.bytes().substr(0, 348)));
  EXPECT_EQ(read.image.frame.size, (std::array<int, 3>{8, 6, 4}));
  EXPECT_EQ(std::count(read.image.voxels.begin(), read.image.voxels.end(), 1), 16);
}

TEST_F(Formats, SlicersSegmentsKeepTheirNamesValuesAndLayers) {
  const std::string one =
      std::string(nrrd_head) +
      "Segment0_Name:=liver\nSegment0_LabelValue:=3\nSegment0_Layer:=0\n"
      "Segment1_Name:=big tumour\nSegment1_LabelValue:=7\nSegment1_Layer:=0\n\n";
  std::string data(24, '\3');
  data[5] = '\7';
  const auto single = read_segmentation({write("a.seg.nrrd", one + data)});
  ASSERT_EQ(single.segments.size(), 2u);
  EXPECT_EQ(single.segments[0].id, 3);
  EXPECT_EQ(voxels(single, "big tumour"), 1u);

  const std::string two =
      "NRRD0004\ntype: uchar\ndimension: 4\nspace: left-posterior-superior\nsizes: 2 4 3 2\n"
      "space directions: none (2,0,0) (0,3,0) (0,0,4)\nspace origin: (10,20,30)\n"
      "kinds: list domain domain domain\nencoding: raw\n"
      "Segment0_Name:=liver\nSegment0_LabelValue:=1\nSegment0_Layer:=0\n"
      "Segment1_Name:=tumour\nSegment1_LabelValue:=1\nSegment1_Layer:=1\n\n";
  std::string layers(48, '\0');
  for (int v = 0; v < 10; ++v) layers[2 * v] = '\1';      // liver: voxels 0 to 9
  for (int v = 8; v < 14; ++v) layers[2 * v + 1] = '\1';  // tumour: voxels 8 to 13
  const auto both = read_segmentation({write("b.seg.nrrd", two + layers)});
  ASSERT_EQ(both.segments.size(), 2u);
  EXPECT_EQ(both.segments[1].id, 2);  // both hold 1 in their layers
  EXPECT_EQ(voxels(both, "liver"), 10u);
  EXPECT_EQ(voxels(both, "tumour"), 6u);

  for (const bool last : {true, false}) {
    std::vector<Overlap> overlaps;
    const auto image = paint(both, {{"liver", {1}}, {"tumour", {2}}}, last, overlaps);
    EXPECT_EQ(std::count(image.voxels.begin(), image.voxels.end(), 2), last ? 6 : 4);
    ASSERT_EQ(overlaps.size(), 1u);
    EXPECT_EQ(overlaps[0].voxels, 2u);
    EXPECT_EQ(overlaps[0].kept, last ? 2 : 1);
  }
}

TEST_F(Formats, ADetachedNrrdIsItsAttachedTwin) {
  const std::string data(24, '\1');
  write("data/voxels.raw", "skip" + data);
  const auto attached = read_image(write("a.nrrd", std::string(nrrd_head) + "\n" + data)).image;
  const auto detached =
      read_image(
          write("a.nhdr", std::string(nrrd_head) + "byte skip: 4\ndata file: data/voxels.raw\n"))
          .image;
  EXPECT_EQ(attached.voxels, detached.voxels);
  EXPECT_EQ(attached.frame.origin, detached.frame.origin);
  EXPECT_EQ(attached.frame.origin, (std::array<double, 3>{-10, -20, 30}));  // from RAS
}

TEST_F(Formats, AFolderOfDicomPlanesIsOneMaskAndFoldersOfThemAreSeveral) {
  const auto liver = read_segmentation({write_series("patient/liver")});
  ASSERT_EQ(liver.segments.size(), 1u);
  EXPECT_EQ(voxels(liver, "liver"), 24u);
  EXPECT_EQ(liver.frame.size, (std::array<int, 3>{6, 5, 4}));
  EXPECT_EQ(liver.frame.spacing, (std::array<double, 3>{1.5, 1.25, 2.0}));
  EXPECT_EQ(liver.frame.origin, (std::array<double, 3>{-10, -20, 100}));
  write_series("patient/livertumor01");
  const auto both = read_segmentation({folder_.path() / "patient"});
  ASSERT_EQ(both.segments.size(), 2u);
  EXPECT_EQ(both.segments[1].name, "livertumor01");
  EXPECT_EQ(both.segments[1].id, 2);
}

TEST_F(Formats, ADicomSegmentationObjectHoldsItsSegmentsOnTheirPlanes) {
  const auto read =
      read_segmentation({write("seg.dcm", testing::dicom_file(testing::dicom_segmentation()))});
  ASSERT_EQ(read.segments.size(), 2u);
  EXPECT_EQ(read.frame.size, (std::array<int, 3>{8, 4, 3}));
  EXPECT_EQ(read.frame.spacing, (std::array<double, 3>{1.5, 1.25, 2.0}));
  EXPECT_EQ(voxels(read, "liver"), 36u);
  EXPECT_EQ(voxels(read, "tumour"), 2u);
  EXPECT_EQ(read.segments[1].runs[0].begin, read.frame.index(2, 1, 1));
}

TEST_F(Formats, TheStageTakesSegmentsByNameMergesThemAndSaysWhoKeptAnOverlap) {
  const auto folder = write_series("patient/liver").parent_path();
  write_series("patient/tumour");
  const auto outcome = testing::run_stage(
      labels_stage(), {"--in", "volume=" + folder.string(), "--set",
                       "labels={tissue: [liver], lesion: tumour}", "--set", "min_component=0ml",
                       "--set", "border=accept", "--out", (folder_.path() / "out").string()});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const auto overlaps = testing::metric(folder_.path() / "out", "overlaps");
  EXPECT_EQ(overlaps[0].at("kept"), "lesion");
  EXPECT_EQ(overlaps[0].at("voxels"), 24);
  const auto labels = testing::read_json(folder_.path() / "out" / "labels.json").at("labels");
  EXPECT_EQ(labels[1].at("name"), "lesion");
  EXPECT_EQ(labels[1].at("voxels"), 24);
}

}  // namespace
}  // namespace viscera
