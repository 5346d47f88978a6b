// Self-contact: flaps that fold onto one another, pieces shot at one another, friction between
// them; nothing where it is off.
#include <gtest/gtest.h>

#include <numeric>
#include <optional>

#include "sim/backend/self_contact_step.hpp"
#include "sim/model/surface_pairs.hpp"
#include "tests/sim/effects/flap.hpp"

namespace viscera::sim {
namespace {

constexpr double thickness = flap_thickness;

// How far the flap's underside has come below the top of what it folds onto, m; negative: above.
double overlap(const Model& model, const State& state) {
  double deepest = -1.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const Vec3<double> x = place(model, i);
    if (x.x > 0.0151 && x.z > 0.0081) deepest = std::max(deepest, 0.008 - (x.z + state.u[i].z));
  }
  return deepest;
}

TEST(SelfContact, AFlapThatFoldsDownComesToRestOnWhatIsBelow) {
  const Model model = make_flap();
  double worst[2] = {-1.0, -1.0};
  for (const bool on : {false, true}) {
    for (const Precision precision : {Precision::fp64, Precision::fp32}) {
      const auto solver = make_on_cpu(model, folding_scene(on), {.precision = precision});
      for (int frame = 0; frame < 60; ++frame) {
        solver->advance_frame();
        const State state = solver->state();
        ASSERT_TRUE(state.finite());
        worst[on] = std::max(worst[on], overlap(model, state));
      }
      if (!on) break;
      EXPECT_GT(solver->contact_count(), 10u);
      EXPECT_EQ(diagnose(model, folding_scene(on), solver->state()).inverted, 0u);
      EXPECT_LT(diagnose(model, folding_scene(on), solver->state()).max_speed, 0.02);
    }
  }
  EXPECT_GT(worst[false], 2e-3) << "the flap must need the contact";
  EXPECT_LT(worst[true], -0.5 * thickness + 1e-9);
}

TEST(SelfContact, TheNumberOfThreadsAndARestartDoNotChangeABit) {
  const Model model = make_flap();
  const Scene scene = folding_scene(true);
  std::uint64_t hash[4];
  for (int run = 0; run < 4; ++run) {
    const SolverOptions options = {.precision = Precision::fp32, .threads = 1 + run % 3};
    auto solver = make_on_cpu(model, scene, options);
    for (int frame = 0; frame < 12; ++frame) {
      if (run == 3 && frame == 9) {
        const State so_far = solver->state();
        solver = make_on_cpu(model, scene, options);
        solver->set_state(so_far);
      }
      solver->advance_frame();
    }
    EXPECT_GT(solver->contact_count(), 0u);
    hash[run] = solver->state().hash();
  }
  for (int run = 1; run < 4; ++run) EXPECT_EQ(hash[0], hash[run]);
}

TEST(SelfContact, WithoutAContactItIsTheRunWithoutItToTheBit) {
  const Model model = make_flap();
  Scene plain = folding_scene(false), named = folding_scene(true);
  std::uint64_t hash[2];
  for (const Scene* scene : {&plain, &named}) {
    const auto solver = make_on_cpu(model, *scene, {.precision = Precision::fp32});
    for (int frame = 0; frame < 1; ++frame) solver->advance_frame();
    EXPECT_EQ(solver->contact_count(), 0u);
    hash[scene == &plain] = solver->state().hash();
  }
  EXPECT_EQ(hash[0], hash[1]);
}

// Two cubes, one beside the other along x with a gap of 10 mm.
Model make_two_cubes() {
  const Model left = make_box({0.02, 0.02, 0.02}, {4, 4, 4}, soft_tissue);
  const Model right = make_box({0.02, 0.02, 0.02}, {3, 3, 3}, soft_tissue, {0.03, 0.0005, -0.0007});
  return assembled({left, right}, soft_tissue, [](const Vec3<double>&) { return true; });
}

TEST(SelfContact, PiecesShotAtOneAnotherDoNotPassAndKeepTheirMomentum) {
  const Model model = make_two_cubes();
  constexpr double speed = 1.0;
  for (const int substeps : {16, 64}) {  // 2 and .5 mm of approach a substep
    Scene scene = elastic_scene();
    scene.time.substeps = substeps;
    scene.params<SelfContact>().push_back({.thickness = 0.2e-3});
    const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
    State start{std::vector<Vec3<double>>(model.vertex_count()),
                std::vector<Vec3<double>>(model.vertex_count())};
    const auto is_left = [&](std::size_t i) { return place(model, i).x < 0.025; };
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      start.v[i].x = is_left(i) ? speed : -speed;
    }
    solver->set_state(start);
    double energy = diagnose(model, scene, start).kinetic;
    for (int frame = 0; frame < 12; ++frame) {
      solver->advance_frame();
      const State state = solver->state();
      ASSERT_TRUE(state.finite());
      Vec3<double> momentum[2], center[2];
      double mass[2] = {};
      for (std::size_t i = 0; i < model.vertex_count(); ++i) {
        const int side = !is_left(i);
        mass[side] += model.mass[i];
        momentum[side] += model.mass[i] * (state.v[i] - start.v[i]);
        center[side] += model.mass[i] * (place(model, i) + state.u[i]);
      }
      EXPECT_LT(norm(momentum[0] + momentum[1]), 1e-12 * mass[0] * speed);
      EXPECT_GT(center[1].x / mass[1] - center[0].x / mass[0], 0.005) << "frame " << frame;
      EXPECT_LE(diagnose(model, scene, state).total(), 1.001 * energy) << "frame " << frame;
    }
  }
}

