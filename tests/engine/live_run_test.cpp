#include "pipeline/engine/store/live_run.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "pipeline/base/atomic_file.hpp"

namespace viscera::engine {
namespace {

namespace fs = std::filesystem;

TEST(LiveRuns, WhatTheyNoteIsHeardWhileTheyLive) {
  const TemporaryFolder folder(fs::temp_directory_path());
  {
    LiveRun run(folder.path()), other(folder.path());
    run.note("a");
    run.note("b");
    const LiveRuns live = live_runs(folder.path(), true);
    EXPECT_EQ(live.count, 2);
    EXPECT_EQ(live.noted, (std::set<std::string>{"a", "b"}));
  }
  EXPECT_EQ(live_runs(folder.path(), false).count, 0);
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

// A run may end between the listing of the folder and the look at its file. A link to nowhere is
// listed, too, and cannot be opened.
TEST(LiveRuns, AFileThatIsGoneWhenItIsOpenedIsNoRun) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const LiveRun run(folder.path());
  fs::create_symlink(folder.path() / "nowhere", folder.path() / "ended");
  EXPECT_EQ(live_runs(folder.path(), false).count, 1);
}

// The first file that such a process opens has the number 0.
TEST(LiveRuns, ARunWithoutAStandardInputLivesToo) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const int input = fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, 3);
  close(STDIN_FILENO);
  EXPECT_NO_THROW({
    LiveRun run(folder.path());
    run.note("a");
    EXPECT_EQ(live_runs(folder.path(), false).noted, std::set<std::string>{"a"});
  });
  if (input < 0) return;  // there was none before
  dup2(input, STDIN_FILENO);
  close(input);
}

}  // namespace
}  // namespace viscera::engine
