#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "stages/image/image_io.hpp"
#include "stages/image/label_components.hpp"
#include "stages/image/label_facts.hpp"
#include "stages/labels/bridges.hpp"
#include "stages/labels/clean.hpp"
#include "stages/labels/stage.hpp"
#include "tests/common/needs.hpp"
#include "tests/geometry/shapes.hpp"
#include "tests/images/image_bytes.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;
using testing::run_stage;

std::string nifti(const std::array<float, 12>& sform, std::int16_t value = 1, float scale = 1.0f) {
  testing::NiftiFile file(sform, value);
  file.header.scl_slope = scale;
  return file.bytes();
}

class Labels : public ::testing::Test {
 protected:
  fs::path write(const std::string& name, const std::string& bytes) {
    write_atomically(folder_.path() / name, bytes);
    return folder_.path() / name;
  }
  fs::path write(const std::string& name, const LabelImage& image) {
    write_nrrd(folder_.path() / name, image);
    return folder_.path() / name;
  }
  testing::Outcome run(const fs::path& volume, const std::vector<std::string>& settings = {}) {
    std::vector<std::string> arguments{"--in", "volume=" + volume.string(), "--out",
                                       out().string()};
    for (const auto& setting : settings) arguments.insert(arguments.end(), {"--set", setting});
    return run_stage(labels_stage(), arguments);
  }
  fs::path out() const { return folder_.path() / "out"; }
  Json caveats() const { return testing::read_json(out() / "manifest.json")["caveats"]; }
  void expect_refused(const testing::Outcome& outcome, const std::string& words) {
    EXPECT_EQ(outcome.code, static_cast<int>(ExitCode::bad_input)) << outcome.log;
    EXPECT_NE(outcome.log.find(words), std::string::npos) << outcome.log;
    EXPECT_TRUE(testing::files_in(out()).empty());
  }
  TemporaryFolder folder_{fs::temp_directory_path()};
};

TEST_F(Labels, AVolumeSurvivesTheWayThroughNrrdWithItsObliqueFrameAndNames) {
  LabelImage image = testing::nested_balls();
  image.frame.direction = {0.8, -0.6, 0, 0.6, 0.8, 0, 0, 0, -1};
  const auto read = read_image(write("a.nrrd", image));
  EXPECT_EQ(read.image.voxels, image.voxels);
  EXPECT_EQ(read.image.names, image.names);
  for (int d = 0; d < 9; ++d)
    EXPECT_NEAR(read.image.frame.direction[d], image.frame.direction[d], 1e-12);
  EXPECT_EQ(read.notes.repair.shift_mm, 0.0);
}

TEST_F(Labels, NamesOfAnyLettersStayWhatTheyAre) {
  for (const std::string& name :
       {std::string(R"(a\b "c" 'd' <e> & {f: g})"), std::string(R"(ends with \)"),
        std::string(R"(\n is no end of a line)"), std::string("tumör 肝"), std::string(100, 'x')}) {
    LabelImage image = testing::nested_balls();
    for (auto& [id, text] : image.names) text = name;
    const fs::path stored = write("a.nrrd", image);
    EXPECT_EQ(read_image(stored).image.names, image.names);
    ASSERT_EQ(run(stored).code, 0) << name;
    ASSERT_EQ(run(stored, {"labels=" + Json{{name, 1}}.dump()}).code, 0) << name;
    EXPECT_EQ(read_image(out() / "labels.nrrd").image.names.at(1), name);
    EXPECT_EQ(Json::parse(read_file(out() / "labels.json"))["labels"][0]["name"], name);
  }
}

TEST_F(Labels, WhatIsNoNameIsRefusedBeforeAnythingIsWritten) {
  const fs::path volume = write("a.nrrd", testing::nested_balls());
  for (const char* name : {"", "a\\nb", "a\\tb", "a\\u0000b", "a\\u007f", "a\\u0085", " a", "a "}) {
    const auto outcome = run(volume, {fmt::format("labels={{\"{}\": 1}}", name)});
    EXPECT_EQ(outcome.code, 3) << name << outcome.log;
    EXPECT_NE(outcome.log.find("labels: a"), std::string::npos) << outcome.log;
    EXPECT_NE(outcome.log.find("1 to 100 bytes"), std::string::npos) << outcome.log;
    EXPECT_TRUE(testing::files_in(out()).empty());
  }
  const auto outcome = run(volume, {"labels={" + std::string(1000, 'x') + ": 1}"});
  EXPECT_EQ(outcome.code, 3) << outcome.log;
  EXPECT_NE(outcome.log.find("a name of 1000 bytes"), std::string::npos) << outcome.log;
  EXPECT_LT(outcome.log.size(), 1000u);
}

