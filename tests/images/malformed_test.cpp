// Every malformed image under bounds of memory and time: 256 MB of data, 5 s.
#include "tests/images/malformed.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/exit_code.hpp"
#include "pipeline/engine/programs/process.hpp"

namespace viscera::testing {
namespace {

namespace fs = std::filesystem;

class MalformedImages : public ::testing::TestWithParam<const char*> {
 protected:
  static std::size_t count_files(const fs::path& folder) {
    return static_cast<std::size_t>(std::distance(fs::recursive_directory_iterator(folder), {}));
  }
  TemporaryFolder folder_{fs::temp_directory_path()};
};

TEST_P(MalformedImages, AreRefusedByFileAndFieldWithinBoundsAndLeaveNothing) {
  const fs::path corpus = folder_.path() / "corpus", temporary = folder_.path() / "temporary";
  fs::create_directories(corpus);
  fs::create_directories(temporary);
  const auto list = write_malformed(corpus);
  const auto before = count_files(corpus);
  int seen = 0;
  for (const auto& bad : list) {
    if (!bad.name.starts_with(GetParam())) continue;
    ++seen;
    SCOPED_TRACE(bad.name);
    std::string errors;
    const auto end = engine::run_process(
        {"/usr/bin/env", "TMPDIR=" + temporary.string(), "/bin/sh", "-c",
         "ulimit -d 262144 && ulimit -t 5 && exec \"$@\"", "sh", VISCERA_BIN "/viscera-labels",
         "--in", "volume=" + (corpus / bad.name).string(), "--out",
         (folder_.path() / "out").string()},
        [&errors](std::string_view line) { errors += std::string(line) + "\n"; });
    EXPECT_EQ(end.signal, 0);
    EXPECT_EQ(end.exit_code, static_cast<int>(ExitCode::bad_input)) << errors;
    const std::string file = fs::path(bad.name).filename().string();
    EXPECT_NE(errors.find(file), std::string::npos) << errors;
    EXPECT_NE(errors.find(bad.says), std::string::npos) << "'" << bad.says << "' in " << errors;
    EXPECT_EQ(std::count(errors.begin(), errors.end(), '\0'), 0);
    EXPECT_FALSE(fs::exists(folder_.path() / "out"));
  }
  EXPECT_GE(seen, 20);
  EXPECT_TRUE(fs::is_empty(temporary));
  EXPECT_EQ(count_files(corpus), before);
}

INSTANTIATE_TEST_SUITE_P(All, MalformedImages, ::testing::Values("nifti", "nrrd", "meta", "dicom"),
                         [](const auto& format) { return std::string(format.param); });

}  // namespace
}  // namespace viscera::testing
