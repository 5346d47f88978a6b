// A mesher that never ends must neither hang a pipeline nor take a machine's memory with it: for as
// long as a Watchdog lives, time and memory are bounded. The bounds are far beyond what good inputs
// need, and no result depends on them.
#pragma once

#include <sys/resource.h>

#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <thread>

namespace viscera {

// Throws Error(try_again) when this machine does not have these bytes to spare.
void check_memory(double expected_bytes);

class Watchdog {
 public:
  // Allocations beyond thrice `expected_bytes` and a gigabyte fail (std::bad_alloc); after
  // `seconds` the process ends with exit 75, and `folder`, its unfinished outputs, is removed, as
  // is an empty folder around it.
  Watchdog(double seconds, double expected_bytes, std::filesystem::path folder);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

 private:
  void watch(double seconds, const std::filesystem::path& folder);

  rlimit before_{};
  std::mutex mutex_;
  std::condition_variable ended_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace viscera