TEST_F(Labels, AStoredTextThatIsNoNameIsRefusedUnlessTheLabelIsNamedAnew) {
  for (const std::string& name :
       {std::string("L\xe4sion"), std::string("two\nlines"), std::string(10000, 'x')}) {
    LabelImage image = testing::nested_balls();
    image.names[1] = name;
    const fs::path volume = write("a.nrrd", image);
    expect_refused(run(volume), "a.nrrd: name of 1: a name ");
    EXPECT_THROW(read_image(volume), Error);
    EXPECT_EQ(run(volume, {"labels={liver: 1}"}).code, 0);
    fs::remove_all(out());
  }
}

TEST_F(Labels, NiftiIsTurnedFromRasToLps) {
  const auto read = read_image(write("a.nii", nifti({2, 0, 0, 10, 0, 3, 0, 20, 0, 0, 4, 30})));
  EXPECT_NEAR(read.image.frame.origin[0], -10.0, 1e-6);
  EXPECT_NEAR(read.image.frame.origin[1], -20.0, 1e-6);
  EXPECT_NEAR(read.image.frame.origin[2], 30.0, 1e-6);
  EXPECT_NEAR(read.image.frame.direction[0], -1.0, 1e-6);
  EXPECT_NEAR(read.image.frame.direction[8], 1.0, 1e-6);
  EXPECT_NEAR(read.image.frame.voxel_volume(), 24.0, 1e-5);
}

TEST_F(Labels, ASlightlySkewedNiftiIsRepairedAboutItsCentreAndReported) {
  const std::array<float, 12> sform{2, 0.03f, 0, 10, 0, 2, 0.03f, 20, 0, 0, 2, 30};
  const auto read = read_image(write("skew.nii", nifti(sform)));
  const auto& d = read.image.frame.direction;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) {
      const double dot = d[a] * d[b] + d[3 + a] * d[3 + b] + d[6 + a] * d[6 + b];
      EXPECT_NEAR(dot, a == b ? 1.0 : 0.0, 1e-9);
    }
  EXPECT_GT(read.notes.repair.shift_mm, 0.01);
  EXPECT_LT(read.notes.repair.shift_mm, 0.5);
  // The centre of the volume, by the file's own affine: RAS index (3.5, 2.5, 1.5).
  const std::array<double, 3> centre{-(2 * 3.5 + 0.03 * 2.5 + 10), -(2 * 2.5 + 0.03 * 1.5 + 20),
                                     2 * 1.5 + 30};
  const auto& frame = read.image.frame;
  const auto place =
      frame.to_lps({3.5 * frame.spacing[0], 2.5 * frame.spacing[1], 1.5 * frame.spacing[2]});
  for (int a = 0; a < 3; ++a) EXPECT_NEAR(place[a], centre[a], 1e-4);
}

TEST_F(Labels, ANiftiInMetresOrMicronsIsTheSameVolumeInMillimetres) {
  const std::array<float, 12> straight{2, 0, 0, 10, 0, 2, 0, 20, 0, 0, 2, 30};
  const std::array<float, 12> skewed{2, 0.03f, 0, 10, 0, 2, 0.03f, 20, 0, 0, 2, 30};
  for (const auto& sform : {straight, skewed}) {
    const auto mm = read_image(write("mm.nii", nifti(sform))).image.frame;
    for (const auto& [code, per_mm] : {std::pair<char, float>{1, 1e-3f}, {3, 1e3f}}) {
      std::array<float, 12> scaled = sform;
      for (float& value : scaled) value *= per_mm;
      std::string bytes = nifti(scaled);
      bytes[123] = code;
      const auto frame = read_image(write("scaled.nii", bytes)).image.frame;
      for (std::size_t a = 0; a < 3; ++a) {
        EXPECT_NEAR(frame.spacing[a], mm.spacing[a], 1e-4) << int{code};
        EXPECT_NEAR(frame.origin[a], mm.origin[a], 1e-4) << int{code};
      }
      for (std::size_t d = 0; d < 9; ++d) EXPECT_NEAR(frame.direction[d], mm.direction[d], 1e-5);
    }
  }
}

