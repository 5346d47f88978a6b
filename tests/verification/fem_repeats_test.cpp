// The finite elements repeat themselves to the bit: beside other solvers of the process, and
// whatever number of threads the libraries underneath are told.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <thread>

#include "tests/verification/fem_setup.hpp"

namespace viscera::sim {
namespace {

// A drop with contact and friction: the hash of the state after it.
std::uint64_t drop_hash(int cells, int frames) {
  Scene scene = drop_scene();
  scene.params<Ground>().front().clearance = 1e-3;
  scene.time.substeps = 2;
  const auto solver = make_on_cpu(make_cube(cells), scene, dynamics(1e-8));
  for (int frame = 0; frame < frames; ++frame) solver->advance_frame();
  return solver->state().hash();
}

TEST(FemRepeats, ToTheBitWhileOtherSolversRunBesideIt) {
  const std::uint64_t alone = drop_hash(4, 5);
  std::vector<std::uint64_t> found(12);
  {
    std::vector<std::jthread> threads;
    for (std::size_t t = 0; t < 4; ++t) {
      threads.emplace_back([&found, t] {
        for (std::size_t i = t; i < found.size(); i += 4) found[i] = drop_hash(4, 5);
      });
    }
  }
  for (const std::uint64_t hash : found) EXPECT_EQ(hash, alone);
}

// Says what it found: the test below asks processes of this program for it.
TEST(FemRepeats, ToTheBitInOneProcess) {
  const std::uint64_t hash = drop_hash(6, 4);
  EXPECT_EQ(drop_hash(6, 4), hash);
  std::printf("hash %016llx\n", static_cast<unsigned long long>(hash));
}

TEST(FemRepeats, ToTheBitWithAnyNumberOfThreadsOfTheLibraries) {
  const auto run = [](const std::string& threads) {
    const std::string command = "OMP_NUM_THREADS=" + threads + " OPENBLAS_NUM_THREADS=" + threads +
                                " MKL_NUM_THREADS=" + threads + " /proc/" +
                                std::to_string(getpid()) +
                                "/exe --gtest_filter=FemRepeats.ToTheBitInOneProcess 2>&1";
    FILE* const pipe = popen(command.c_str(), "r");
    if (!pipe) return std::string("no process");
    std::string said;
    for (int c; (c = std::fgetc(pipe)) != EOF;) said += static_cast<char>(c);
    EXPECT_EQ(pclose(pipe), 0) << said;
    const auto at = said.find("hash ");
    return at == std::string::npos ? said : said.substr(at, 21);
  };
  const std::string one = run("1");
  EXPECT_TRUE(one.starts_with("hash ")) << one;
  EXPECT_EQ(run("2"), one);
  EXPECT_EQ(run("7"), one);
}

}  // namespace
}  // namespace viscera::sim
