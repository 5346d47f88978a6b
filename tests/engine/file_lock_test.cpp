// What is said of a folder on a file system without locks, where waiting would not help.
#include "pipeline/engine/store/file_lock.hpp"

#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"

namespace {

int refusal = 0;  // the error that every lock meets; 0: none

}  // namespace

// In place of the C library's: file systems without locks are not at hand where tests run.
extern "C" int flock(int file, int operation) noexcept {
  if (refusal == 0) return static_cast<int>(syscall(SYS_flock, file, operation));
  errno = refusal;
  return -1;
}

namespace viscera::engine {
namespace {

class Locks : public testing::Test {
 protected:
  ~Locks() override { refusal = 0; }

  // Who holds the lock where every attempt fails with this error, or what is said of it.
  std::string said(int error) const {
    refusal = error;
    std::string held_by;
    try {
      EXPECT_FALSE(FileLock::attempt(path_, "run demo", held_by));
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::usage);
      EXPECT_EQ(e.problem().where, path_.string());
      EXPECT_FALSE(e.problem().remedy.empty());
      return e.problem().found;
    }
    return held_by;
  }

  const TemporaryFolder folder_{std::filesystem::temp_directory_path()};
  const std::filesystem::path path_ = folder_.path() / ".lock";
};

TEST_F(Locks, AFileSystemWithoutLocksIsNamedAndNotTakenForAnotherHolder) {
  EXPECT_EQ(said(ENOLCK), "cannot be locked: No locks available");
  EXPECT_EQ(said(EOPNOTSUPP), "cannot be locked: Operation not supported");
}

TEST_F(Locks, OneThatIsHeldOrInterruptedIsWaitedFor) {
  EXPECT_EQ(said(EWOULDBLOCK), "another process");
  EXPECT_EQ(said(EINTR), "another process");
}

TEST_F(Locks, TheHolderIsNamedToWhoeverComesNext) {
  std::string held_by;
  const auto lock = FileLock::attempt(path_, "run demo", held_by);
  ASSERT_TRUE(lock);
  EXPECT_FALSE(FileLock::attempt(path_, "gc", held_by));
  EXPECT_EQ(held_by, "process " + std::to_string(getpid()) + " (run demo)");
}

TEST_F(Locks, WhoHoldsOneIsKnownWithoutAWord) {
  EXPECT_EQ(FileLock::holder_of(path_), "") << "there is no such file";
  EXPECT_FALSE(std::filesystem::exists(path_));
  std::string held_by;
  auto lock = FileLock::attempt(path_, "run demo", held_by);
  ASSERT_TRUE(lock);
  EXPECT_NE(FileLock::holder_of(path_).find("(run demo)"), std::string::npos);
  lock.reset();
  EXPECT_EQ(FileLock::holder_of(path_), "");
  EXPECT_NE(read_file(path_).find("run demo"), std::string::npos) << "the file is as it was";
}

}  // namespace
}  // namespace viscera::engine
