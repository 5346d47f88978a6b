// The bound on compression: single tets pushed through every way to turn inside out, and bodies
// that a load holds there without it.
#include "sim/solvers/xpbd/volume_bound.hpp"

#include <gtest/gtest.h>

#include "sim/backend/cpu/volume_bound.hpp"
#include "tests/sim/loaded_bodies.hpp"

namespace viscera::sim {
namespace {

constexpr double least = VolumeBound::least - VolumeBound::tolerance;

// A unit tet whose corners lie at `to`; masses differ by up to ten.
MovingTet<double> led_to(const std::array<Vec3<double>, 4>& to, std::mt19937& generator) {
  const std::array<Vec3<double>, 4> at{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  MovingTet<double> tet{.rest_inverse = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}};
  for (int i = 0; i < 4; ++i) {
    tet.d[i] = to[i] - at[i];
    tet.w[i] = random_in(generator, 0.1, 1.0);
  }
  return tet;
}

Vec3<double> momentum_of(const MovingTet<double>& tet) {
  Vec3<double> sum;
  for (int i = 0; i < 4; ++i) sum += (1.0 / tet.w[i]) * tet.d[i];
  return sum;
}

double energy_of(const MovingTet<double>& tet) {
  double sum = 0.0;
  for (int i = 0; i < 4; ++i) sum += dot(tet.d[i], tet.d[i]) / tet.w[i];
  return sum;
}

TEST(VolumeBound, AMillionRandomDeformationsOfATetEndOpenOrWhereTheyBegan) {
  std::mt19937 generator(1);
  for (int n = 0; n < 1000000; ++n) {
    std::array<Vec3<double>, 4> to;
    for (auto& x : to) x = random_vector(generator, 1.5);
    MovingTet<double> tet = led_to(to, generator);
    const Vec3<double> before = momentum_of(tet);
    const double j = 1.0 + tet.strain_after();
    int pushes = 0;
    while (pushes < VolumeBound::pushes && tet.push()) ++pushes;
    if (j >= least) {
      ASSERT_EQ(pushes, 0);
    }
    const double energy = energy_of(tet);
    if (tet.halt()) {
      ASSERT_LE(energy_of(tet), energy * (1.0 + 1e-12));
      ASSERT_NEAR(tet.strain_after(), 0.0, 1e-9) << "all corners moved alike";
    }
    ASSERT_GE(1.0 + tet.strain_after(), VolumeBound::halted - 1e-9) << "from J " << j;
    ASSERT_LE(norm(momentum_of(tet) - before), 1e-9);
  }
}

// A vertex led through its opposite face, an edge through its opposite edge, a face through its
// opposite vertex: each way for a tet to turn inside out.
TEST(VolumeBound, NoVertexEdgeOrFacePassesThroughWhatIsOpposite) {
  std::mt19937 generator(2);
  const std::array<Vec3<double>, 4> at{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  for (unsigned moved = 1; moved < 15; ++moved) {
    Vec3<double> own, others;
    int count = 0;
    for (int i = 0; i < 4; ++i) {
      (moved >> i & 1u ? own : others) += at[i];
      count += static_cast<int>(moved >> i & 1u);
    }
    const Vec3<double> way = (1.0 / (4 - count)) * others - (1.0 / count) * own;
    for (const double share : {0.75, 0.9, 1.0, 1.1, 1.5, 2.0}) {
      auto to = at;
      for (int i = 0; i < 4; ++i) {
        if (moved >> i & 1u) to[i] += share * way;
      }
      MovingTet<double> tet = led_to(to, generator);
      for (int n = 0; n < VolumeBound::pushes && tet.push();) ++n;
      tet.halt();
      EXPECT_GE(1.0 + tet.strain_after(), VolumeBound::halted - 1e-9) << moved << ", " << share;
    }
  }
}

TEST(VolumeBound, ATetThatBeginsInsideOutIsNotThrownOpen) {
  std::mt19937 generator(3);
  MovingTet<double> tet = led_to({{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, generator);
  tet.u[3] = {0, 0, -2};  // J = -1
  EXPECT_FALSE(tet.halt()) << "it does not close further";
  for (int n = 0; n < VolumeBound::pushes && tet.push();) ++n;
  EXPECT_GT(1.0 + tet.strain_after(), -1.0);
  EXPECT_LE(1.0 + tet.strain_after(), -1.0 + VolumeBound::opening + 1e-9);
}

const SolverOptions pressed_by[] = {{.threads = 2},
                                    {.scheme = Scheme::block_gauss_seidel, .block_tets = 200},
                                    {.precision = Precision::fp64}};
// All vertices of a body thrown about in one substep: most tets end inside out, and what opens one
// presses another. Repeated averages leave many of them.
TEST(VolumeBound, NoTetOfABodyFallsWhateverASubstepDoesToIt) {
  const Model model = make_cube(4);
  std::mt19937 generator(5);
  for (const double far : {0.1, 0.5, 2.0}) {  // over a cell's size
    const BoundedTets<double> tets(model, elastic_scene(), Method::xpbd);
    std::vector<Row<double>> u(model.vertex_count()), d(model.vertex_count());
    Vec3<double> momentum, after;
    for (std::size_t v = 0; v < d.size(); ++v) {
      u[v].v = random_vector(generator, 0.02 * model.size() / 4.0);
      d[v] = {random_vector(generator, far * model.size() / 4.0), 1.0 / model.mass[v]};
      momentum += model.mass[v] * d[v].v;
    }
    Team team(1);
    CpuVolumeBound<double> bound(tets, 1, static_cast<int>(model.vertex_count()));
    bound.apply(team, 0, true, u, d);
    for (std::size_t t = 0; t < model.tet_count(); ++t) {
      MovingTet<double> tet{.rest_inverse = model.rest_inverse[t]};
      for (int i = 0; i < 4; ++i) {
        tet.u[i] = u[model.tets[t][i]].v;
        tet.d[i] = d[model.tets[t][i]].v;
      }
      EXPECT_FALSE(tet.falls()) << "from J " << 1.0 + tet.strain_before() << " to "
                                << 1.0 + tet.strain_after();
    }
    for (std::size_t v = 0; v < d.size(); ++v) after += model.mass[v] * d[v].v;
    EXPECT_LE(norm(after - momentum), 1e-12 * far);
  }
}

// The bound at the end of a frame, as it is written down: all tets one after the other.
class InOrder {
 public:
  InOrder(const Model& model, const std::vector<Row<double>>& u, std::vector<Row<double>>& d)
      : model_(model), u_(u), d_(d), moved_(d.size()), group_of_(d.size(), -1), members_(d.size()) {
    for (std::size_t t = 0; t < model.tet_count(); ++t) {
      watched_.push_back(tet_at(t).strain_after() < VolumeBound::watched - 1.0);
    }
  }
  void correct() {
    repeat(VolumeBound::pushes, [](auto& tet) { return tet.push(); });
    repeat(VolumeBound::halts, [](auto& tet) { return tet.halt(); });
    JoinedVertices<double> joined{group_of_.data(), members_.data()};
    for (bool any = true; any;) {
      any = false;
      const auto falling = tets_of([&](std::size_t t) {
        const bool is_looked_at =
            watched_[t] || std::ranges::any_of(model_.tets[t], [&](int v) { return moved_[v]; });
        return is_looked_at && tet_at(t).falls();
      });
      for (const std::size_t t : falling) any = joined.join(model_.tets[t]) || any;
      joined.lead([&](int v) { return d_[v]; },
                  [&](int v, const Vec3<double>& to) { move(v, to); });
    }
  }

 private:
  MovingTet<double> tet_at(std::size_t t) const {
    MovingTet<double> tet{.rest_inverse = model_.rest_inverse[t]};
    for (int i = 0; i < 4; ++i) {
      const int v = model_.tets[t][i];
      tet.u[i] = u_[v].v, tet.d[i] = d_[v].v, tet.w[i] = d_[v].w;
    }
    return tet;
  }
  template <class Condition>
  std::vector<std::size_t> tets_of(Condition&& condition) const {
    std::vector<std::size_t> found;
    for (std::size_t t = 0; t < model_.tet_count(); ++t) {
      if (condition(t)) found.push_back(t);
    }
    return found;
  }
  void move(int v, const Vec3<double>& to) { moved_[v] = 1, d_[v].v = to; }
  template <class Correct>
  void repeat(int at_most, Correct&& correct) {
    for (int pass = 0; pass < at_most; ++pass) {
      const auto wrong = tets_of([&](std::size_t t) {
        MovingTet<double> tet = tet_at(t);
        return watched_[t] && correct(tet);
      });
      for (const std::size_t t : wrong) {
        MovingTet<double> tet = tet_at(t);
        if (!correct(tet)) continue;
        for (int i = 0; i < 4; ++i) move(model_.tets[t][i], tet.d[i]);
      }
    }
  }

  const Model& model_;
  const std::vector<Row<double>>& u_;
  std::vector<Row<double>>& d_;
  std::vector<char> moved_, watched_;
  std::vector<int> group_of_, members_;
};

// That includes tets that were not watched, whose neighbours have been moved.
TEST(VolumeBound, TetsAreCorrectedAndJoinedInTheirOrderToTheBit) {
  const Model model = make_cube(4);
  std::mt19937 generator(6);
  for (const double far : {0.2, 0.5, 1.0}) {  // over a cell's size
    std::vector<Row<double>> u(model.vertex_count()), d(model.vertex_count());
    for (std::size_t v = 0; v < d.size(); ++v) {
      d[v] = {random_vector(generator, far * model.size() / 4.0), 1.0 / model.mass[v]};
    }
    auto in_order = d;
    InOrder(model, u, in_order).correct();
    const BoundedTets<double> tets(model, elastic_scene(), Method::xpbd);
    Team team(1);
    CpuVolumeBound<double> bound(tets, 1, static_cast<int>(model.vertex_count()));
    bound.apply(team, 0, true, u, d);
    for (std::size_t v = 0; v < d.size(); ++v) EXPECT_EQ(d[v].v, in_order[v].v) << v;
  }
}

// Two tets that share a vertex and one apart from them, of which one vertex is held.
TEST(JoinedVertices, AreLedByTheMeanOfTheirGroupOnceEach) {
  constexpr int count = 11;
  std::vector<int> group_of(count, -1), members(count), led(count);
  std::vector<Row<double>> d(count);
  for (int v = 0; v < count; ++v) d[v] = {{1.0 * v, 0.0, 1.0}, 1.0 / (1.0 + v)};
  d[9].w = 0.0;
  JoinedVertices<double> joined{group_of.data(), members.data()};
  for (const Tet& tet : {Tet{0, 1, 2, 3}, Tet{7, 8, 9, 10}, Tet{4, 5, 6, 0}}) {
    EXPECT_TRUE(joined.join(tet));
    EXPECT_FALSE(joined.join(tet));
  }
  EXPECT_EQ(joined.count, count);
  joined.lead([&](int v) { return d[v]; },
              [&](int v, const Vec3<double>& to) { ++led[v], d[v].v = to; });
  double mass = 0.0, moment = 0.0;
  for (int v = 0; v < 7; ++v) mass += 1.0 + v, moment += (1.0 + v) * v;
  for (int v = 0; v < count; ++v) {
    EXPECT_EQ(led[v], v == 9 ? 0 : 1) << v;
    EXPECT_NEAR(d[v].v.x, v < 7 ? moment / mass : 9.0, 1e-14) << v;
  }
  joined.part();
  EXPECT_EQ(group_of, std::vector<int>(count, -1));
}

class PressedBody : public testing::TestWithParam<int> {};

TEST_P(PressedBody, HasNoTetInsideOutAtTheEndOfAnyFrame) {
  expect_no_tet_inside_out_when_pressed([](const Model& model, const Scene& scene) {
    return make_on_cpu(model, scene, pressed_by[GetParam()]);
  });
}

INSTANTIATE_TEST_SUITE_P(Each, PressedBody, testing::Range(0, 3));

Scene smoothed(Scene scene) {
  scene.params<NeoHookean>().clear();
  scene.params<SmoothedNeoHookean>().emplace_back();
  return scene;
}

TEST(VolumeBound, DoesNotBeginWhereAnyTetIsInsideOut) {
  const Model model = make_cube(2);
  const BoundedTets<double> tets(model, drop_scene(), Method::xpbd);
  ASSERT_EQ(tets.vertices.size(), model.tet_count());
  const std::vector<Vec3<double>> none(model.vertex_count());
  State state{none, none};
  EXPECT_TRUE(tets.begins_at(state));
  const BoundedTets<double> first = [&] {
    BoundedTets<double> one = tets;
    one.vertices.resize(1), one.rest_inverse.resize(1);
    return one;
  }();
  state.u[model.tets[0][0]] = 3.0 * (model.rest[model.tets[0][1]] - model.rest[model.tets[0][0]]) +
                              3.0 * (model.rest[model.tets[0][2]] - model.rest[model.tets[0][0]]) +
                              3.0 * (model.rest[model.tets[0][3]] - model.rest[model.tets[0][0]]);
  EXPECT_FALSE(first.begins_at(state));
  EXPECT_FALSE(tets.begins_at(state));
}

TEST(VolumeBound, ABodyWithoutAnElasticLawHasNone) {
  EXPECT_FALSE(VolumeBound::is_needed(particle_scene()));
  EXPECT_TRUE(VolumeBound::is_needed(elastic_scene()));
  EXPECT_TRUE(VolumeBound::is_needed(smoothed(elastic_scene())));
}

TEST(VolumeBound, GoesOnWhereFewTetsAreCrushedAndOnceOffComesBackOnlyWhereNoneIs) {
  EXPECT_TRUE(VolumeBound::goes_on(true, 50, 1000));
  EXPECT_FALSE(VolumeBound::goes_on(true, 51, 1000));
  EXPECT_TRUE(VolumeBound::goes_on(false, 0, 1000));
  EXPECT_FALSE(VolumeBound::goes_on(false, 1, 1000));
}

TEST(Viscosity, DoesNotMoveThePlaceOfRest) {
  const HeldBar bar{.cells = {4, 2, 2}, .substeps = 16, .swinging = 100, .frames = 260};
  for (SolverOptions options :
       {SolverOptions{}, SolverOptions{.scheme = Scheme::block_gauss_seidel, .block_tets = 100},
        SolverOptions{.scheme = Scheme::jacobi, .split = 4.0},
        SolverOptions{.method = Method::tled}}) {
    options.precision = Precision::fp64;
    expect_same_rest_at_any_damping(bar, [&](const Model& model, const Scene& scene) {
      return make_on_cpu(model, scene, options);
    });
  }
}

}  // namespace
}  // namespace viscera::sim
