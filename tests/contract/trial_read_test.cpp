// A first reading in a process of its own: every way in which a reader ends is told from a return.
#include "pipeline/base/trial_read.hpp"

#include <dlfcn.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <iterator>
#include <new>
#include <stdexcept>

#include "pipeline/base/error.hpp"

namespace {

bool no_process_to_spare = false;

}  // namespace

// In place of the C library's: no limit on processes holds for root, as whom tests may run.
extern "C" pid_t fork() noexcept {
  static const auto real = reinterpret_cast<pid_t (*)()>(dlsym(RTLD_NEXT, "fork"));
  if (!no_process_to_spare) return real();
  errno = EAGAIN;
  return -1;
}

namespace viscera {
namespace {

namespace fs = std::filesystem;

std::ptrdiff_t open_files() {
  return std::distance(fs::directory_iterator("/proc/self/fd"), fs::directory_iterator());
}

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
  const auto forever = [] {
    const volatile bool ends = false;  // of which no compiler knows
    while (!ends) {
    }
    return std::string();
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

TEST(TrialRead, NothingIsHandedOverByAReaderThatCrashesOrEndsTheProcess) {
  const auto crash = [] {
    std::raise(SIGSEGV);
    return std::string("some");
  };
  EXPECT_EQ(read_in_child("/proc/self/exe", crash).result, "");
  const auto end = []() -> std::string { _Exit(0); };
  EXPECT_NE(read_in_child("/proc/self/exe", end).broken.find("crashes"), std::string::npos);
}

TEST(TrialRead, WhatAReaderThrowsIsThrownHereWithEachOfItsParts) {
  const auto refuse = []() -> std::string {
    throw Error(ExitCode::bad_config, {"a.msh", "Nodes", "2 \xff", "3", "write it again"});
  };
  try {
    read_in_child("/proc/self/exe", refuse);
    FAIL() << "nothing was thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::bad_config);
    const Problem& p = error.problem();
    EXPECT_EQ(p.where + '|' + p.field + '|' + p.found + '|' + p.allowed + '|' + p.remedy,
              "a.msh|Nodes|2 \xff|3|write it again");
  }
  const auto fail = []() -> std::string { throw std::invalid_argument("what a library says"); };
  try {
    read_in_child("/proc/self/exe", fail);
    FAIL() << "nothing was thrown";
  } catch (const std::runtime_error& e) {
    EXPECT_STREQ(e.what(), "what a library says");
  }
  const auto no_exception = []() -> std::string { throw 1; };
  EXPECT_THROW(read_in_child("/proc/self/exe", no_exception), std::runtime_error);
}

TEST(TrialRead, NoFileIsLeftOpen) {
  const auto before = open_files();
  EXPECT_EQ(what_breaks([] {}), "");
  EXPECT_EQ(open_files(), before);
}

TEST(TrialRead, WithoutAProcessToSpareThisOneReadsAndLeavesNoFileOpen) {
  const auto before = open_files();
  int readings = 0;
  const auto read = [&readings] {
    ++readings;
    return std::string("some");
  };
  no_process_to_spare = true;
  const ChildReading handed = read_in_child("/proc/self/exe", read);
  no_process_to_spare = false;
  EXPECT_EQ(handed.broken, "");
  EXPECT_EQ(handed.result, "some");
  EXPECT_EQ(readings, 1);
  EXPECT_EQ(open_files(), before);
}

// Whoever starts us may have chosen so (it is inherited): the system then keeps no child's end.
TEST(TrialRead, AProcessThatIgnoresTheEndsOfItsChildrenDoesNotWaitForThemForEver) {
  const auto read_and_exit = [] {
    alarm(10);  // seconds until this ends the process
    std::signal(SIGCHLD, SIG_IGN);
    const auto read = [] { return std::string("some"); };
    _Exit(read_in_child("/proc/self/exe", read).result == "some" ? 0 : 1);
  };
  EXPECT_EXIT(read_and_exit(), testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace viscera
