// Every element effect of the registry: gradients and forces against finite differences, invariance
// under rigid motion, and the same bits from every instruction set.
#include <gtest/gtest.h>

#include <bit>
#include <cstring>
#include <limits>
#include <numeric>

#include "sim/backend/cpu/elements.hpp"
#include "sim/solvers/xpbd/linearized.hpp"
#include "tests/sim/effects/element_sample.hpp"

namespace viscera::sim {
namespace {

// The force on a vertex.
template <int rows, int arity>
Vec3<double> force_on(int vertex, const Evaluation<double, rows, arity>& out) {
  Vec3<double> force = out.preload[vertex];
  if constexpr (rows > 0) {
    for (int row = 0; row < rows; ++row) {
      force -= (out.stiffness[row] * out.remainder[row]) * out.gradient[row][vertex];
    }
  }
  return force;
}

// The corotational rows are given for a frozen rotation; only their sum is exact.
template <class Effect>
constexpr bool has_exact_rows = is_constraint<Effect> && !std::is_same_v<Effect, Corotational>;
// Forces between the element's vertices only.
template <class Effect>
constexpr bool is_internal = Effect::arity != 1 && Effect::arity != 3;
template <class Effect>
constexpr bool turns_with_the_body = Effect::arity != 1 && !std::is_same_v<law_of<Effect>, Linear>;

// slope(ahead, behind, h) and the gradient it is to equal, for every coordinate of 20 samples.
template <class Effect, class Check>
void for_each_difference(double h, Check&& check) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Sample<Effect> sample(seed);
    for (int i = 0; i < Effect::arity; ++i) {
      for (double Vec3<double>::*axis : {&Vec3<double>::x, &Vec3<double>::y, &Vec3<double>::z}) {
        auto ahead = sample, behind = sample;
        ahead.d[i].*axis += h;
        behind.d[i].*axis -= h;
        check(sample.evaluate(), ahead, behind, i, axis);
      }
    }
  }
}

template <class Effect>
void check_gradient() {
  constexpr double h = 1e-9;
  for_each_difference<Effect>(h, [](const auto& exact, const auto& ahead, const auto& behind, int i,
                                    auto axis) {
    for (int row = 0; row < Effect::rows; ++row) {
      const double slope = (ahead.evaluate().value[row] - behind.evaluate().value[row]) / (2.0 * h);
      const double gradient = exact.gradient[row][i].*axis;
      EXPECT_NEAR(gradient, slope, 1e-4 * (1.0 + std::abs(gradient)))
          << Effect::name << " row " << row << " vertex " << i;
    }
  });
}

template <class Effect>
void check_force() {
  constexpr double h = 1e-7;
  for_each_difference<Effect>(h, [](const auto& exact, const auto& ahead, const auto& behind, int i,
                                    auto axis) {
    double scale = 0.0;
    for (int v = 0; v < Effect::arity; ++v) scale = std::max(scale, norm(force_on(v, exact)));
    const double slope = (ahead.energy() - behind.energy()) / (2.0 * h);
    EXPECT_NEAR(force_on(i, exact).*axis, -slope, 1e-6 * scale) << Effect::name << " vertex " << i;
  });
}

TEST(Effects, GradientsAgreeWithCentralDifferences) {
  Effects::for_each([]<class Effect, std::size_t>() {
    if constexpr (has_exact_rows<Effect>) check_gradient<Effect>();
  });
}

TEST(Effects, ForcesAreTheSlopesOfTheEnergy) {
  Effects::for_each([]<class Effect, std::size_t>() {
    if constexpr (is_constraint<Effect>) check_force<Effect>();
  });
}

TEST(Effects, PreloadAndRemainderAreThoseOfTheReferenceMultipliers) {
  // lambda0 = k (remainder - C), and the preload is its force.
  Effects::for_each([]<class Effect, std::size_t>() {
    if constexpr (is_constraint<Effect>) {
      const auto out = Sample<Effect>(11).evaluate();
      for (int i = 0; i < Effect::arity; ++i) {
        Vec3<double> force;
        double scale = 0.0;
        for (int row = 0; row < Effect::rows; ++row) {
          const double multiplier = out.stiffness[row] * (out.remainder[row] - out.value[row]);
          force += multiplier * out.gradient[row][i];
          scale += std::abs(multiplier) * norm(out.gradient[row][i]);
        }
        EXPECT_LE(norm(force - out.preload[i]), 1e-13 * scale) << Effect::name;
      }
    }
  });
}