TEST(SelfContact, FrictionBetweenPiecesSticksBelowItsAngle) {
  Material stiff = soft_tissue;
  stiff.youngs_modulus = 1e5;
  const Model base = make_box({0.09, 0.06, 0.01}, {6, 4, 1}, stiff);
  const Model block = make_box({0.03, 0.03, 0.01}, {3, 3, 1}, stiff, {0.0151, 0.0152, 0.0112});
  Model model = assembled({base, block}, stiff, [](const Vec3<double>&) { return true; });
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = place(model, i).z < 0.0105;
  }
  const auto speed_after = [&](double friction, double slope, double seconds) {
    Scene scene = folding_scene(true);
    scene.time.substeps = 64;
    scene.params<SelfContact>().front().friction = friction;
    scene.params<Gravity>().front().direction = {std::sin(slope), 0.0, -std::cos(slope)};
    const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
    for (int frame = 0; frame < std::lround(60.0 * seconds); ++frame) solver->advance_frame();
    double momentum = 0.0, mass = 0.0;
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      if (model.fixed[i]) continue;
      mass += model.mass[i];
      momentum += model.mass[i] * solver->state().v[i].x;
    }
    return momentum / mass;
  };
  constexpr double mu = 0.4, slope = 0.5;  // rad
  EXPECT_LT(std::abs(speed_after(mu, 0.9 * std::atan(mu), 0.2)), 2e-3);
  const double expected = 9.80665 * (std::sin(slope) - mu * std::cos(slope)) * 0.15;
  EXPECT_NEAR(speed_after(mu, slope, 0.15), expected, 0.1 * expected);
}

struct LooseBody {
  const Triangle* triangles;
  Neighbours neighbours;
  const std::vector<Vec3<double>>& rest;
  std::vector<Vec3<double>>& d;
  const std::vector<double>& w;

  Vec3<double> start(int v) const { return rest[v]; }
  Vec3<double> motion(int v) const { return d[v]; }
  double mobility(int v) const { return w[v]; }
  void move(int v, const Vec3<double>& by) const { d[v] += by; }
};

// A roof whose ridge lies along y at z = 0, with sides that fall by 60 degrees, and one vertex.
struct Roof {
  const std::vector<Triangle> triangles = {{0, 1, 2}, {1, 0, 3}};
  std::vector<Vec3<double>> at = {
      {0, 0.01, 0}, {0, 0, 0}, {0.01, 0, -0.0173}, {-0.01, 0, -0.0173}, {}};
  std::vector<Vec3<double>> d = std::vector<Vec3<double>>(5);
  const std::vector<double> w = std::vector<double>(5, 1.0);
  const std::vector<int> neighbours = {1, 2, 3, 0, 2, 3, 0, 1, 0, 1}, begin = {0, 3, 6, 8, 10, 10};

  // Where the vertex at x touches, with a thickness of 1 mm.
  std::optional<Over> touches(const Vec3<double>& x, int triangle) {
    at[4] = x;
    const LooseBody body{triangles.data(), {neighbours.data(), begin.data()}, at, d, w};
    Over contact;
    if (!touch(body, 4, triangle, 1e-3, 3e-3, contact)) return {};
    return contact;
  }
};

