// How quantities of a body at rest change with its materials, loads and supports, against
// differences of equilibria that Newton finds.
#include "sim/sensitivity.hpp"

#include <gtest/gtest.h>

#include "sim/base/refusal.hpp"
#include "sim/equilibrium.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

const std::function<void()> no_pause = [] {};

// A bar of two tissues that is held at one end, and at the other pulled aside where `pulled`.
struct Problem {
  Material left = soft_tissue, right = soft_tissue;
  double gravity = 9.80665, aside = 2e-3;
  bool pulled = true;

  explicit Problem(double nu = 0.4) { left.poisson_ratio = right.poisson_ratio = nu; }

  Model model() const {
    const Model box = make_box({0.06, 0.02, 0.02}, {6, 2, 2}, soft_tissue);
    std::vector<int> labels;
    for (const Tet& tet : box.tets) {
      double x = 0.0;
      for (const int v : tet) x += 0.25 * box.rest[v].x;
      labels.push_back(x < 0.0 ? 1 : 2);
    }
    return make_model(box.rest, box.tets, labels, {{1, left}, {2, right}});
  }
  Scene scene() const {
    Scene scene = elastic_scene();
    scene.params<Gravity>().emplace_back().acceleration = gravity;
    scene.params<Fixed>().emplace_back().side = "left";  // largest x
    if (pulled) {
      auto& lead = scene.params<Prescribed>().emplace_back();
      lead.side = "right", lead.displacement = {0.0, aside, 0.0}, lead.duration = 0.0;
    }
    return scene;
  }
};

// Of any smooth quantity: sum of a_i . u_i + (u_i . u_i) b_i / 2.
struct Quantity {
  std::vector<Vec3<double>> a;
  std::vector<double> b;

  explicit Quantity(std::size_t vertices) {
    std::mt19937 generator(3);
    for (std::size_t i = 0; i < vertices; ++i) {
      a.push_back(random_vector(generator, 1.0));
      b.push_back(random_in(generator, -50.0, 50.0));
    }
  }
  double of(const std::vector<Vec3<double>>& u) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += dot(a[i] + (0.5 * b[i]) * u[i], u[i]);
    return sum;
  }
  std::vector<Vec3<double>> slope(const std::vector<Vec3<double>>& u) const {
    std::vector<Vec3<double>> slope;
    for (std::size_t i = 0; i < a.size(); ++i) slope.push_back(a[i] + b[i] * u[i]);
    return slope;
  }
};

class Gradient : public testing::TestWithParam<std::pair<Element, double>> {
 protected:
  std::vector<Vec3<double>> rest(const Problem& problem) const {
    const Model model = problem.model();
    return equilibrium(model, problem.scene(), at_rest(model), GetParam().first, 1e-12, no_pause).u;
  }
  static State at_rest(const Model& model) {
    const std::vector<Vec3<double>> none(model.vertex_count());
    return {none, none};
  }
};

TEST_P(Gradient, IsThatOfDifferencesOfEquilibria) {
  const Problem here(GetParam().second);
  const std::vector<std::pair<const char*, std::function<double&(Problem&)>>> params = {
      {"E", [](Problem& p) -> double& { return p.left.youngs_modulus; }},
      {"E of the other", [](Problem& p) -> double& { return p.right.youngs_modulus; }},
      {"nu", [](Problem& p) -> double& { return p.left.poisson_ratio; }},
      {"density", [](Problem& p) -> double& { return p.right.density; }},
      {"gravity", [](Problem& p) -> double& { return p.gravity; }},
      {"displacement", [](Problem& p) -> double& { return p.aside; }}};
  const Model model = here.model();
  const Quantity quantity(model.vertex_count());
  const auto u = rest(here);
  const Sensitivity sensitivity(model, here.scene(), {u, at_rest(model).v}, GetParam().first,
                                quantity.slope(u), no_pause);
  for (std::size_t i = 0; i < u.size(); ++i) {
    EXPECT_NEAR(norm(sensitivity.displacement()[i] - u[i]), 0.0, 1e-9);
  }
  for (const auto& [name, param] : params) {
    const auto at = [&param = param, &here](double factor) {
      Problem there = here;
      param(there) *= factor;
      return there;
    };
    const double h = 2e-4;
    // Of fourth order: the curvature of the answer is not to be seen.
    const auto of = [&](double factor) { return quantity.of(rest(at(factor))); };
    const double expected =
        (8.0 * (of(1.0 + h) - of(1.0 - h)) - (of(1.0 + 2.0 * h) - of(1.0 - 2.0 * h))) / (12.0 * h);
    constexpr double step = 1e-5;
    const Problem less = at(1.0 - step), more = at(1.0 + step);
    const Model model_less = less.model(), model_more = more.model();
    const Scene scene_less = less.scene(), scene_more = more.scene();
    const double found =
        sensitivity.between({model_less, scene_less}, {model_more, scene_more}) / (2.0 * step);
    EXPECT_NEAR(found, expected, 1e-5 * std::abs(expected)) << name;
    EXPECT_GT(std::abs(expected), 1e-6) << name;
  }
}

INSTANTIATE_TEST_SUITE_P(Elements, Gradient,
                         testing::Values(std::pair(Element::linear, 0.4),
                                         std::pair(Element::linear, 0.49),
                                         std::pair(Element::smoothed, 0.4),
                                         std::pair(Element::smoothed, 0.47),
                                         std::pair(Element::quadratic, 0.4)));

TEST(Sensitivity, OfABodyOnItsWayIsThatOfItsTime) {
  const Problem problem;
  const Model model = problem.model();
  Scene scene = problem.scene();
  scene.params<Prescribed>().front().duration = 1.0;
  const std::vector<Vec3<double>> still(model.vertex_count());
  const State half_way{still, still, 30u * scene.time.substeps};
  ASSERT_NEAR(30 * scene.time.frame_s, 0.5, 1e-12);
  const Sensitivity sensitivity(model, scene, half_way, Element::linear,
                                std::vector<Vec3<double>>(model.vertex_count()), no_pause);
  int led = 0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    if (model.rest[i].x > -0.0299) continue;
    ++led;
    EXPECT_NEAR(sensitivity.displacement()[i].y, 0.5 * problem.aside, 1e-9);
  }
  EXPECT_EQ(led, 9);
}

TEST(Sensitivity, IsRefusedWhereItWouldNotBeExact) {
  const Problem here;
  const Model model = here.model();
  const std::vector<Vec3<double>> none(model.vertex_count());
  const auto refused = [&](Scene scene) {
    try {
      Sensitivity(model, scene, {none, none}, Element::linear, none, no_pause);
      return std::string("not refused");
    } catch (const Refusal& refusal) {
      return refusal.found;
    }
  };
  Scene pressed = here.scene();
  auto& pressure = pressed.params<Pressure>().emplace_back();
  pressure.side = "superior";
  EXPECT_NE(refused(pressed).find("follows the surface"), std::string::npos);
  Scene grounded = here.scene();
  grounded.params<Ground>().emplace_back().clearance = 0.0;
  EXPECT_NE(refused(grounded).find("obstacle"), std::string::npos);
  grounded.params<Ground>().front().clearance = 0.5;
  EXPECT_EQ(refused(grounded), "not refused");
}

TEST(Sensitivity, OfABodyThatNothingHoldsIsRefused) {
  const Model model = make_cube(2);
  const std::vector<Vec3<double>> none(model.vertex_count());
  Scene scene = elastic_scene();
  EXPECT_THROW(Sensitivity(model, scene, {none, none}, Element::linear, none, no_pause), Diverged);
}

}  // namespace
}  // namespace viscera::sim
