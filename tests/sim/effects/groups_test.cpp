// Groups of tets for the volume of nearly incompressible tissue: what they are, and that bodies of
// smoothed elements beside them do not lock.
#include <gtest/gtest.h>

#include <set>

#include "sim/element_choice.hpp"
#include "sim/model/tet_groups.hpp"
#include "tests/verification/fem_setup.hpp"
#include "tests/verification/truth.hpp"

namespace viscera::sim {
namespace {

Model box_of(const Material& material) {
  return make_five_tet_box({0.05, 0.04, 0.03}, {5, 4, 3}, material);
}

TetGroups all_of(const Model& model) {
  return {model, std::vector<char>(model.tet_count(), 1)};
}

TEST(TetGroups, HaveEachTetOnceAndSomeEightOfThem) {
  const Model model = box_of(soft_tissue);
  const TetGroups groups = all_of(model);
  std::vector<int> times(model.tet_count());
  for (std::size_t g = 0; g < groups.size(); ++g) {
    double sum = 0.0;
    for (const int t : groups.tets_of(g)) ++times[t], sum += model.volume[t];
    EXPECT_DOUBLE_EQ(groups.volume[g], sum);
  }
  EXPECT_EQ(times, std::vector<int>(model.tet_count(), 1));
  const double mean = static_cast<double>(model.tet_count()) / static_cast<double>(groups.size());
  EXPECT_GT(mean, 7.0);
  EXPECT_LT(mean, 10.0);
}

TEST(TetGroups, AreJoinedAcrossFaces) {
  const Model model = box_of(soft_tissue);
  const TetGroups groups = all_of(model);
  const auto share_a_face = [&model](int a, int b) {
    int shared = 0;
    for (const int v : model.tets[a]) shared += std::ranges::count(model.tets[b], v) > 0;
    return shared == 3;
  };
  for (std::size_t g = 0; g < groups.size(); ++g) {
    const auto tets = groups.tets_of(g);
    std::set<int> reached = {tets[0]};
    for (std::size_t round = 0; round < tets.size(); ++round) {
      for (const int t : tets) {
        for (const int from : std::set<int>(reached)) {
          if (share_a_face(from, t)) reached.insert(t);
        }
      }
    }
    EXPECT_EQ(reached.size(), tets.size()) << g;
  }
}

TEST(TetGroups, NeverMixLabelsNorTakeTetsThatAreLeftOut) {
  Model model = box_of(soft_tissue);
  model.materials.push_back(model.materials.front());
  std::vector<char> with(model.tet_count());
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Vec3<double>& first = model.rest[model.tets[t][0]];
    model.material_of[t] = first.x > 0.0;
    with[t] = first.y < 0.01;
  }
  const TetGroups groups(model, with);
  std::size_t taken = 0;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    for (const int t : groups.tets_of(g)) {
      EXPECT_TRUE(with[t]);
      EXPECT_EQ(model.material_of[t], model.material_of[groups.tets_of(g)[0]]);
      ++taken;
    }
  }
  EXPECT_EQ(taken, static_cast<std::size_t>(std::ranges::count(with, 1)));
}

// A bar of 10 x 3 x 3 cm that hangs from one end, by 540 tets, off quadratic tets.
double percent_off_quadratic_tets(double poisson_ratio, Element element,
                                  const Scene& tissue = elastic_scene()) {
  Material material = bar_material;
  material.poisson_ratio = poisson_ratio;
  Model model = make_box({0.1, 0.03, 0.03}, {10, 3, 3}, material);
  for (std::size_t v = 0; v < model.vertex_count(); ++v) {
    model.fixed[v] = model.rest[v].x < -0.05 + 1e-9;
  }
  const auto rest = [&](Element kind) {
    Scene scene = tissue;
    scene.params<Gravity>().emplace_back();
    set_element(scene.effects, kind, poisson_ratio);
    return equilibrium(model, scene, kind == Element::quadratic ? 2 : 1).u;
  };
  const auto truth = rest(Element::quadratic);
  const std::vector<Vec3<double>> none(truth.size());
  return 100.0 * off(model, rest(element), truth) / off(model, none, truth);
}

TEST(GroupedVolume, KeepsABarFromLocking) {
  for (const double nu : {0.49, 0.499}) {
    EXPECT_LT(percent_off_quadratic_tets(nu, Element::smoothed), 4.0) << nu;
  }
  EXPECT_GT(percent_off_quadratic_tets(0.49, Element::linear), 60.0);
}

TEST(GroupedVolume, KeepsBarsOfOtherLawsFromLocking) {
  Scene mooney, ogden;
  mooney.params<MooneyRivlin>().push_back({0.4});
  ogden.params<Ogden>() = {{-4.7, 0.6}, {5.0, 0.4}};
  for (const Scene& tissue : {mooney, ogden}) {
    for (const double nu : {0.49, 0.499}) {
      EXPECT_LT(percent_off_quadratic_tets(nu, Element::smoothed, tissue), 4.0) << nu;
    }
    EXPECT_GT(percent_off_quadratic_tets(0.49, Element::linear, tissue), 60.0);
  }
}

// m, of the mean displacement of a cube of 384 tets that hangs from its top.
double sag_of_a_hanging_cube(double poisson_ratio) {
  Material material = soft_tissue;
  material.poisson_ratio = poisson_ratio;
  Model model = make_cube(4, material, 0.1);
  for (std::size_t v = 0; v < model.vertex_count(); ++v)
    model.fixed[v] = model.rest[v].z > 0.05 - 1e-9;
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  set_element(scene.effects, Element::smoothed, poisson_ratio);
  double sum = 0.0;
  for (const auto& u : equilibrium(model, scene, 1).u) sum -= u.z;
  return sum / static_cast<double>(model.vertex_count());
}

// Nor anywhere up to where groups have nearly all of it: a study over nu meets no step.
TEST(GroupedVolume, ABodyDoesNotJumpWhereGroupsBegin) {
  const double below = sag_of_a_hanging_cube(0.4499), above = sag_of_a_hanging_cube(0.4501);
  EXPECT_NEAR(above, below, 2e-3 * below);
  double before = below;
  for (const double nu : {0.454, 0.458, 0.462, 0.466, 0.47, 0.474, 0.478, 0.482, 0.486, 0.49}) {
    const double now = sag_of_a_hanging_cube(nu);
    EXPECT_NEAR(now, before, 0.03 * before) << nu;
    before = now;
  }
}

// Beside tissue with groups, tissue that needs none keeps its lambda.
TEST(GroupedVolume, TakesNothingFromTissueThatHardlyLocks) {
  for (const double nu : {0.3, 0.45}) {
    const Lame constants = lame({5e3, nu, 1060.0, 0.0});
    EXPECT_LE(GroupedVolume::of_groups(constants), 1.001e-3 * constants.mu) << nu;
  }
  const Lame incompressible = lame({5e3, 0.499, 1060.0, 0.0});
  EXPECT_NEAR(GroupedVolume::of_edges(incompressible).lambda, 1.5 * incompressible.mu,
              1e-9 * incompressible.mu);
}

}  // namespace
}  // namespace viscera::sim
