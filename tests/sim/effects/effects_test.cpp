// Every element effect of the registry: gradients and forces against finite differences, invariance
// under rigid motion; and the Neo-Hookean stress against closed forms.
#include <gtest/gtest.h>

#include <bit>
#include <cstring>
#include <limits>
#include <numeric>

#include "sim/backend/cpu/elements.hpp"
#include "sim/model/corner_gradients.hpp"
#include "sim/solvers/xpbd/linearized.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

// One element, displaced at random, with a history.
template <class Effect>
struct Sample {
  Model model = make_cube(1);
  typename Effect::Params params = sample_params<Effect>();
  std::array<int, Effect::arity> vertices;
  typename Effect::template Rest<double> rest;
  Vec3<double> u[Effect::arity], d[Effect::arity];
  double history[history_of<Effect> + 1];

  explicit Sample(unsigned seed) {
    const auto& elements = Effect::elements(model, params);
    vertices = elements[0];
    rest = Effect::template rest<double>(model, elements, 0, params, 1e-3);
    std::mt19937 generator(seed);
    for (auto& a : u) a = random_vector(generator, 0.01);
    for (auto& a : d) a = random_vector(generator, 1e-5);
    for (auto& number : history) number = random_in(generator, -0.1, 0.1);
  }
  auto evaluate() const {
    Evaluation<double, Effect::rows, Effect::arity> out{};
    if constexpr (history_of < Effect >> 0) {
      Effect::evaluate(rest, history, u, d, out);
    } else {
      Effect::evaluate(rest, u, d, out);
    }
    return out;
  }
  double energy() const {
    const auto out = evaluate();
    double sum = 0.0;
    for (int row = 0; row < Effect::rows; ++row) {
      sum += 0.5 * out.stiffness[row] * out.value[row] * out.value[row];
    }
    return sum;
  }
};

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
constexpr bool turns_with_the_body = Effect::arity != 1 && !std::is_same_v<Effect, Linear>;

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
    append_by_color(elements, n, packed);
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

// On the vertices 1 to 3 by b_i(e) = b_i(0) - k_D grad N_i . grad N_j e_j.
TEST(NeoHookean, TheShearOfALinearisedElementFollowsItsVertices) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Sample<NeoHookean> sample(seed);
    const double mobility[4] = {1e-5, 2e-5, 3e-5, 4e-5};
    Linearized<NeoHookean, double> linear;
    linearize<NeoHookean>(sample.rest, mobility, sample.u, sample.d, sample.history, linear);
    const auto gradients = corner_gradients(sample.rest.rest_inverse);
    const Vec3<double> still[3] = {}, way = {0.01, -0.02, 0.03};
    Vec3<double> before[3];
    linear.preload_at(still, before);
    for (int j = 0; j < 3; ++j) {
      Vec3<double> e[3] = {}, after[3];
      e[j] = way;
      linear.preload_at(e, after);
      for (int i = 0; i < 3; ++i) {
        const double slope = sample.rest.deviatoric * dot(gradients[i + 1], gradients[j + 1]);
        EXPECT_LE(norm(after[i] - before[i] + slope * way), 1e-9 * norm(slope * way) + 1e-12)
            << i << " by " << j;
      }
    }
  }
}

// Dimensionless inside: single precision holds bodies from a micrometre to a kilometre.
TEST(NeoHookean, SinglePrecisionHoldsTinyAndHugeElements) {
  for (const double size : {1e-6, 1.0, 1e3}) {
    Material scaled = soft_tissue;  // that the same steps do the same to all sizes
    scaled.youngs_modulus *= size * size;
    const Model model = make_cube(1, scaled, size);
    const auto& elements = NeoHookean::elements(model, {});
    const auto rest = NeoHookean::rest<float>(model, elements, 0, {}, 1e-3);
    const auto exact = NeoHookean::rest<double>(model, elements, 0, {}, 1e-3);
    std::mt19937 generator(5);
    float mobility[4];
    Vec3<float> u[4], d[4], p[4];
    double mobility64[4];
    Vec3<double> u64[4], d64[4], p64[4];
    for (int i = 0; i < 4; ++i) {
      u64[i] = random_vector(generator, 0.3 * size);
      d64[i] = random_vector(generator, 1e-3 * size);
      mobility64[i] = 1e-6 / model.mass[model.tets[0][i]];
      u[i] = cast<float>(u64[i]);
      d[i] = cast<float>(d64[i]);
      mobility[i] = static_cast<float>(mobility64[i]);
    }
    Eliminated<NeoHookean>::xpbd_impulses(rest, mobility, u, d, p);
    Eliminated<NeoHookean>::xpbd_impulses(exact, mobility64, u64, d64, p64);
    double largest = 0.0;
    for (const auto& impulse : p64) largest = std::max(largest, norm(impulse));
    for (int i = 0; i < 4; ++i) {
      EXPECT_LE(norm(cast<double>(p[i]) - p64[i]), 1e-5 * largest) << size << " m";
    }
  }
}