Vec3<double> rotated(const Vec3<double>& x, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * x.x - s * x.y, s * x.x + c * x.y, x.z};
}

template <class Effect>
void check_rigid_motion() {
  constexpr double angle = 0.8;
  Sample<Effect> sample(7);
  const auto before = sample.evaluate();
  for (int i = 0; i < Effect::arity; ++i) {
    const Vec3<double> x = sample.model.rest[sample.vertices[i]];
    sample.u[i] = rotated(x + sample.u[i], angle) + Vec3<double>{1.0, -2.0, 0.5} - x;
    sample.d[i] = rotated(sample.d[i], angle);
  }
  const auto after = sample.evaluate();
  Vec3<double> sum;
  double scale = 0.0;
  for (int i = 0; i < Effect::arity; ++i) scale += norm(force_on(i, before));
  ASSERT_GT(scale, 0.0) << Effect::name;
  for (int i = 0; i < Effect::arity; ++i) {
    sum += force_on(i, after);
    const Vec3<double> expected = rotated(force_on(i, before), angle);
    EXPECT_LT(norm(force_on(i, after) - expected), 1e-9 * scale) << Effect::name;
  }
  if (is_internal<Effect>) {
    EXPECT_LT(norm(sum), 1e-12 * scale) << Effect::name;
  }
  if constexpr (is_constraint<Effect>) {
    for (int row = 0; row < Effect::rows; ++row) {
      EXPECT_NEAR(after.value[row], before.value[row], 1e-10) << Effect::name;
    }
  }
}

TEST(Effects, RigidMotionTurnsTheForcesAndChangesNothingElse) {
  Effects::for_each([]<class Effect, std::size_t>() {
    if constexpr (Effect::kind == EffectKind::element) {
      if constexpr (turns_with_the_body<Effect>) check_rigid_motion<Effect>();
    }
  });
}

// What a sweep of all elements of an effect starts from, and leaves.
template <class T>
struct SweepCase {
  std::vector<Row<T>> u, d;

  explicit SweepCase(const Model& model) {
    std::mt19937 generator(5);
    constexpr double dt = 2.6e-4;
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      u.push_back({cast<T>(random_vector(generator, 2e-3))});
      d.push_back(
          {cast<T>(random_vector(generator, 1e-6)), static_cast<T>(dt * dt / model.mass[i])});
    }
  }
  SweepFields<T> fields() { return {u.data(), d.data(), {T(1), T(0.5)}}; }
};

template <class Effect, class T, Arithmetic arithmetic>
void sweep_one_by_one(const Prepared<Effect, T>& all, const SweepFields<T>& f, int vertex_count) {
  constexpr int arity = Effect::arity;
  using Vertices = std::array<int, arity>;
  const Coloring coloring =
      color_elements<arity>(std::span<const Vertices>(all.vertices), vertex_count);
  for (const int e : coloring.order) {
    Vec3<T> u[arity], d[arity], p[arity];
    T mobility[arity], history[history_of<Effect> + 1] = {};
    for (int i = 0; i < arity; ++i) {
      const int v = all.vertices[e][i];
      u[i] = f.u[v].v, d[i] = f.d[v].v, mobility[i] = f.d[v].w;
    }
    element_impulses<Effect, arithmetic>(all.rest[e], mobility, f.constants, u, d,
                                         static_cast<T*>(nullptr), history, p);
    for (int i = 0; i < arity; ++i) f.d[all.vertices[e][i]].v = d[i] + mobility[i] * p[i];
  }
}