TEST(SelfContact, BesideARidgeAVertexStaysOffTheEdgeAndOverASideOffThatAlone) {
  Roof roof;
  for (const int triangle : {0, 1}) {
    const auto over = roof.touches({0.0002, 0.004, 0.0006}, triangle);
    ASSERT_TRUE(over);
    EXPECT_NEAR(over->height, std::hypot(0.0002, 0.0006), 1e-15);
    EXPECT_LT(norm(over->normal - (1.0 / over->height) * Vec3<double>{0.0002, 0.0, 0.0006}), 1e-12);
    for (int j = 0; j < 3; ++j) {
      const int v = roof.triangles[triangle][j];
      EXPECT_NEAR(over->b[j], v == 0 ? 0.4 : v == 1 ? 0.6 : 0.0, 1e-12);
    }
    EXPECT_FALSE(roof.touches({0.0, 0.004, 0.0011}, triangle)) << "farther than the thickness";
    EXPECT_FALSE(roof.touches({0.0, 0.004, -0.004}, triangle)) << "in the tissue";
  }
  const Vec3<double> over_the_first = {0.0017, 0.004, -0.0020};
  ASSERT_TRUE(roof.touches(over_the_first, 0));
  EXPECT_GT(roof.touches(over_the_first, 0)->b[2], 0.05);
  EXPECT_FALSE(roof.touches(over_the_first, 1));
}

Model one_tet(const std::vector<Vec3<double>>& corners) {
  const auto& [a, b, c, d] = std::tie(corners[0], corners[1], corners[2], corners[3]);
  const bool turned = dot(cross(b - a, c - a), d - a) < 0.0;
  const std::vector<Tet> tets = {turned ? Tet{0, 2, 1, 3} : Tet{0, 1, 2, 3}};
  return make_model(corners, tets, std::vector<int>{1}, {{1, soft_tissue}});
}

// A tet that stands on its tip falls on the ridge of a cube that is held.
TEST(SelfContact, ATipThatFallsOnARidgeStaysAboveIt) {
  Model base = make_box({0.02, 0.02, 0.02}, {2, 2, 2}, soft_tissue);
  const double root = std::sqrt(0.5);
  for (auto& x : base.rest) x = {root * (x.x + x.z), x.y, root * (x.z - x.x)};
  base.origin = {};
  const double ridge = 0.01 * std::sqrt(2.0);
  const std::vector<Vec3<double>> tip = {{0.0, 0.0013, ridge + 0.003},
                                         {0.005, -0.003, ridge + 0.013},
                                         {-0.005, -0.003, ridge + 0.013},
                                         {0.0, 0.006, ridge + 0.013}};
  const Model tet = one_tet(tip);
  Model model = assembled({base, tet}, soft_tissue, [](const Vec3<double>&) { return true; });
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = place(model, i).z < ridge + 0.001;
  }
  Scene scene = folding_scene(true);
  scene.params<SelfContact>().front().friction = 1.0;
  const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
  for (int frame = 0; frame < 6; ++frame) solver->advance_frame();
  EXPECT_GT(solver->contact_count(), 0u);
  double lowest = 1.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    if (!model.fixed[i]) lowest = std::min(lowest, (place(model, i) + solver->state().u[i]).z);
  }
  EXPECT_GT(lowest, ridge + 0.5 * thickness);
  EXPECT_LT(lowest, ridge + 1.2 * thickness);
}

