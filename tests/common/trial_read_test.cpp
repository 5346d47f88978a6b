// A first reading in a process of its own: every way in which a reader ends is told from a return.
#include "pipeline/base/trial_read.hpp"

#include <gtest/gtest.h>

#include <atomic>
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

TEST(TrialRead, AReadingWithoutEndIsEnded) {
  const auto forever = []() -> std::string {
    for (;;) std::atomic_thread_fence(std::memory_order_seq_cst);
  };
  const std::string broken = read_in_child("/dev/null", forever, 1).broken;
  EXPECT_EQ(broken, "damaged: its reader does not end within 1 s");
}

TEST(TrialRead, WhatAChildReadsIsHandedOverWholeAndChangesNothingHere) {
  static int writes = 0;
  const std::string much(3 << 20, '\0');  // more than a pipe holds
  const auto read = [&much] {
    ++writes;
    return much;
  };
  const ChildReading handed = read_in_child("/proc/self/exe", read);
  EXPECT_EQ(handed.broken, "");
  EXPECT_EQ(handed.result, much);
  EXPECT_EQ(writes, 0) << "read in this process";
}

TEST(TrialRead, NothingIsHandedOverByAReaderThatCrashesOrThrows) {
  const auto crash = [] {
    std::raise(SIGSEGV);
    return std::string("some");
  };
  EXPECT_EQ(read_in_child("/proc/self/exe", crash).result, "");
  const auto refuse = []() -> std::string { throw std::runtime_error("refused"); };
  const ChildReading refused = read_in_child("/proc/self/exe", refuse);
  EXPECT_EQ(refused.broken, "");
  EXPECT_EQ(refused.result, "");
}

}  // namespace
}  // namespace viscera
