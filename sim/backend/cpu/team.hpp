// A team of threads that runs one function together, with barriers in between. A substep has some
// 60 barriers a few microseconds apart, for which a task scheduler's hand-over is too slow: here a
// waiting thread spins for a moment before it sleeps.
#pragma once

#include <atomic>
#include <functional>
#include <thread>
#include <vector>

namespace viscera::sim {

class Team {
 public:
  explicit Team(int size) : size_(size) {
    for (int rank = 1; rank < size; ++rank) {
      threads_.emplace_back([this, rank] {
        for (;;) {
          meet();
          if (stop_) return;
          work_(rank);
          meet();
        }
      });
    }
  }
  ~Team() {
    stop_ = true;
    meet();
    for (auto& thread : threads_) thread.join();
  }
  Team(const Team&) = delete;
  Team& operator=(const Team&) = delete;

  // Threads that work together: 1 while the caller works alone.
  int size() const { return alone_ ? 1 : size_; }
  int most() const { return size_; }

  // work(rank) on every thread; the caller is rank 0. `work` must not throw.
  void run(std::function<void(int)> work) {
    work_ = std::move(work);
    meet();
    work_(0);
    meet();
  }
  // work(0) on the caller's thread only; the others sleep.
  template <class Work>
  void run_alone(Work&& work) {
    alone_ = true;
    work(0);
    alone_ = false;
  }

  // Within run: no thread goes on before all have come.
  void barrier() {
    if (!alone_) meet();
  }

 private:
  static constexpr int patience = 2000;  // spins, about 50 us

  void meet() {
    if (size_ == 1) return;
    const unsigned phase = phase_.load(std::memory_order_acquire);
    if (arrived_.fetch_add(1, std::memory_order_acq_rel) + 1 == size_) {
      arrived_.store(0, std::memory_order_relaxed);
      phase_.store(phase + 1, std::memory_order_release);
      phase_.notify_all();
      return;
    }
    for (int spin = 0; spin < patience; ++spin) {
      if (phase_.load(std::memory_order_acquire) != phase) return;
      relax();
    }
    phase_.wait(phase, std::memory_order_acquire);
  }

  static void relax() {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#endif
  }

  int size_;
  std::function<void(int)> work_;
  bool stop_ = false;
  bool alone_ = false;  // written while the others are parked
  std::atomic<int> arrived_{0};
  std::atomic<unsigned> phase_{0};
  std::vector<std::thread> threads_;
};

}  // namespace viscera::sim
