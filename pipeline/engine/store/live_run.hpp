// A run's sign of life in the store: a file that it keeps locked, and in it what it took or made.
// A killed run's file is locked by nobody.
#pragma once

#include <filesystem>
#include <set>
#include <string>

namespace viscera::engine {

class LiveRun {
 public:
  explicit LiveRun(const std::filesystem::path& folder);
  ~LiveRun();
  LiveRun(const LiveRun&) = delete;
  LiveRun& operator=(const LiveRun&) = delete;

  // A key, or the digest of an object.
  void note(const std::string& hash);

 private:
  std::filesystem::path path_;
  int file_ = -1;
};

// What the runs in `folder` that live have noted, and how many there are.
struct LiveRuns {
  std::set<std::string> noted;
  int count = 0;
};

// With `sweep` the files of runs that are gone are removed. Hold the store for yourself: a run that
// is just beginning has made its file before it could lock it.
LiveRuns live_runs(const std::filesystem::path& folder, bool sweep);

}  // namespace viscera::engine