template <class Effect, class T, Arithmetic arithmetic>
void check_sweeps(std::size_t index) {
  const Model model = make_cube(3);
  const int n = static_cast<int>(model.vertex_count());
  const Prepared<Effect, T> elements(model, sample_params<Effect>(), 2.6e-4);
  SweepCase<T> expected(model);
  sweep_one_by_one<Effect, T, arithmetic>(elements, expected.fields(), n);
  for (const SweepTables& tables : runnable_sweeps()) {
    SweepCase<T> found(model);
    PackedElements<Effect, T> packed;
    using Vertices = typename PackedElements<Effect, T>::Vertices;
    const std::span<const Vertices> vertices(elements.vertices);
    append_colors(
        color_elements<Effect::arity>(vertices, n), [vertices](int e) { return vertices[e]; },
        packed);
    packed.set_rest(elements.rest);
    packed.history.resize(packed.groups.size() * packed.history_size * packed.width);
    SweepFields<T> fields = found.fields();
    fields.history = packed.history.data();
    std::get<SweepTable<T>>(tables)[static_cast<int>(arithmetic)][index](
        packed.groups.data(), {0, static_cast<int>(packed.groups.size())}, fields);
    EXPECT_EQ(std::memcmp(found.d.data(), expected.d.data(), n * sizeof(Row<T>)), 0)
        << Effect::name << ", arithmetic " << static_cast<int>(arithmetic);
  }
}

// From slight strains to elements crushed, inverted and flat to a point.
template <class Effect>
void expect_eliminated_as_solved() {
  constexpr int arity = Effect::arity;
  for (const double strain : {0.0, 1e-6, 0.01, 0.3, 1.0, 3.0}) {
    for (unsigned seed = 1; seed <= 20; ++seed) {
      Sample<Effect> sample(seed);
      std::mt19937 generator(seed);
      double mobility[arity], weight[Effect::rows];
      for (int i = 0; i < arity; ++i) {
        sample.u[i] = random_vector(generator, strain * 1.0);  // of a cube of 1 m
        sample.d[i] = random_vector(generator, strain * 1e-2);
        mobility[i] = std::pow(10.0, random_in(generator, -10.0, -3.0));
      }
      Vec3<double> solved[arity], eliminated[arity];
      xpbd_from_zero(sample.evaluate(), mobility, weight, solved);
      Eliminated<Effect>::xpbd_impulses(sample.rest, mobility, sample.u, sample.d, eliminated);
      double size = 0.0;
      for (const auto& p : solved) size = std::max(size, norm(p));
      for (int i = 0; i < arity; ++i) {
        EXPECT_LE(norm(eliminated[i] - solved[i]), 1e-11 * size) << strain << ", seed " << seed;
      }
    }
  }
}

TEST(Effects, EliminatedMultipliersAreThoseOfTheSolver) {
  int effects = 0;
  Effects::for_each([&effects]<class Effect, std::size_t>() {
    if constexpr (Effect::kind == EffectKind::element) {
      if constexpr (is_eliminated<Effect>) {
        ++effects;
        expect_eliminated_as_solved<Effect>();
      }
    }
  });
  EXPECT_GT(effects, 0);
}

// The solvers hand over an evaluation whose numbers are not set.
TEST(Effects, AnEvaluationLeavesNoNumberUnset) {
  Effects::for_each([]<class Effect, std::size_t>() {
    if constexpr (Effect::kind == EffectKind::element) {
      const Sample<Effect> sample(3);
      using Found = Evaluation<double, Effect::rows, Effect::arity>;
      std::array<double, sizeof(Found) / sizeof(double)> numbers;
      numbers.fill(std::numeric_limits<double>::quiet_NaN());
      auto out = std::bit_cast<Found>(numbers);
      if constexpr (history_of < Effect >> 0) {
        Effect::evaluate(sample.rest, sample.history, sample.u, sample.d, out);
      } else {
        Effect::evaluate(sample.rest, sample.u, sample.d, out);
      }
      numbers = std::bit_cast<decltype(numbers)>(out);
      for (const double number : numbers) EXPECT_TRUE(std::isfinite(number)) << Effect::name;
    }
  });
}

// Pressure follows the surface within a substep, and not only from one to the next.
TEST(Effects, LoadsDependOnWhereVerticesAreAndNotOnWhenTheyCameThere) {
  Effects::for_each([]<class Effect, std::size_t>() {
    if constexpr (is_load<Effect>) {
      Sample<Effect> late(4), early(4);
      for (int i = 0; i < Effect::arity; ++i) {
        late.d[i] = 0.5 * late.u[i];
        late.u[i] = early.u[i] - late.d[i];
        early.d[i] = {};
      }
      const auto now = late.evaluate(), before = early.evaluate();
      for (int i = 0; i < Effect::arity; ++i) {
        EXPECT_LE(norm(now.preload[i] - before.preload[i]), 1e-12 * norm(before.preload[i]))
            << Effect::name;
      }
    }
  });
}

