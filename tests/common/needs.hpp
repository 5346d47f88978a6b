// Tests that need a program which not every machine has.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

namespace viscera {

// Whether a shell command ends with 0.
inline bool works(const std::string& command) {
  return std::system((command + " >/dev/null 2>&1").c_str()) == 0;
}
inline bool installed(const std::string& program) {
  return works("command -v " + program);
}

// CI has all of .packages and may not skip for want of what they bring.
inline bool must_have_packages() {
  return std::getenv("VISCERA_REQUIRE_PACKAGES") != nullptr;
}

// Segmentations of patients, which do not come with the project: their folder lies beside it.
inline std::filesystem::path patient_volume(const std::string& name) {
  return std::filesystem::path("../shared/data") / name;
}

}  // namespace viscera

// Skips the test where that folder is not here; a clone has none. Of a volume that is missing from
// it the test fails, as its stage does.
#define VISCERA_NEEDS_VOLUME(file)                                                            \
  if (const auto folder = (file).parent_path(); !std::filesystem::exists(folder)) {           \
    GTEST_SKIP() << "the segmentations of patients are not here (" << folder.string() << ")"; \
  }                                                                                           \
  static_assert(true)

// Skips the test unless `condition` holds, and says what is missing; fails it where
// VISCERA_REQUIRE_PACKAGES is set.
#define VISCERA_NEEDS(condition, missing)                   \
  if (!(condition)) {                                       \
    if (::viscera::must_have_packages()) FAIL() << missing; \
    GTEST_SKIP() << missing;                                \
  }                                                         \
  static_assert(true)
