#include "pipeline/engine/store/live_run.hpp"

#include <gtest/gtest.h>

#include "pipeline/contract/atomic_file.hpp"

namespace viscera {
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

}  // namespace
}  // namespace viscera
