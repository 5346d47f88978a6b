// Parts of the body that threads go through without waiting for one another, and the team's
// barriers.
#include "sim/backend/cpu/parts.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <set>

#include "sim/base/team.hpp"
#include "sim/element_choice.hpp"
#include "sim/make.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

TEST(Parts, OfOneStageShareNoVertexAndHaveEveryElementOnce) {
  const Model model = make_cube(9);
  const std::span<const Tet> tets(model.tets);
  for (const int levels : {0, 1, 3}) {
    const Halving halving{static_cast<int>(model.vertex_count()), levels};
    const auto stages = in_parts<4>(halving, tets);
    ASSERT_EQ(stages.size(), static_cast<std::size_t>(levels + 1));
    std::set<int> seen;
    for (const auto& parts : stages) {
      std::vector<int> part_of(model.vertex_count(), -1);
      for (int part = 0; part < static_cast<int>(parts.size()); ++part) {
        EXPECT_TRUE(std::ranges::is_sorted(parts[part]));
        for (const int e : parts[part]) {
          EXPECT_TRUE(seen.insert(e).second) << "twice";
          for (const int v : tets[e]) {
            EXPECT_TRUE(part_of[v] < 0 || part_of[v] == part) << "in two parts of a stage";
            part_of[v] = part;
          }
        }
      }
    }
    EXPECT_EQ(seen.size(), tets.size());
  }
}

TEST(Parts, AreAsManyAsHaveColoursThatFillTheirLanes) {
  const auto levels = [](int cells) {
    const Model model = make_cube(cells);
    const auto vertices = static_cast<int>(model.vertex_count());
    return Halving::of(vertices, color_elements<4>(std::span<const Tet>(model.tets), vertices))
        .levels;
  };
  EXPECT_EQ(levels(6), 0) << "few elements are one part, in the order of a device's colours";
  EXPECT_GT(levels(12), 0);
  EXPECT_GT(levels(20), levels(12));
}

// Hash of the state after a frame of two substeps.
std::uint64_t hash_of(const Model& model, const Scene& scene, SolverOptions options, int threads) {
  options.threads = threads;
  const auto solver = make_on_cpu(model, scene, options);
  solver->advance_frame();
  return solver->state().hash();
}

// 48,000 tets in 8 parts: of some stages more, of others fewer than threads.
TEST(Parts, AnyNumberOfThreadsGivesTheSameBits) {
  const Model model = make_cube(20);
  Scene scene;
  scene.params<NeoHookean>().emplace_back();
  scene.params<Gravity>().emplace_back();
  scene.params<Viscosity>().emplace_back();
  scene.params<Fixed>().push_back({{.side = "superior"}});
  scene.time = {.frame_s = 1e-3, .substeps = 2};
  Scene smoothed = scene;
  set_element(smoothed.effects, Element::smoothed, 0.45);
  const auto check = [&](const Scene& which, const SolverOptions& options, const char* name) {
    const std::uint64_t one = hash_of(model, which, options, 1);
    for (const int threads : {2, 3, 5})
      EXPECT_EQ(hash_of(model, which, options, threads), one) << name << ", " << threads;
  };
  check(scene, {}, "linear");
  check(smoothed, {}, "smoothed");
  check(scene, {.iterations = 2}, "two iterations");
  check(scene, {.scheme = Scheme::jacobi}, "Jacobi");
  check(scene, {.method = Method::tled}, "explicit");
}

// Two groups of three threads meet among themselves, one more often than the other, and then all.
TEST(Team, SomeMeetWithoutWaitingForTheOthers) {
  Team team(6);
  std::vector<std::atomic<int>> steps(6);
  std::atomic<int> late{0};
  constexpr int turns = 50;
  for (int turn = 0; turn < turns; ++turn) {
    team.run([&](int rank) {
      const Range ranks = rank < 3 ? Range{0, 3} : Range{3, 6};
      const int meetings = rank < 3 ? 7 : 2;
      for (int meeting = 0; meeting < meetings; ++meeting) {
        ++steps[rank];
        const int own = steps[rank];
        team.barrier(ranks);
        for (int other = ranks.begin; other < ranks.end; ++other) late += steps[other] < own;
        team.barrier(ranks);
      }
      team.forget();
      team.barrier();
      late += steps[(rank + 3) % 6] < (rank < 3 ? 2 : 7) * (turn + 1);
    });
  }
  EXPECT_EQ(late.load(), 0);
}

}  // namespace
}  // namespace viscera::sim