// Between two plates that are held 1.5 h apart, the tip of a tet whose other corners are held
// outside: 1 h off both is nowhere.
TEST(SelfContact, InAGapNarrowerThanTwiceTheThicknessAVertexRestsInTheMiddle) {
  const double h = thickness, z = 0.01;  // the lower plate's top
  const Model lower = make_box({0.04, 0.04, 0.01}, {2, 2, 1}, soft_tissue);
  const Model upper = make_box({0.04, 0.04, 0.01}, {2, 2, 1}, soft_tissue, {0.0, 0.0, z + 4.0 * h});
  const std::vector<Vec3<double>> corners = {{0.033, 0.018, z + 2.0 * h},
                                             {0.05, 0.010, z + 2.0 * h},
                                             {0.05, 0.026, z + 2.0 * h},
                                             {0.05, 0.018, z + 6.0 * h}};
  const Model wedge = one_tet(corners);
  Model model =
      assembled({lower, upper, wedge}, soft_tissue, [](const Vec3<double>&) { return true; });
  State start{std::vector<Vec3<double>>(model.vertex_count()),
              std::vector<Vec3<double>>(model.vertex_count())};
  std::size_t tip = 0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const Vec3<double> x = place(model, i);
    if (norm(x - corners[0]) < 1e-9) {
      tip = i;
      start.u[i].z = -1.25 * h;
      continue;
    }
    model.fixed[i] = true;
    if (x.z > z + 3.5 * h && x.x < 0.041) start.u[i].z = -2.5 * h;
  }
  const auto solver = make_on_cpu(model, folding_scene(true), {.precision = Precision::fp64});
  solver->set_state(start);
  for (int frame = 0; frame < 30; ++frame) solver->advance_frame();
  const State state = solver->state();
  const double height = (place(model, tip) + state.u[tip]).z - z;
  EXPECT_GT(height, 0.6 * h);
  EXPECT_LT(height, 0.9 * h);
  EXPECT_LT(norm(state.v[tip]), 1e-4);
}

TEST(SelfContact, APairThatBeginsNearerThanTheThicknessIsLedApartByATenthOfWhatItLacks) {
  EXPECT_EQ(least_distance(2e-3, 1e-3), 1e-3);
  EXPECT_EQ(least_distance(1e-3, 1e-3), 1e-3);
  EXPECT_DOUBLE_EQ(least_distance(0.5e-3, 1e-3), 0.55e-3);
  EXPECT_DOUBLE_EQ(least_distance(-0.5e-3, 1e-3), -0.35e-3);
}

TEST(SelfContact, NeighboursAtRestAndTheTissueBehindAreLeftOut) {
  const Model model = make_flap();
  SurfacePairs pairs(model, thickness);
  pairs.place(model.rest, 4.5e-3);
  std::size_t found = 0;
  std::vector<int> near;
  for (std::size_t t = 0; t < pairs.triangles().size(); ++t) {
    pairs.find(model.rest, static_cast<int>(t), near);
    const auto& [a, b, c] = pairs.triangles()[t];
    for (const int v : near) {
      EXPECT_TRUE(v != a && v != b && v != c);
      const Vec3<double> q =
          nearest_on_triangle(model.rest[v], model.rest[a], model.rest[b], model.rest[c]);
      EXPECT_GE(norm(model.rest[v] - q), thickness);
    }
    found += near.size();
  }
  EXPECT_GT(found, 0u);  // across the slot, 4 mm wide
}

TEST(SelfContact, EveryVertexOfTheSurfaceIsLookedAtOnce) {
  const Model model = make_cube(3);
  const SurfacePairs pairs(model, 1e-3);
  std::vector<int> expected;
  for (int v = 0; v < 64; ++v) {
    const int i = v % 4, j = v / 4 % 4, k = v / 16;
    const auto inner = [](int at) { return at == 1 || at == 2; };
    if (!(inner(i) && inner(j) && inner(k))) expected.push_back(v);
  }
  EXPECT_EQ(pairs.vertices(), expected);
}

TEST(SelfContact, ATriangleTornOutFarStillMeetsWhatIsNearIt) {
  const Model model = make_flap();
  SurfacePairs pairs(model, thickness);
  auto positions = model.rest;
  const auto& [a, b, c] = pairs.triangles()[0];
  positions[a] += Vec3<double>{40.0, 0.0, 0.0};  // over 8,000 by 8,000 cells
  positions[b] += Vec3<double>{0.0, 40.0, 0.0};
  positions[c] += Vec3<double>{-40.0, -40.0, 0.0};
  pairs.place(positions, 1e-3);
  std::vector<int> near;
  pairs.find(positions, 0, near);
  EXPECT_GT(near.size(), 20u);
}

// The threads of a device take the pairs of a round in any order.
class ShuffledTeam {
 public:
  template <class Work>
  void for_each(int count, const Work& work) const {
    std::vector<int> order(count);
    std::iota(order.begin(), order.end(), 0);
    std::ranges::shuffle(order, random_);
    for (const int k : order) work(k);
  }
  template <class Work>
  bool any(int count, const Work& work) const {
    bool result = false;
    for_each(count, [&](int k) { result |= work(k); });
    return result;
  }
  void lower(Claim& a, Claim b) const { a = std::min(a, b); }

 private:
  mutable std::mt19937 random_{7};
};

