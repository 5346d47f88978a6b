// What every solver offers to the frame loop.
#pragma once

#include <string>

#include "sim/state.hpp"

namespace viscera::sim {

class Solver {
 public:
  virtual ~Solver() = default;
  virtual void advance_frame() = 0;  // one frame of `substeps` substeps
  virtual State state() const = 0;
  virtual void set_state(const State& state) = 0;
  virtual std::size_t contact_count() const = 0;  // vertices in contact at the end of the frame
  virtual std::string device() const = 0;         // "cpu, 2 threads", "cuda, NVIDIA H200"
};

}  // namespace viscera::sim