TEST_F(Labels, AStronglySkewedNiftiIsRefused) {
  expect_refused(run(write("skew.nii", nifti({2, 1.5f, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0}))),
                 "direction");
}

TEST_F(Labels, FilesThatAreNoLabelVolumesAreRefusedAndLeaveNothing) {
  expect_refused(run(folder_.path() / "absent.nii"), "absent.nii");
  expect_refused(run(write("text.nii.gz", "certainly not an image")), "text.nii.gz");
  expect_refused(run(write("text.txt", "certainly not an image")), "text.txt");
  const std::array<float, 12> straight{2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0};
  expect_refused(run(write("cut.nii", nifti(straight).substr(0, 500))), "cut.nii");
  const std::string whole = read_file(write("whole.nrrd", testing::nested_balls()));
  expect_refused(run(write("cut.nrrd", whole.substr(0, whole.size() / 2))), "cut.nrrd");
  const std::string gz = testing::gzip(nifti(straight));
  EXPECT_EQ(read_image(write("whole.nii.gz", gz)).image.frame.size[0], 8);
  expect_refused(run(write("cut.nii.gz", gz.substr(0, gz.size() - 12))), "truncated");
  write("cut.raw", std::string(500, '\1'));
  const auto header = write("cut.mhd",
                            "ObjectType = Image\nNDims = 3\nDimSize = 10 10 10\n"
                            "ElementType = MET_UCHAR\nElementDataFile = cut.raw\n");
  expect_refused(run(header), "end too early");
  write("cut.raw", std::string(1000, '\1'));
  EXPECT_EQ(read_image(header).image.voxels.size(), 1000u);
  expect_refused(run(write("raw.nrrd",
                           "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 9 9 9\n"
                           "spacings: 1 1 1\nencoding: raw\n\n" +
                               std::string(300, '\1'))),
                 "raw.nrrd");
  expect_refused(run(write("negative.nii", nifti(straight, -7))), "-7 at voxel");
  expect_refused(run(write("probability.nii", nifti(straight, 1, 0.4f))), "voxel values");
  expect_refused(run(write("zero.nii", nifti(straight, 0))), "all zero");
}

TEST_F(Labels, AHeaderThatAsksForTooMuchIsRefusedBeforeAllocating) {
  expect_refused(run(write("huge.nrrd",
                           "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 60000 60000 60000\n"
                           "spacings: 1 1 1\nencoding: raw\n\n")),
                 "dimensions");
}

TEST_F(Labels, ALabelThatDoesNotOccurIsNamedWithThoseThatDo) {
  const auto volume = write("a.nrrd", testing::nested_balls());
  const auto outcome = run(volume, {"labels={liver: 1, spleen: 7}"});
  expect_refused(outcome, "labels.spleen");
  EXPECT_NE(outcome.log.find("1 liver, 2 tumour"), std::string::npos) << outcome.log;
  expect_refused(run(volume, {"labels={liver: spleen}"}), "name \"spleen\" does not occur");
  EXPECT_EQ(run(volume, {"labels={liver: 1, tumour: [2, 1]}"}).code, 3);
  EXPECT_EQ(run(volume, {"labels={liver: 1, tumour: liver}"}).code, 3);
  EXPECT_EQ(run(volume, {"labels={liver: 1.5}"}).code, 3);
}

