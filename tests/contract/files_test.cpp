#include <gtest/gtest.h>

#include <filesystem>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/contract/manifest.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

TEST(AtomicFile, AFileAppearsWholeAndLeavesNothingBesideIt) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const fs::path path = folder.path() / "a.txt";
  write_atomically(path, "one");
  write_atomically(path, "two");
  EXPECT_EQ(read_file(path), "two");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 1);
}

TEST(AtomicFile, ADeviceIsNotReadAsAFile) {
  EXPECT_THROW(read_file("/dev/zero"), Error);
}

TEST(AtomicFile, AnUnwritableFolderIsRefusedByName) {
  try {
    write_atomically("/proc/nowhere/a.txt", "x");
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::usage);
    EXPECT_NE(std::string(e.what()).find("/proc/nowhere/a.txt"), std::string::npos);
  }
}

TEST(TemporaryFolder, TakesAwayTheParentsThatItMadeUnlessSomethingIsInThem) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const fs::path made = folder.path() / "a" / "b";
  { const TemporaryFolder inner(made / ""); }
  EXPECT_FALSE(fs::exists(folder.path() / "a"));
  {
    const TemporaryFolder inner(made);
    write_atomically(made / "result.txt", "kept");
  }
  EXPECT_TRUE(fs::exists(made / "result.txt"));
  fs::remove(made / "result.txt");
  { const TemporaryFolder inner(made); }
  EXPECT_TRUE(fs::exists(made)) << "it was there before";
}

// A link to nowhere is no folder, and none can be made in its place.
TEST(TemporaryFolder, AParentThatCannotBeMadeIsRefusedWithTheReason) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const fs::path parent = folder.path() / "out";
  fs::create_symlink(folder.path() / "nowhere", parent);
  std::error_code reason;
  fs::create_directories(parent, reason);
  ASSERT_TRUE(reason);
  try {
    const TemporaryFolder refused(parent);
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::usage);
    EXPECT_EQ(e.problem().where, parent.string());
    EXPECT_EQ(e.problem().found, "cannot be written: " + reason.message());
  }
  EXPECT_TRUE(fs::is_symlink(parent)) << "the link of the user is gone";
}

TEST(Digest, Sha256MatchesThePublishedVector) {
  // FIPS 180-4, "abc"
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Digest, AKeyTellsComponentsApart) {
  KeyTranscript a, b;
  a.add("param", "x", "1\nparam y = [1] 2");
  b.add("param", "x", "1");
  b.add("param", "y", "2");
  EXPECT_NE(a.key(), b.key());
}

TEST(Manifest, OfAPathOnlyTheLastNameIsShown) {
  EXPECT_EQ(file_name("/home/x/ct.nii.gz"), "ct.nii.gz");
  EXPECT_EQ(file_name("ct.nii.gz"), "ct.nii.gz");
  EXPECT_EQ(file_name("/home/x/dicom//"), "dicom");
  EXPECT_EQ(file_name("/"), "/");
}

TEST(Manifest, AFileNameMayBeAsLongAsTheSystemAllowsAndStaysInItsFolder) {
  EXPECT_TRUE(is_file_name("a"));
  EXPECT_TRUE(is_file_name(std::string(255, 'a')));
  for (const std::string& name :
       {std::string(256, 'a'), std::string(), std::string("."), std::string(".."),
        std::string("a/b"), std::string("/a"), std::string("a\0b", 3)}) {
    EXPECT_FALSE(is_file_name(name)) << name;
  }
}

TEST(Manifest, SurvivesTheWayThroughJson) {
  Manifest manifest{.stage = "tetmesh", .version = "1", .exit = ExitCode::gate_failed};
  manifest.params = Json{{"cell_size", 5.0}};
  manifest.inputs.emplace("surface", FileDigest{"s.vtp", "ab", 12});
  manifest.outputs.push_back({"mesh.vtu", "cd", 34});
  manifest.metrics.push_back({"tets", 10, "1"});
  manifest.metrics.push_back({"rate", 1e6, "1/s", true});
  manifest.uncacheable = "the device failed";
  const GateInfo angle("min_dihedral", ">=", "deg", "The mesh has slivers.", "lower cell_size");
  manifest.gates.push_back(judged(angle, 9.0, 10.0, {.where = "there", .at = {{1, 2, 3}}}));
  manifest.caveats = {"The body is cut."};
  manifest.wall_s = 2.5, manifest.cpu_s = 4.5, manifest.max_rss_mb = 80.0;
  const Json json = to_json(manifest);
  EXPECT_EQ(to_json(manifest_from_json({json, "manifest.json"})), json);
  EXPECT_FALSE(manifest.gates[0].passed());
}

}  // namespace
}  // namespace viscera
