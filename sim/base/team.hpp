// A team of threads that runs one function together, with barriers in between. A substep has some
// 60 barriers a few microseconds apart, for which a task scheduler's hand-over is too slow: here a
// waiting thread spins for a moment before it sleeps.
//
// A barrier is a dissemination barrier (Hensgen, Finkel and Manber, "Two algorithms for barrier
// synchronization", 1988): in round k each thread tells the one 2^k ranks behind it that it has
// come, and after log2(n) rounds each has heard of all. Every word has one writer and one reader
// and a cache line of its own, where one counter for all is fetched by each of them in turn.
#pragma once

#include <atomic>
#include <functional>
#include <thread>
#include <vector>

#include "sim/base/range.hpp"

namespace viscera::sim {

class Team {
 public:
  explicit Team(int size) : size_(size) {
    while ((1 << rounds_) < size) ++rounds_;
    words_ = std::vector<Word>(static_cast<std::size_t>(size * (rounds_ + 1)));
    words_of_some_ = std::vector<Word>(words_.size());
    for (int rank = 1; rank < size; ++rank) {
      threads_.emplace_back([this, rank] {
        here = {this, rank};
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
  // The same of the threads of these ranks, one of which calls. Between a meeting of some and one
  // of others lies forget() and a barrier of all.
  void barrier(Range ranks) { meet(words_of_some_, rank() - ranks.begin, ranks); }
  void forget() {
    for (int round = 0; round <= rounds_; ++round)
      word(words_of_some_, rank(), round).count.store(0, std::memory_order_relaxed);
  }

 private:
  static constexpr int patience = 2000;  // spins, about 50 us

  // What a thread has heard in one round, or how often it has come.
  struct alignas(64) Word {
    std::atomic<unsigned> count{0};
  };
  // Which team a thread belongs to; of others it is the caller, whose rank is 0.
  struct Place {
    const Team* team;
    int rank;
  };
  static inline thread_local Place here{nullptr, 0};

  int rank() const { return here.team == this ? here.rank : 0; }
  Word& word(std::vector<Word>& words, int rank, int round) const {
    return words[rank * (rounds_ + 1) + round];
  }

  void meet() { meet(words_, rank(), {0, size_}); }
  // `place` among the ranks that meet.
  void meet(std::vector<Word>& words, int place, Range ranks) {
    const int count = ranks.end - ranks.begin;
    std::atomic<unsigned>& comings = word(words, ranks.begin + place, rounds_).count;
    const unsigned now = comings.load(std::memory_order_relaxed) + 1;
    comings.store(now, std::memory_order_relaxed);
    for (int round = 0; 1 << round < count; ++round) {
      const int told = ranks.begin + (place + (1 << round)) % count;
      std::atomic<unsigned>& theirs = word(words, told, round).count;
      theirs.store(now, std::memory_order_release);
      theirs.notify_one();
      wait_for(word(words, ranks.begin + place, round).count, now);
    }
  }

  // Who tells may have come once more already.
  static void wait_for(const std::atomic<unsigned>& heard, unsigned now) {
    const auto has_come = [now](unsigned count) { return static_cast<int>(count - now) >= 0; };
    for (int spin = 0; spin < patience; ++spin) {
      if (has_come(heard.load(std::memory_order_acquire))) return;
      relax();
    }
    for (;;) {
      const unsigned count = heard.load(std::memory_order_acquire);
      if (has_come(count)) return;
      heard.wait(count, std::memory_order_acquire);
    }
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
  int rounds_ = 0;
  std::vector<Word> words_, words_of_some_;  // [size][rounds + 1], of all and of some
  std::vector<std::thread> threads_;
};

}  // namespace viscera::sim