TEST(SelfContact, PairsSolvedInRoundsAreThoseOfTheListInItsOrderToTheBit) {
  const Model model = make_flap();
  const SurfacePairs pairs(model, thickness);
  std::mt19937 random(3);
  std::vector<Vec3<double>> start;
  std::vector<double> w;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    start.push_back(random_vector(random, 1e-3));
    w.push_back(model.fixed[i] ? 0.0 : 1.0 / model.mass[i]);
  }
  std::vector<TouchingPair> list;
  std::uniform_int_distribution<std::size_t> any(0, pairs.vertices().size() - 1);
  for (int t = 0; t < static_cast<int>(pairs.triangles().size()); ++t) {
    for (int k = 0; k < 3; ++k) {
      list.push_back({pairs.vertices()[any(random)], t, {0.0, {0.6, 0.0, 0.8}, {0.2, 0.5, 0.3}}});
    }
  }
  const double distance = 0.02, friction = 0.5;
  auto in_order = list, in_rounds = list;
  auto d = start, rounds_d = start;
  const LooseBody body{pairs.triangles().data(), {}, model.rest, d, w};
  for (auto* pairs_of : {&in_order, &in_rounds}) {
    for (auto& pair : *pairs_of) prepare(body, distance, pair);
  }
  for (int sweep = 0; sweep < contact_sweeps; ++sweep) {
    for (auto& pair : in_order) keep_apart(body, pair, sweep);
  }
  for (const auto& pair : in_order) resist_slide(body, pair, friction);

  const LooseBody same{pairs.triangles().data(), {}, model.rest, rounds_d, w};
  std::vector<int> round_of(list.size());
  std::vector<Claim> holder(model.vertex_count(), unclaimed);
  const int count = static_cast<int>(list.size());
  const ShuffledTeam team;
  const int rounds =
      keep_all_apart(team, same, in_rounds.data(), count, round_of.data(), holder.data());
  resist_all_slides(team, same, in_rounds.data(), count, friction, round_of.data(), rounds);
  EXPECT_EQ(d, rounds_d);
  EXPECT_LT(rounds, count / 4) << "pairs that share no vertex go side by side";
  EXPECT_EQ(std::ranges::count(holder, unclaimed), std::ssize(holder));
  EXPECT_GT(count_held(in_order), 20u);
  EXPECT_EQ(count_held(in_order), count_held(in_rounds));
}

TEST(SelfContact, SolversThatCannotDoItSaySo) {
  const Model model = make_cube(1);
  EXPECT_THROW(make_on_cpu(model, folding_scene(true), {.method = Method::fem}), Refusal);
  EXPECT_EQ(what_cuda_lacks(folding_scene(true), {.scheme = Scheme::block_gauss_seidel}), "");
  EXPECT_EQ(what_cuda_lacks(folding_scene(true), {}), "");
}

TEST(SelfContact, ATriangleWithoutAreaHasAHeightAndNothingOverIt) {
  const Vec3<double> a{0.0, 0.0, 0.0}, b{0.01, 0.0, 0.0};
  for (const Vec3<double>& c : {a, b, 2.0 * b}) {
    const Over over = over_triangle({0.005, 0.001, 0.002}, a, b, c);
    EXPECT_EQ(over.height, 0.0);
    for (const double share : over.b) EXPECT_LT(share, 0.0);
  }
}

// One of them moves by one along z: a corner tilts the triangle's plane, the vertex leaves it.
TEST(SelfContact, TheVertexAndEveryCornerOfAPairGoTheirOwnWay) {
  const Vec3<double> up = {0.0, 0.0, 1.0};
  const SurfacePair still{.x = {0.2, 0.3, 0.7}, .y = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}};
  const double heights[] = {(0.7 - 1.0 + 0.2 + 0.3) / std::sqrt(3.0), (0.7 - 0.2) / std::sqrt(2.0),
                            (0.7 - 0.3) / std::sqrt(2.0)};
  for (int corner = 0; corner < 3; ++corner) {
    SurfacePair pair = still;
    pair.dy[corner] = up;
    EXPECT_NEAR(pair.at(1.0).height, heights[corner], 1e-15) << corner;
    EXPECT_NEAR(pair.at(0.0).height, 0.7, 1e-15);
  }
  SurfacePair pair = still;
  pair.dx = up;
  EXPECT_NEAR(pair.at(0.5).height, 1.2, 1e-15);
}

}  // namespace
}  // namespace viscera::sim