TEST_F(Labels, ABodyCutByTheBorderFailsTheGateOrIsAcceptedAsAFlatCapThatTheManifestNames) {
  const LabelImage slab = testing::draw(12, {1.0, 2.0, 3.0}, [](double x, double y, double) {
    return std::abs(x) < 2.0 && std::abs(y) < 4.0 ? 5 : 0;
  });
  const auto volume = write("cut.nrrd", slab);  // 4 x 4 voxels of 1 x 2 mm at either end
  const auto refused = run(volume);
  EXPECT_EQ(refused.code, static_cast<int>(ExitCode::gate_failed));
  EXPECT_NE(refused.log.find("inferior (k = 0) 32 mm2"), std::string::npos) << refused.log;
  for (const char* part : {"gate border_area: 64 mm2, required <= 0 mm2\n", "means:   The border",
                           "where:   inferior side of the image, ", "labels.border: accept"})
    EXPECT_NE(refused.log.find(part), std::string::npos) << part << "\n" << refused.log;
  EXPECT_TRUE(caveats().empty());
  const auto accepted = run(volume, {"border=accept"});
  EXPECT_EQ(accepted.code, 0) << accepted.log;
  EXPECT_DOUBLE_EQ(testing::metric(out(), "border_area").get<double>(), 64.0);
  ASSERT_EQ(caveats().size(), 1u);
  EXPECT_EQ(caveats()[0].get<std::string>().find(
                "The body is cut by the image's border at its inferior side ("),
            0u);
  EXPECT_NE(accepted.log.find("these planes are not anatomy"), std::string::npos) << accepted.log;
  // Whatever was cut is closed off by the padding.
  const auto closed = find_components(read_image(out() / "labels.nrrd").image);
  for (const auto& component : closed.list)
    EXPECT_TRUE(component.label == 0 || !component.on_border);
}

TEST_F(Labels, AnAcceptedBorderOfABodyThatIsWholeSaysNothing) {
  EXPECT_EQ(run(write("whole.nrrd", testing::nested_balls()), {"border=accept"}).code, 0);
  EXPECT_TRUE(caveats().empty());
  EXPECT_TRUE(testing::metric(out(), "border_cuts").empty());
}

// A ball cut through its middle: the plane is pi r^2 of 3 pi r^2.
TEST_F(Labels, ACutIsNamedByTheSideOfThePatientWithItsShareOfTheSurfaceAndItsPlace) {
  LabelImage half = testing::draw(60, {1.0, 1.0, 1.0}, [](double x, double y, double z) {
    return std::hypot(x, y - 2.0, z + 29.5) < 20.0 ? 1 : 0;
  });
  struct Case {
    std::array<double, 9> direction;  // its third column is the axis along which the cut lies
    const char* side;
  };
  for (const auto& [direction, side] :
       {Case{{1, 0, 0, 0, 1, 0, 0, 0, 1}, "inferior"},
        Case{{1, 0, 0, 0, -1, 0, 0, 0, -1}, "superior"}, Case{{0, 0, 1, 1, 0, 0, 0, 1, 0}, "right"},
        Case{{0, 0, -1, 0, 1, 0, 1, 0, 0}, "left"}, Case{{0, 1, 0, 0, 0, 1, 1, 0, 0}, "anterior"},
        Case{{1, 0, 0, 0, 0, -1, 0, 1, 0}, "posterior"}}) {
    half.frame.direction = direction;
    EXPECT_EQ(run(write("half.nrrd", half), {"border=accept"}).code, 0) << side;
    const Json cuts = testing::metric(out(), "border_cuts");
    ASSERT_EQ(cuts.size(), 1u) << cuts;
    EXPECT_EQ(cuts[0]["side"], side);
    EXPECT_NEAR(cuts[0]["share"].get<double>(), 1.0 / 3.0, 0.01);
    const auto place = half.frame.from_lps(cuts[0]["at"].get<std::array<double, 3>>());
    EXPECT_NEAR(place[0], 29.5, 0.1);
    EXPECT_NEAR(place[1], 31.5, 0.1);
    EXPECT_NEAR(place[2], -0.5, 1e-9) << "on the outer face of the last voxels";
    const std::string sentence = std::string("The body is cut by the image's border at its ") +
                                 side + " side (33 % of its surface): this plane is not anatomy.";
    EXPECT_EQ(caveats(), Json::array({sentence}));
  }
}

