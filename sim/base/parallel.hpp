// Loops whose iterations do not depend on each other, shared by all cores.
#pragma once

#include <algorithm>
#include <cstddef>
#include <exception>
#include <thread>
#include <vector>

namespace viscera::sim {

// Calls work(begin, end) for parts that make up [0, count). Results must not depend on the parts.
// The first part's exception, if any, is thrown when all have ended.
template <class Work>
void parallel_ranges(std::size_t count, Work work) {
  const std::size_t threads =
      std::max<std::size_t>(1, std::min<std::size_t>(std::thread::hardware_concurrency(), count));
  std::vector<std::exception_ptr> failures(threads);
  std::vector<std::thread> pool;
  const auto part = [&](std::size_t t) {
    try {
      work(count * t / threads, count * (t + 1) / threads);
    } catch (...) {
      failures[t] = std::current_exception();
    }
  };
  for (std::size_t t = 1; t < threads; ++t) pool.emplace_back(part, t);
  part(0);
  for (auto& thread : pool) thread.join();
  for (const auto& failure : failures)
    if (failure) std::rethrow_exception(failure);
}

}  // namespace viscera::sim
