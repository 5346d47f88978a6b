// A first reading in a process of its own: every way in which a reader ends is told from a return.
#include "stages/common/trial_read.hpp"

#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <new>
#include <stdexcept>

namespace viscera {
namespace {

std::string what_breaks(const std::function<void()>& read) {
  return what_breaks_reading("/proc/self/exe", read);
}

TEST(TrialRead, ReadersThatReturnOrRefuseBreakNothing) {
  EXPECT_EQ(what_breaks([] {}), "");
  EXPECT_EQ(what_breaks([] { throw std::runtime_error("refused"); }), "");
}

TEST(TrialRead, ACrashIsToldAlsoWhereThisProcessHandlesItsSignal) {
  const auto before = std::signal(SIGSEGV, [](int) { _Exit(0); });
  const std::string broken = what_breaks([] { std::raise(SIGSEGV); });
  std::signal(SIGSEGV, before);
  EXPECT_NE(broken.find("crashes"), std::string::npos) << broken;
}

TEST(TrialRead, AnEndOfTheProcessAndAWantOfMemoryAreTold) {
  EXPECT_NE(what_breaks([] { _Exit(1); }).find("crashes"), std::string::npos);
  EXPECT_NE(what_breaks([] { throw std::bad_alloc(); }).find("claims more"), std::string::npos);
}

}  // namespace
}  // namespace viscera