TEST(Clean, SpecksAndHolesGoToTheNeighbourTheyShareMostFacesWith) {
  LabelImage image = testing::draw(20, {1, 1, 1}, [](double x, double y, double z) {
    return std::max({std::abs(x), std::abs(y), std::abs(z)}) < 7.0 ? 1 : 0;
  });
  const auto at = [&image](int i, int j, int k) -> std::uint16_t& {
    return image.voxels[image.frame.index(i, j, k)];
  };
  at(10, 10, 10) = 0;  // a hole
  at(8, 8, 8) = 2;     // a speck inside
  at(1, 1, 1) = 2;     // a speck outside
  Cleaning cleaning;
  absorb_specks(image, 5, false, cleaning);
  EXPECT_EQ(at(10, 10, 10), 1);
  EXPECT_EQ(at(8, 8, 8), 1);
  EXPECT_EQ(at(1, 1, 1), 0);
  EXPECT_EQ(cleaning.cavities_filled.components, 1u);
  EXPECT_EQ(cleaning.specks_absorbed.components, 1u);
  EXPECT_EQ(cleaning.specks_removed.voxels, 1u);
}

TEST(Clean, OnlyTheLargestBodyStaysAndItsPlaceIsKept) {
  LabelImage image = testing::draw(20, {1, 2, 3}, [](double x, double, double) {
    return x < -5 ? 3 : x > 4 && x < 6 ? 4 : 0;
  });
  image.frame.direction = {0, 1, 0, -1, 0, 0, 0, 0, 1};
  Cleaning cleaning;
  keep_largest_body(image, cleaning);
  EXPECT_EQ(cleaning.bodies_removed.components, 1u);
  EXPECT_EQ(count_labels(image).count(4), 0u);
  std::array<int, 3> offset{};
  const LabelImage cropped = crop(image, {3, 2, 2}, offset);
  EXPECT_EQ(offset, (std::array<int, 3>{-3, -2, -2}));
  const auto& frame = image.frame;
  const auto before =
      frame.to_lps({4 * frame.spacing[0], 5 * frame.spacing[1], 6 * frame.spacing[2]});
  const auto after = cropped.frame.to_lps({(4.0 - offset[0]) * frame.spacing[0],
                                           (5.0 - offset[1]) * frame.spacing[1],
                                           (6.0 - offset[2]) * frame.spacing[2]});
  for (int a = 0; a < 3; ++a) EXPECT_NEAR(before[a], after[a], 1e-12);
  EXPECT_EQ(count_labels(cropped), count_labels(image));
}

// A second body with the tumour in it, and a speck of a vessel: no gate compares with what was
// segmented, so the report begins with it.
TEST_F(Labels, WhatIsLeftOutOfTheBodyIsSaidFirst) {
  LabelImage image = testing::draw(40, {1, 1, 1}, [](double x, double y, double z) {
    if (std::hypot(x - 13, y, z) < 2.0) return 2;
    if (std::hypot(x + 7, y, z) < 1.2) return 3;
    return std::hypot(x + 7, y, z) < 9.0 || std::hypot(x - 13, y, z) < 5.0 ? 1 : 0;
  });
  image.names = {{1, "liver"}, {2, "tumour"}, {3, "vessel"}};
  const auto caveats_of = [&](const std::vector<std::string>& settings) {
    const auto outcome = run(write("two.nrrd", image), settings);
    EXPECT_EQ(outcome.code, 0) << outcome.log;
    return caveats().dump();
  };
  const std::string largest = caveats_of({"min_component=0.02ml"});
  EXPECT_NE(largest.find(" of liver, "), std::string::npos) << largest;
  EXPECT_NE(largest.find(" of tumour; keep: all"), std::string::npos) << largest;
  EXPECT_NE(largest.find("Nothing is left of tumour"), std::string::npos) << largest;
  EXPECT_NE(largest.find("Nothing is left of vessel"), std::string::npos) << largest;
  EXPECT_EQ(caveats_of({"min_component=0ml", "keep=all"}), "[]");
}

TEST(Clean, AllCavitiesAreFilledAndOnlyTheLargestOfEachLabelStaysWhereAsked) {
  LabelImage image = testing::draw(24, {1, 1, 1}, [](double x, double y, double z) {
    const double r = std::hypot(x, y, z);
    if (std::hypot(x - 4, y, z) < 2.0 || std::hypot(x + 5, y, z) < 1.5) return 2;
    return r < 10.0 && std::hypot(x, y - 5, z) > 3.0 ? 1 : 0;
  });
  LabelImage open = image;
  Cleaning cleaning;
  absorb_specks(open, 5, false, cleaning);
  EXPECT_EQ(cleaning.cavities_filled.components, 0u);
  absorb_specks(image, 5, true, cleaning);
  EXPECT_EQ(cleaning.cavities_filled.components, 1u);
  EXPECT_GT(cleaning.cavities_filled.voxels, 100u);
  keep_largest_of_each(image, cleaning);
  EXPECT_EQ(cleaning.specks_absorbed.components, 1u);  // the smaller ball of 2, into 1
  EXPECT_EQ(find_components(image).list.size(), 3u);   // background, 1, 2
}

