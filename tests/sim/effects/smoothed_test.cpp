// Smoothed elements, alone and beside groups of tets for the volume: what their domains are, that
// they carry every uniform strain and no other strain without energy, and that they bend where
// linear tets do not.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <map>
#include <set>

#include "sim/element_choice.hpp"
#include "sim/measures/forces.hpp"
#include "sim/measures/stability.hpp"
#include "sim/model/edge_domains.hpp"
#include "sim/scene/elasticity.hpp"
#include "tests/verification/fem_setup.hpp"

namespace viscera::sim {
namespace {

// A body of one law on linear tets.
enum class Law { neo_hookean, mooney_rivlin, ogden, linear, stvk };
constexpr Law laws[] = {Law::neo_hookean, Law::mooney_rivlin, Law::ogden, Law::linear, Law::stvk};

Scene scene_of(Law law) {
  if (law == Law::neo_hookean) return elastic_scene();
  Scene scene;
  if (law == Law::mooney_rivlin) scene.params<MooneyRivlin>().push_back({0.4});
  if (law == Law::ogden) scene.params<Ogden>() = {{-4.7, 0.6}, {5.0, 0.4}};
  if (law == Law::linear) scene.params<Linear>().emplace_back();
  if (law == Law::stvk) scene.params<StVK>().emplace_back();
  return scene;
}

Scene on_smoothed_elements(Scene scene, bool with_groups) {
  set_element(scene.effects, Element::smoothed, with_groups ? 0.49 : 0.45);
  return scene;
}

class SmoothedElements : public testing::TestWithParam<std::tuple<Law, bool>> {
 protected:
  Scene linear_ = scene_of(std::get<0>(GetParam()));
  Scene scene_ = on_smoothed_elements(linear_, std::get<1>(GetParam()));
};
std::string name_of(Law law) {
  constexpr const char* names[] = {"NeoHookean", "MooneyRivlin", "Ogden", "Linear", "StVK"};
  return names[static_cast<int>(law)];
}
std::string name_of_body(const testing::TestParamInfo<std::tuple<Law, bool>>& now) {
  const auto& [law, with_groups] = now.param;
  return name_of(law) + (with_groups ? "BesideGroups" : "Alone");
}
INSTANTIATE_TEST_SUITE_P(Each, SmoothedElements,
                         testing::Combine(testing::ValuesIn(laws), testing::Bool()), name_of_body);

class SmoothedLaws : public testing::TestWithParam<Law> {};
INSTANTIATE_TEST_SUITE_P(Each, SmoothedLaws, testing::ValuesIn(laws),
                         [](const auto& now) { return name_of(now.param); });

// A ring of tets around one edge of 0.1 m, with every label of `labels` in turn.
Model make_ring(const std::vector<int>& labels) {
  const int count = static_cast<int>(labels.size());
  std::vector<Vec3<double>> points = {{0, 0, -0.05}, {0, 0, 0.05}};
  std::vector<Tet> tets;
  for (int k = 0; k < count; ++k) {
    const double angle = 2.0 * M_PI * k / count;
    points.push_back({0.05 * std::cos(angle), 0.05 * std::sin(angle), 0.0});
    tets.push_back({0, 2 + k, 2 + (k + 1) % count, 1});
  }
  std::map<int, Material> materials;
  for (const int label : labels) materials[label] = bar_material;
  return make_model(points, tets, labels, materials);
}

// The tets of each domain around the ring's axis.
std::vector<std::vector<int>> domains_on_the_axis(const Model& ring) {
  const EdgeDomains domains(ring, {});
  std::vector<std::vector<int>> found;
  for (std::size_t e = 0; e < domains.size(); ++e) {
    const auto tets = domains.tets_of(e);
    if (tets.size() > 2) found.emplace_back(tets.begin(), tets.end());
  }
  return found;
}

TEST(EdgeDomains, AreTheWholeBodyOnce) {
  const Model model = make_five_tet_box({0.05, 0.04, 0.03}, {3, 2, 2}, bar_material);
  const EdgeDomains domains(model, {});
  std::vector<double> shares(model.tet_count());
  for (std::size_t e = 0; e < domains.size(); ++e) {
    double sum = 0.0;
    for (const int t : domains.tets_of(e)) {
      sum += model.volume[t] / 6.0;
      shares[t] += 1.0;
    }
    EXPECT_DOUBLE_EQ(domains.volume[e], sum);
  }
  for (const double share : shares) EXPECT_EQ(share, 6.0);  // its six edges
}

TEST(EdgeDomains, HaveTheGradientsOfTheMeanShapeFunctions) {
  const Model model = make_cube(2, bar_material);
  const EdgeDomains domains(model, {});
  // u = A x has the gradient A in every domain.
  const Mat3<double> a{{{0.1, 0.2, -0.3}, {0.4, -0.5, 0.6}, {-0.7, 0.8, 0.9}}};
  for (std::size_t e = 0; e < domains.size(); ++e) {
    Mat3<double> h{};
    Vec3<double> sum;
    for (int i = 0; i < EdgeDomains::max_vertices; ++i) {
      const Vec3<double>& b = domains.gradient[e][i];
      const Vec3<double> u = a * model.rest[domains[e][i]];
      h.col[0] += b.x * u, h.col[1] += b.y * u, h.col[2] += b.z * u;
      sum += b;
    }
    for (int axis = 0; axis < 3; ++axis) EXPECT_LT(norm(h.col[axis] - a.col[axis]), 1e-12);
    EXPECT_LT(norm(sum), 1e-11 * norm(domains.gradient[e].back()));
  }
}

TEST(EdgeDomains, NameAVertexTwiceOnlyWithoutWeightAndBeforeItsOwnPlace) {
  const Model model = make_five_tet_box({0.05, 0.04, 0.03}, {3, 2, 2}, bar_material);
  const EdgeDomains domains(model, {});
  int filled = 0;
  for (std::size_t e = 0; e < domains.size(); ++e) {
    for (int i = 0; i < EdgeDomains::max_vertices; ++i) {
      const bool again =
          std::count(domains[e].begin() + i + 1, domains[e].end(), domains[e][i]) > 0;
      filled += again;
      EXPECT_EQ(again, norm(domains.gradient[e][i]) == 0.0) << e << ", " << i;
    }
  }
  EXPECT_GT(filled, 0);
}

TEST(EdgeDomains, NeverMixLabels) {
  EXPECT_EQ(domains_on_the_axis(make_ring({1, 1, 1, 1, 1, 1, 1})).size(), 1u);
  const auto found = domains_on_the_axis(make_ring({1, 1, 1, 2, 2, 2}));
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(std::set<int>(found[0].begin(), found[0].end()), (std::set<int>{0, 1, 2}));
  EXPECT_EQ(std::set<int>(found[1].begin(), found[1].end()), (std::set<int>{3, 4, 5}));
}

TEST(EdgeDomains, OfManyTetsAreSharedOutAmongNeighbours) {
  for (const int count : {8, 9, 12, 20, 25}) {
    const auto found = domains_on_the_axis(make_ring(std::vector<int>(count, 1)));
    EXPECT_EQ(found.size(), static_cast<std::size_t>((count + 5) / 6)) << count;
    std::size_t sum = 0;
    for (const auto& tets : found) {
      sum += tets.size();
      EXPECT_LE(tets.size(), 6u);
      for (std::size_t k = 1; k < tets.size(); ++k) {
        const int way = std::abs(tets[k] - tets[k - 1]);
        EXPECT_TRUE(way == 1 || way == count - 1) << "not neighbours: " << way;
      }
    }
    EXPECT_EQ(sum, static_cast<std::size_t>(count));
  }
}

// The patch test: under a strain that is the same everywhere no vertex within is pulled.
TEST_P(SmoothedElements, CarryEveryUniformStrain) {
  const Model model = make_cube(4, bar_material);
  const Mat3<double> a{{{0.1, 0.05, -0.03}, {0.04, -0.15, 0.02}, {-0.07, 0.08, 0.06}}};
  State state{{}, std::vector<Vec3<double>>(model.vertex_count()), 0};
  for (const auto& x : model.rest) state.u.push_back(a * x);
  const auto forces = element_forces(model, scene_, state);
  double largest = 0.0;
  for (const auto& force : forces) largest = std::max(largest, norm(force));
  int inner = 0;
  for (std::size_t v = 0; v < model.vertex_count(); ++v) {
    const auto& x = model.rest[v];
    if (std::max({std::abs(x.x), std::abs(x.y), std::abs(x.z)}) > 0.02) continue;
    ++inner;
    EXPECT_LT(norm(forces[v]), 1e-12 * largest) << v;
  }
  EXPECT_EQ(inner, 27);
  // And stores what the law says of that strain.
  const double volume = std::accumulate(model.volume.begin(), model.volume.end(), 0.0);
  const double expected = volume * elastic_energy_of_tet(model, linear_, 0, a) / model.volume[0];
  EXPECT_NEAR(smoothed_energy(model, scene_, state.u), expected, 1e-12 * expected);
}

TEST_P(SmoothedElements, HaveForcesThatAreTheSlopesOfTheBodysEnergy) {
  const Model model = make_five_tet_box({0.05, 0.05, 0.05}, {2, 2, 2}, bar_material);
  const Scene& scene = scene_;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(-1e-3, 1e-3);
  State state{{}, std::vector<Vec3<double>>(model.vertex_count()), 0};
  for (std::size_t v = 0; v < model.vertex_count(); ++v) {
    state.u.push_back({any(random), any(random), any(random)});
  }
  const auto forces = element_forces(model, scene, state);
  double largest = 0.0;
  for (const auto& force : forces) largest = std::max(largest, norm(force));
  for (std::size_t v = 0; v < model.vertex_count(); v += 3) {
    constexpr double step = 1e-8;
    auto ahead = state.u, behind = state.u;
    ahead[v].y += step, behind[v].y -= step;
    const double slope =
        (smoothed_energy(model, scene, ahead) - smoothed_energy(model, scene, behind)) /
        (2.0 * step);
    EXPECT_NEAR(forces[v].y, -slope, 1e-6 * largest);
  }
}

// The eigenvalues of a free body's stiffness: six motions without strain, and no other.
TEST_P(SmoothedElements, HaveNoModeWithoutEnergyButRigidMotions) {
  const Model model = make_five_tet_box({0.05, 0.05, 0.05}, {2, 2, 2}, bar_material);
  const int size = 3 * static_cast<int>(model.vertex_count());
  Eigen::MatrixXd stiffness(size, size);
  const auto forces_at = [&](int k, double step) {
    State state{std::vector<Vec3<double>>(model.vertex_count()),
                std::vector<Vec3<double>>(model.vertex_count()), 0};
    auto& own = state.u[k / 3];
    (k % 3 == 0 ? own.x : k % 3 == 1 ? own.y : own.z) = step;
    return element_forces(model, scene_, state);
  };
  constexpr double step = 1e-7;
  for (int k = 0; k < size; ++k) {
    const auto ahead = forces_at(k, step), behind = forces_at(k, -step);
    for (std::size_t v = 0; v < model.vertex_count(); ++v) {
      const Vec3<double> column = (0.5 / step) * (behind[v] - ahead[v]);
      stiffness.block<3, 1>(3 * static_cast<int>(v), k) << column.x, column.y, column.z;
    }
  }
  const Eigen::MatrixXd symmetric = 0.5 * (stiffness + stiffness.transpose());
  const Eigen::VectorXd values =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(symmetric).eigenvalues();
  EXPECT_LT(std::abs(values[5]), 1e-6 * values[size - 1]);
  EXPECT_LT(std::abs(values[0]), 1e-6 * values[size - 1]);
  EXPECT_GT(values[6], 1e-3 * values[size - 1]);
}

// A bar of 10 x 3 x 3 cm that is held at its left end and sags.
struct SaggingBar {
  Model model = make_box({0.1, 0.03, 0.03}, {10, 3, 3}, bar_material);
  Scene scene;

