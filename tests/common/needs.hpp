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

// CI installs all of .packages and may not skip for want of them.
inline bool must_have_packages() {
  return std::getenv("VISCERA_REQUIRE_PACKAGES") != nullptr;
}

}  // namespace viscera

// Skips the test unless `condition` holds; fails it where VISCERA_REQUIRE_PACKAGES is set.
#define VISCERA_NEEDS(condition, package)                                          \
  if (!(condition)) {                                                              \
    if (::viscera::must_have_packages()) FAIL() << package << " is not installed"; \
    GTEST_SKIP() << package << " is not installed";                                \
  }                                                                                \
  static_assert(true)
