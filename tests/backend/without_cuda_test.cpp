// What a build without nvcc says of devices, in every build: its stand-in is compiled into this
// test.
#include <gtest/gtest.h>

#include "sim/backend/cuda/cuda.hpp"
#include "sim/base/refusal.hpp"

namespace viscera::sim {
namespace {

TEST(WithoutCuda, ADeviceThatIsAskedForIsRefusedWithTheOneCommandThatBuildsIt) {
  EXPECT_FALSE(find_cuda_device().name);
  try {
    make_ensemble_on_cuda({}, {}, {}, 1, {});
    FAIL() << "made without a backend";
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.cause, Refusal::Cause::device);
    EXPECT_EQ(refusal.field, "device");
    EXPECT_EQ(refusal.found, "this build has no CUDA backend");
    EXPECT_EQ(refusal.remedy, "make cuda, or use device: cpu");
  }
}

}  // namespace
}  // namespace viscera::sim