TEST(Clean, ABodyThatHangsOnAThinBridgeIsReportedWithItsPlaceAndSize) {
  LabelImage image = testing::draw(40, {1, 1, 1}, [](double x, double y, double z) {
    const bool bridge = std::hypot(y, z) < 1.2 && std::abs(x) < 10;
    return std::hypot(x - 11, y, z) < 7 || std::hypot(x + 11, y, z) < 5.5 || bridge ? 1 : 0;
  });
  const auto bridges = find_bridges(image, 5.0, 20);
  ASSERT_EQ(bridges.size(), 1u);
  const auto place = image.frame.from_lps(bridges[0].place);
  EXPECT_NEAR(place[0], 19.5, 5.0);
  EXPECT_NEAR(place[1], 19.5, 1.0);
  EXPECT_GT(bridges[0].area_mm2, 2.0);
  EXPECT_LT(bridges[0].area_mm2, 9.0);
  EXPECT_TRUE(find_bridges(image, 1.0, 20).empty());
}

TEST_F(Labels, ARealLiverThatTheScanCutsIsNamedWithItsSideAndShare) {
  const fs::path volume = patient_volume("lits_liver_28.nii.gz");
  VISCERA_NEEDS_VOLUME(volume);
  const auto outcome = run(volume, {"labels={liver: 1, tumour: 2}"});
  EXPECT_EQ(outcome.code, static_cast<int>(ExitCode::gate_failed));
  EXPECT_NE(outcome.log.find("where:   superior side of the image, 2.9 % of the body's surface"),
            std::string::npos)
      << outcome.log;
}

TEST_F(Labels, ARealSegmentationBecomesOneBodyWithItsTumours) {
  const fs::path volume = patient_volume("lits_pred_liver_27.nii.gz");
  VISCERA_NEEDS_VOLUME(volume);
  const auto outcome = run(volume, {"labels={liver: 1, tumour: 2}", "border=refuse"});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const auto cleaned = read_image(out() / "labels.nrrd").image;
  LabelImage body = cleaned;
  for (auto& id : body.voxels) id = id != 0;
  EXPECT_EQ(find_components(body).list.size(), 2u);  // the body and the background
  const auto labels = testing::read_json(out() / "labels.json").at("labels");
  EXPECT_EQ(labels[0].at("name"), "liver");
  EXPECT_NEAR(labels[0].at("ml").get<double>(), 1393.9, 1.0);
  EXPECT_NEAR(labels[1].at("ml").get<double>(), 49.0, 0.5);
}

TEST(LabelFacts, AreVolumesFacesAndTheBoxAroundTheLabelsInPatientAxes) {
  LabelImage image;
  image.frame.size = {4, 3, 2};
  image.frame.spacing = {1.0, 2.0, 5.0};
  image.frame.direction = {0, -1, 0, 1, 0, 0, 0, 0, 1};  // i along y, j along -x
  image.voxels.assign(image.frame.voxels(), 0);
  image.voxels[image.frame.index(1, 1, 0)] = 3;
  image.voxels[image.frame.index(2, 1, 0)] = 8;
  image.names = {{3, "liver"}};
  const LabelFacts facts = find_facts(image);
  EXPECT_DOUBLE_EQ(facts.label_ml.at("liver"), 0.01);
  EXPECT_DOUBLE_EQ(facts.label_ml.at("label_8"), 0.01) << "which has no name";
  EXPECT_EQ(facts.extent_mm, (std::array{2.0, 2.0, 5.0}));
  EXPECT_EQ(facts.voxels, 24u);
  EXPECT_EQ(facts.voxel_faces, 2u + 4u + 2u + 1u)
      << "along i, of which one is between the labels; j; k";
  image.voxels.assign(image.frame.voxels(), 0);
  EXPECT_TRUE(find_facts(image).label_ml.empty());
}

}  // namespace
}  // namespace viscera
