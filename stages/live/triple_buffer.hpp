// One writer hands its newest value to one reader; neither ever waits for the other. The writer
// fills one of three, the reader looks at another, and the third lies between them: each side swaps
// its own for it.
#pragma once

#include <array>
#include <atomic>

namespace viscera::live {

template <class T>
class TripleBuffer {
 public:
  // Writer: back() is its own until publish().
  T& back() { return items_[back_]; }
  void publish() { back_ = middle_.exchange(back_ | fresh, std::memory_order_acq_rel) & index; }

  // Reader: whether front() is another value now.
  bool take() {
    if (!(middle_.load(std::memory_order_relaxed) & fresh)) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & index;
    return true;
  }
  const T& front() const { return items_[front_]; }

 private:
  static constexpr unsigned index = 3, fresh = 4;
  std::array<T, 3> items_{};
  unsigned back_ = 0, front_ = 1;
  std::atomic<unsigned> middle_{2};
};

}  // namespace viscera::live
