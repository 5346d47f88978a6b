// Which files an input stands for: a change in any of them must be seen, and nothing else read.
#include "pipeline/contract/input_digest.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

struct Detached {
  const char* name;    // of the case
  const char* header;  // file
  const char* text;    // its content
  const char* data;    // the file that holds the pixels
};

class DetachedData : public testing::TestWithParam<Detached> {
 protected:
  fs::path file(const std::string& name, const std::string& text) const {
    const fs::path path = folder_.path() / name;
    fs::create_directories(path.parent_path());
    std::ofstream(path) << text;
    return path;
  }
  TemporaryFolder folder_{fs::temp_directory_path()};
};

TEST_P(DetachedData, ChangesTheDigestOfItsHeaderAndIsCountedInItsSize) {
  const fs::path header = file(GetParam().header, GetParam().text);
  file(GetParam().data, "1");
  const FileDigest before = input_digest(header);
  EXPECT_EQ(before.path, header.string());
  EXPECT_EQ(before.bytes, fs::file_size(header) + 1);
  file("bystander.txt", "not read");
  EXPECT_EQ(input_digest(header).sha256, before.sha256);
  file(GetParam().data, "2");
  EXPECT_NE(input_digest(header).sha256, before.sha256);
}

INSTANTIATE_TEST_SUITE_P(
    Each, DetachedData,
    testing::Values(
        Detached{"nhdr", "a.nhdr", "NRRD0004\ndata file: a.raw\n", "a.raw"},
        Detached{"nrrd_by_content", "a.nrrd", "NRRD0004\n# c\nData File: p/a.raw\n", "p/a.raw"},
        Detached{"nrrd_list", "a.nhdr", "NRRD0004\ndatafile: LIST 2\ns1.raw\ns2.raw\n", "s2.raw"},
        Detached{"nrrd_pattern", "a.nhdr", "NRRD0004\ndata file: p/s%03d.raw 1 9 1\n",
                 "p/s007.raw"},
        Detached{"mhd", "a.mhd", "NDims = 3\nElementDataFile = a.raw\n", "a.raw"},
        Detached{"mha_by_content", "a.mha", "NDims = 3\r\nElementDataFile = a.raw\r\n", "a.raw"},
        Detached{"meta_list", "a.mhd", "NDims = 3\nElementDataFile = LIST\ns1.raw\n", "s1.raw"},
        Detached{"meta_pattern", "a.mhd", "NDims = 3\nElementDataFile = s%d.raw 1 9 1\n", "s3.raw"},
        Detached{"nifti_header", "a.hdr", "\x5c\x01", "a.img"},
        Detached{"nifti_image", "a.img", "pixels", "a.hdr"},
        Detached{"nifti_gz", "a.hdr.gz", "packed", "a.img.gz"}),
    [](const auto& instance) { return std::string(instance.param.name); });

using InputDigest = DetachedData;

TEST_F(InputDigest, OfAFileThatHoldsItsOwnDataIsItsSha256) {
  for (const char* text : {"plain", "NRRD0004\n\ndata file: other.raw\n",
                           "NDims = 3\nElementDataFile = LOCAL\n\x01\x02", ""}) {
    const fs::path path = file("a.nrrd", text);
    file("other.raw", "x");
    EXPECT_EQ(input_digest(path).sha256, sha256(text)) << text;
  }
}

TEST_F(InputDigest, AMissingDataFileIsLeftToTheReader) {
  for (const char* text :
       {"NDims = 3\nElementDataFile = gone.raw\n",
        "NDims = 3\nElementDataFile = gone/s%d.raw 1 2 1\n", "NDims = 3\nElementDataFile = .\n",
        "NDims = 3\nElementDataFile = 100%\n"}) {
    const fs::path header = file("a.mhd", text);
    file("sub/big.raw", "not read");
    EXPECT_EQ(input_digest(header).sha256, sha256(text)) << text;
  }
}

TEST_F(InputDigest, RefusesWhatIsNeitherAFileNorAFolder) {
  for (const char* path : {"/dev/zero", "/nowhere/a.nrrd"}) {
    try {
      input_digest(path);
      FAIL() << path;
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::bad_input);
      EXPECT_EQ(e.problem().where, path);
    }
  }
}

}  // namespace
}  // namespace viscera
