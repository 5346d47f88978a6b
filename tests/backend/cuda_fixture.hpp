// What all tests of the CUDA backend have. Without a device each says that it was skipped, and
// fails instead when VISCERA_REQUIRE_GPU is set, as `make test-gpu` does: a skipped GPU test is not
// a pass.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/backend/host_blocks.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {

// In no namespace without a name: GoogleTest wants one class for all tests of a suite.
class Cuda : public testing::Test {
 protected:
  void SetUp() override {
    const CudaDevice device = find_cuda_device();
    if (device.name) return;
    if (std::getenv("VISCERA_REQUIRE_GPU")) FAIL() << "no CUDA device: " << device.why_not;
    GTEST_SKIP() << "no CUDA device: " << device.why_not;
  }
};

inline double largest_difference(const State& a, const State& b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.u.size(); ++i) largest = std::max(largest, norm(a.u[i] - b.u[i]));
  return largest;
}

}  // namespace viscera::sim
