// What stages that run side by side share: GPUs, one stage each, and the processor's threads.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace viscera::engine {

class Devices {
 public:
  // `gpus`: so many at most; else those of the machine. Where there is none, stages that may use
  // one are as free as all others: they fall back to the processor, or say that they cannot.
  explicit Devices(std::optional<std::size_t> gpus);

  // One that is not among the busy; none when all are.
  std::optional<std::size_t> free_one(const std::vector<std::size_t>& busy) const;

  // For a stage on this GPU: CUDA_VISIBLE_DEVICES, where there is a choice.
  std::vector<std::string> environment(std::size_t gpu) const;

  // Threads of each of `jobs` stages at once: so many as asked for, else their share; 0: all.
  static unsigned threads_each(std::size_t jobs, unsigned asked);

 private:
  std::vector<std::string> names_;  // as CUDA_VISIBLE_DEVICES has them
  std::size_t count_ = 0;
  bool unlimited_ = false;
};

}  // namespace viscera::engine