TEST(NeoHookean, AnElementFlatToAPointIsLeftAlone) {
  Sample<NeoHookean> sample(1);
  const double mobility[4] = {1e-6, 1e-6, 1e-6, 1e-6};
  for (int i = 0; i < 4; ++i) {
    sample.u[i] = -1.0 * sample.model.rest[sample.vertices[i]];
    sample.d[i] = {};
  }
  Vec3<double> p[4];
  Eliminated<NeoHookean>::xpbd_impulses(sample.rest, mobility, sample.u, sample.d, p);
  for (const auto& impulse : p) EXPECT_EQ(norm(impulse), 0.0);
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

// First Piola-Kirchhoff stress along x for F = diag(s, t, t), from the constraints' own values.
double nominal_stress(const Material& material, double s, double t) {
  const Lame constants = lame(material);
  const double lambda = constants.neo_hookean_lambda();
  const Mat3<double> h{{{s - 1.0, 0, 0}, {0, t - 1.0, 0}, {0, 0, t - 1.0}}};
  const double c_h = NeoHookean::volume_strain(h) - constants.mu / lambda;
  return constants.mu * s + lambda * c_h * cofactor(plus_identity(1.0, h)).col[0].x;
}

TEST(NeoHookean, UniaxialStressMatchesTheClosedForm) {
  // t^2 = a/s - mu/(lambda s^2) makes the sides free of stress; P/E for nu = 0.45.
  const Material material = {.youngs_modulus = 1.0, .poisson_ratio = 0.45, .density = 1.0};
  const double table[][3] = {{0.5, 1.341641, -1.068966}, {0.7, 1.169336, -0.432191},
                             {0.8, 1.103970, -0.249461}, {0.9, 1.048220, -0.110638},
                             {1.1, 0.957787, 0.091738},  {1.2, 0.920447, 0.170338},
                             {1.5, 0.829993, 0.358876},  {2.0, 0.724569, 0.599138}};
  for (const auto& [s, t, p] : table) EXPECT_NEAR(nominal_stress(material, s, t), p, 3e-6) << s;
}

TEST(NeoHookean, StressIsTheDerivativeOfTheEnergy) {
  const Material material = {.youngs_modulus = 5e3, .poisson_ratio = 0.45, .density = 1060.0};
  const auto energy = [&material](double s, double t) {
    return NeoHookean::energy_density(material, {{{s - 1, 0, 0}, {0, t - 1, 0}, {0, 0, t - 1}}});
  };
  EXPECT_EQ(energy(1.0, 1.0), 0.0);
  for (const double s : {0.6, 0.9, 1.3}) {
    constexpr double h = 1e-6;
    const double slope = (energy(s + h, 0.95) - energy(s - h, 0.95)) / (2.0 * h);
    EXPECT_NEAR(nominal_stress(material, s, 0.95), slope, 1e-6 * std::abs(slope));
  }
}

TEST(NeoHookean, SmallStrainSlopeIsYoungsModulusForEveryPoissonRatio) {
  for (const double nu : {0.0, 0.3, 0.45, 0.49}) {
    const Material material = {.youngs_modulus = 1e4, .poisson_ratio = nu, .density = 1060.0};
    const Lame constants = lame(material);
    const double lambda = constants.neo_hookean_lambda(), a = 1.0 + constants.mu / lambda;
    const double s = 1.0 + 1e-6;
    const double t = std::sqrt(a / s - constants.mu / (lambda * s * s));
    EXPECT_NEAR(nominal_stress(material, s, t) / 1e-6, 1e4, 1.0) << nu;
  }
}

TEST(Viscosity, ItsBoundTakesTheLargestEigenvalue) {
  std::mt19937 generator(11);
  for (const auto& value : std::vector<std::array<double, 3>>{
           {3.0, 1.0, 0.5}, {2.0, 2.0, 1.0}, {4.0, 1.0, 1.0}, {5.0, 5.0, 5.0}, {1.0, 0.0, 0.0}}) {
    Vec3<double> a = random_vector(generator, 1.0), b = random_vector(generator, 1.0);
    a = (1.0 / norm(a)) * a;
    b -= dot(a, b) * a;
    b = (1.0 / norm(b)) * b;
    const Vec3<double> c = cross(a, b);
    const auto column = [&](double x, double y, double z) {
      return value[0] * x * a + value[1] * y * b + value[2] * z * c;
    };
    const Mat3<double> m{{column(a.x, b.x, c.x), column(a.y, b.y, c.y), column(a.z, b.z, c.z)}};
    EXPECT_NEAR(largest_eigenvalue(m), value[0], 1e-7 * value[0]);
  }
}

TEST(Viscosity, AShearRateMeetsTheStressOfANewtonianFluid) {
  // The work of the forces over the substep is -V dt (2 eta |D|^2).
  constexpr double dt = 1e-6;
  const Model model = make_cube(1);
  const auto rest = Viscosity::rest<double>(model, model.tets, 0, {}, dt);
  const double rate = 3.0;  // 1/s, in simple shear: D has two entries rate/2
  Vec3<double> u[4] = {}, d[4];
  for (int i = 0; i < 4; ++i) d[i] = {rate * dt * model.rest[model.tets[0][i]].y, 0.0, 0.0};
  Evaluation<double, 0, 4> out;
  Viscosity::evaluate(rest, u, d, out);
  double work = 0.0;
  for (int i = 0; i < 4; ++i) work += dot(out.preload[i], d[i]);
  const double eta = lame(soft_tissue).mu * soft_tissue.damping;
  EXPECT_NEAR(work, -eta * rate * rate * model.volume[0] * dt, 1e-9 * std::abs(work));
}

TEST(Viscosity, ItsBoundIsThatOfTheWayInWhichATetGivesWayMost) {
  // s x.x >= x.(sum b_i b_i^T / m_i) x of every x, and some x has both alike.
  const Model model = make_box({0.05, 0.02, 0.03}, {2, 1, 1}, soft_tissue);
  constexpr double dt = 1e-3;
  std::mt19937 generator(13);
  for (std::size_t tet = 0; tet < model.tet_count(); ++tet) {
    const double unit = 2.0 * lame(soft_tissue).mu * soft_tissue.damping * dt * model.volume[tet];
    const double s = Viscosity::explicit_number(model, tet, dt) / unit;
    double most = 0.0;
    for (int trial = 0; trial < 4000; ++trial) {
      const Vec3<double> x = random_vector(generator, 1.0);
      double sum = 0.0;
      for (int i = 0; i < 4; ++i) {
        Vec3<double> only[4] = {};
        only[i] = {1.0, 0.0, 0.0};  // then row x of their gradient is b_i
        const Mat3<double> h = displacement_gradient(only, model.rest_inverse[tet]);
        const double along = dot(Vec3<double>{h.col[0].x, h.col[1].x, h.col[2].x}, x);
        sum += along * along / model.mass[model.tets[tet][i]];
      }
      most = std::max(most, sum / dot(x, x));
    }
    EXPECT_LE(most, s * (1.0 + 1e-12)) << tet;
    EXPECT_GE(most, 0.99 * s) << tet;
  }
}

// A strength that single precision cannot hold is kept together with its bound.
TEST(Viscosity, SinglePrecisionHoldsAStrengthBeyondItsRange) {
  Material rigid = soft_tissue;
  rigid.youngs_modulus = 1e38;
  const Model model = make_cube(1, rigid);
  constexpr double dt = 1e-9;
  const auto rest = Viscosity::rest<float>(model, model.tets, 0, {}, dt);
  const auto exact = Viscosity::rest<double>(model, model.tets, 0, {}, dt);
  ASSERT_GT(2.0 * lame(rigid).mu * rigid.damping * model.volume[0] / dt, 3.5e38);
  Vec3<float> u[4] = {}, d[4];
  Vec3<double> u64[4] = {}, d64[4];
  std::mt19937 generator(14);
  for (int i = 0; i < 4; ++i) {
    d[i] = cast<float>(random_vector(generator, 1e-6));
    d64[i] = cast<double>(d[i]);
  }
  Evaluation<float, 0, 4> out;
  Evaluation<double, 0, 4> exact_out;
  Viscosity::evaluate(rest, u, d, out);
  Viscosity::evaluate(exact, u64, d64, exact_out);
  double size = 0.0;
  for (const auto& force : exact_out.preload) size = std::max(size, norm(force));
  ASSERT_GT(size, 0.0);
  for (int i = 0; i < 4; ++i) {
    EXPECT_LE(norm(cast<double>(out.preload[i]) - exact_out.preload[i]), 1e-5 * size) << i;
  }
}

}  // namespace
}  // namespace viscera::sim