// Where an element is linearised nothing is left out, unless it had to be relaxed.
template <class Effect>
void expect_linearised_as_solved() {
  constexpr int arity = Effect::arity, edges = edge_count<arity>;
  int strained = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Sample<Effect> sample(seed);
    double mobility[arity], weight[Effect::rows];
    std::mt19937 generator(seed);
    for (auto& w : mobility) w = random_in(generator, 1e-6, 1e-4);
    if constexpr (is_linearized_apart<Effect>) {
      ASSERT_EQ(Eliminated<Effect>::relaxation(sample.rest, mobility), 1.0);
    }
    Vec3<double> solved[arity], e[edges], p[edges];
    xpbd_from_zero(sample.evaluate(), mobility, weight, solved);
    Linearized<Effect, double> linear;
    linearize<Effect>(sample.rest, mobility, sample.u, sample.d, sample.history, linear);
    differences(sample.d, e);
    linear.impulses(e, p);
    double size = 0.0;
    for (const auto& impulse : solved) size = std::max(size, norm(impulse));
    strained += size > 0.0;
    for (int i = 0; i < edges; ++i) {
      EXPECT_LE(norm(p[i] - solved[i + arity - edges]), 1e-11 * size) << Effect::name;
    }
  }
  EXPECT_GT(strained, 5) << Effect::name;
}

TEST(Effects, LinearisedElementsGiveTheSolversImpulsesWhereTheyWereLinearised) {
  int effects = 0;
  Effects::for_each([&effects]<class Effect, std::size_t>() {
    if constexpr (is_constraint<Effect>) {
      if constexpr (is_linearizable<Effect>) {
        ++effects;
        expect_linearised_as_solved<Effect>();
      }
    }
  });
  EXPECT_GT(effects, 1);
}

// (I + A S) y = -c for a random A = B B^T, some rows without stiffness.
template <int rows>
void check_rows() {
  std::mt19937 generator(rows);
  for (int sample = 0; sample < 50; ++sample) {
    double b[rows][rows], a[rows][rows], k[rows], c[rows], y[rows];
    for (auto& row : b) {
      for (double& entry : row) entry = random_in(generator, -1.0, 1.0);
    }
    for (int p = 0; p < rows; ++p) {
      for (int q = 0; q < rows; ++q) {
        a[p][q] = 0.0;
        for (int r = 0; r < rows; ++r) a[p][q] += b[p][r] * b[q][r];
      }
      k[p] = std::max(0.0, random_in(generator, -1.0, 5.0));
      c[p] = k[p] > 0.0 ? random_in(generator, -1.0, 1.0) : 0.0;
    }
    solve_rows(a, k, c, y);
    for (int p = 0; p < rows; ++p) {
      if (k[p] == 0.0) continue;
      double sum = c[p] + y[p];
      for (int q = 0; q < rows; ++q) sum += a[p][q] * k[q] * y[q];
      EXPECT_NEAR(sum, 0.0, 1e-12) << p << " of " << rows << " rows, sample " << sample;
    }
  }
}

TEST(Rows, AreSolvedHoweverManyAreCoupled) {
  check_rows<1>();
  check_rows<2>();
  check_rows<3>();
  check_rows<6>();
}

TEST(Effects, EveryInstructionSetGivesTheBitsOfTheScalarCode) {
  Effects::for_each([]<class Effect, std::size_t i>() {
    if constexpr (Effect::kind == EffectKind::element) {
      using enum Arithmetic;
      check_sweeps<Effect, float, xpbd_only>(i);
      check_sweeps<Effect, double, xpbd_only>(i);
      if constexpr (is_projectable<Effect>) check_sweeps<Effect, float, pbd>(i);
      check_sweeps<Effect, double, force>(i);
    }
  });
}

}  // namespace
}  // namespace viscera::sim
