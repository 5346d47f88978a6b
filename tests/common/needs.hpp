// Tests that need a program which not every machine has.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
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

}  // namespace viscera

// Skips the test unless `condition` holds, and says what is missing; fails it where
// VISCERA_REQUIRE_PACKAGES is set.
#define VISCERA_NEEDS(condition, missing)                   \
  if (!(condition)) {                                       \
    if (::viscera::must_have_packages()) FAIL() << missing; \
    GTEST_SKIP() << missing;                                \
  }                                                         \
  static_assert(true)