  explicit SaggingBar(bool smoothed, Law law = Law::neo_hookean)
      : scene(smoothed ? on_smoothed_elements(scene_of(law), false) : scene_of(law)) {
    scene.params<Gravity>().emplace_back();
    scene.params<Viscosity>().emplace_back();
    for (std::size_t v = 0; v < model.vertex_count(); ++v) {
      model.fixed[v] = model.rest[v].x < -0.05 + 1e-9;
    }
    for (auto& material : model.materials) material.damping = 0.05;
  }
  State run(const SolverOptions& options, int frames, const State* from = nullptr) {
    Scene own = scene;
    apply_policy(model, own, options);
    const auto solver = make_on_cpu(model, own, options);
    if (from) solver->set_state(*from);
    for (int frame = 0; frame < frames; ++frame) solver->advance_frame();
    return solver->state();
  }
  double sag_of(const State& state) const {
    double sum = 0.0;
    int count = 0;
    for (std::size_t v = 0; v < model.vertex_count(); ++v) {
      if (model.rest[v].x > 0.05 - 1e-9) sum -= state.u[v].z, ++count;
    }
    return sum / count;
  }
  double sag(const SolverOptions& options, int frames) { return sag_of(run(options, frames)); }
};

constexpr double tolerance = 1e-8;  // of Newton's method

TEST_P(SmoothedLaws, BendWhereLinearTetsDoNot) {
  const Law law = GetParam();
  const double exact = SaggingBar(false, law).sag(statics(tolerance, 2), 1);
  const double linear = SaggingBar(false, law).sag(statics(tolerance), 1);
  const double smoothed = SaggingBar(true, law).sag(statics(tolerance), 1);
  // Of 540 tets: 23 % and 9.5 % too stiff, and 11 % of smoothed elements where the law is linear
  // in Green's strain or the small one.
  const double least = law == Law::linear || law == Law::stvk ? 0.88 : 0.9;
  EXPECT_LT(linear, 0.8 * exact);
  EXPECT_GT(smoothed, least * exact);
  EXPECT_LT(smoothed, exact);
}

TEST_P(SmoothedLaws, ComeToRestWhereNewtonDoesUnderEverySolver) {
  const Law law = GetParam();
  const State rest = SaggingBar(true, law).run(statics(tolerance), 1);
  const double newton = SaggingBar(true, law).sag_of(rest);
  for (const Scheme scheme : {Scheme::gauss_seidel, Scheme::block_gauss_seidel}) {
    for (const Precision precision : {Precision::fp32, Precision::fp64}) {
      const SolverOptions options{.scheme = scheme, .precision = precision, .block_tets = 200};
      // In blocks the linear law rests 1.05 % too low, the others up to .9 %.
      const double off = law == Law::linear ? 0.012 : 0.01;
      EXPECT_NEAR(SaggingBar(true, law).sag(options, 60), newton, off * newton)
          << static_cast<int>(scheme) << ", " << static_cast<int>(precision);
    }
  }
  // Explicit dynamics stays there.
  const SolverOptions tled{.method = Method::tled, .precision = Precision::fp64};
  EXPECT_NEAR(SaggingBar(true, law).sag_of(SaggingBar(true, law).run(tled, 10, &rest)), newton,
              1e-6 * newton);
}

// mu, lambda and so the sag do not depend on the law where strains are small, nor on how many terms
// Ogden's law has.
TEST(SmoothedLawsTogether, AreOneAnotherWhereTheyAreNeoHookean) {
  const State rest = SaggingBar(true).run(statics(tolerance), 1);
  Scene mooney, ogden;
  mooney.params<MooneyRivlin>().push_back({0.0});
  ogden.params<Ogden>() = {{2.0, 0.3}, {2.0, 0.7}};
  for (const Scene& law : {mooney, ogden}) {
    SaggingBar bar(true);
    bar.scene = on_smoothed_elements(law, false);
    bar.scene.params<Gravity>().emplace_back();
    const State other = bar.run(statics(tolerance), 1);
    for (std::size_t v = 0; v < bar.model.vertex_count(); ++v) {
      EXPECT_LT(norm(other.u[v] - rest.u[v]), 1e-6) << v;
    }
  }
}

}  // namespace
}  // namespace viscera::sim
