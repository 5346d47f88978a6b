// The error bar of a body at rest: against the truth where it is known, and what it says where it
// is not.
#include "sim/error_bar.hpp"

#include <gtest/gtest.h>

#include "sim/element_choice.hpp"
#include "sim/equilibrium.hpp"
#include "sim/model/surface.hpp"
#include "tests/verification/truth.hpp"

namespace viscera::sim {
namespace {

using Displacement = std::vector<Vec3<double>>;

Scene held_scene(bool smoothed) {
  Scene scene;
  scene.params<NeoHookean>().emplace_back();
  if (smoothed) set_element(scene.effects, Element::smoothed, bar_material.poisson_ratio);
  scene.params<Gravity>().emplace_back().direction = {0.0, 1.0, 0.0};
  auto& end_face = scene.params<Fixed>().emplace_back();
  end_face.side = "right", end_face.within = 1e-9;
  return scene;
}

Model bar() {
  return make_five_tet_box({0.08, 0.02, 0.02}, {8, 2, 2}, bar_material);
}

// Of the displacements of a mesh that has all vertices of another, those.
Displacement at_vertices_of(const Model& model, const Model& fine, const Displacement& u) {
  Displacement found;
  for (const auto& x : model.rest) {
    const auto same =
        std::ranges::find_if(fine.rest, [&x](const Vec3<double>& y) { return norm(x - y) < 1e-9; });
    found.push_back(u[same - fine.rest.begin()]);
  }
  return found;
}

TEST(ErrorBar, OfABentBarIsNoLessThanTheTrueErrorAndAtMostThreeTimesAsMuch) {
  const Model model = bar();
  const Model fine = cut_in_eight(model);
  const Displacement truth = equilibrium(fine, held_scene(false), 2).u;
  for (const bool smoothed : {false, true}) {
    const Scene scene = held_scene(smoothed);
    const State end = equilibrium(model, scene, 1);
    const std::vector<Probe> centroid = {probe_of_centroid(model, "body", 0)};
    const ErrorBar bar = error_bar(
        model, scene, end, 1, [] {}, centroid);
    ASSERT_EQ(bar.unknown, "");
    const double found = off(model, end.u, truth);
    EXPECT_GT(found, 0.03 * bar.size) << "a coarse bar has an error to find";
    EXPECT_GE(bar.displacement.total, found) << smoothed;
    EXPECT_LE(bar.displacement.total, 3.0 * found) << smoothed;
    EXPECT_LT(bar.displacement.solver, 1e-3 * bar.size);
    ASSERT_EQ(bar.probes.size(), 1u);
    EXPECT_GT(bar.probes[0].total, 0.0);
    EXPECT_LT(bar.probes[0].total, bar.displacement.total + bar.largest);
    EXPECT_GE(bar.largest, bar.displacement.element);
    double most = 0.0;
    for (const auto& u : end.u) most = std::max(most, norm(u));
    EXPECT_LT(bar.largest, 0.9 * most) << "of differences, not of sums";
  }
}

TEST(TetsFor, TakesTheMeshPartsToWhatTheOthersLeaveOfTheAim) {
  const ErrorParts parts{
      .solver = 1e-4, .element = 2e-3, .mesh = 1e-3, .support = 1e-4, .total = 3.2e-3};
  const double aim = 1.9e-3;  // 1.7e-3 for element and mesh, less a tenth: 1.53e-3 of 3e-3
  const auto next = tets_for(aim, parts, 10000, 100000);
  ASSERT_TRUE(next);
  EXPECT_NEAR(static_cast<double>(*next), 10000 * std::pow(3.0 / 1.53, 1.5), 1.0);
  EXPECT_EQ(tets_for(3.1e-3, parts, 10000, 100000), 12500u) << "at least a quarter more";
  EXPECT_EQ(tets_for(4e-4, parts, 10000, 1000000), 40000u) << "at most four times as many";
  EXPECT_NEAR(static_cast<double>(*tets_for(4e-4, parts, 10000, 22000)), 20000, 1.0)
      << "a mesh may have a tenth more than it is to have";
  EXPECT_FALSE(tets_for(aim, parts, 10000, 12000)) << "hardly more are allowed";
  EXPECT_FALSE(tets_for(2e-4, parts, 10000, 100000)) << "solver and support alone are as much";
  ErrorParts far = parts;
  far.surface = 5e-4;
  EXPECT_GT(tets_for(aim, far, 10000, 100000), next) << "less is left for element and mesh";
}

// Linear tets alone have these laws beside quadratic ones: most of the bar is the element's part.
template <class Law>
void check_bar_of_law(const typename Law::Params& params) {
  const Model model = bar();
  Scene scene = held_scene(false);
  scene.params<NeoHookean>().clear();
  scene.params<Law>().push_back(params);
  const Displacement truth = equilibrium(cut_in_eight(model), scene, 2).u;
  const State end = equilibrium(model, scene, 1);
  const ErrorBar bar = error_bar(model, scene, end, 1, [] {});
  ASSERT_EQ(bar.unknown, "") << Law::name;
  const double found = off(model, end.u, truth);
  EXPECT_GT(found, 0.1 * bar.size) << Law::name;
  EXPECT_GE(bar.displacement.total, found) << Law::name;
  EXPECT_LE(bar.displacement.total, 1.5 * found) << Law::name;
  EXPECT_GT(bar.displacement.element, 0.7 * found) << Law::name;
  EXPECT_EQ(bar.sizes.size(), model.tet_count());
}

TEST(ErrorBar, KnowsOtherLawsToo) {
  check_bar_of_law<MooneyRivlin>({0.3});
  check_bar_of_law<Ogden>({-4.7});
  check_bar_of_law<Linear>({});
  check_bar_of_law<StVK>({});
}

// A bar that is held at one end and bent: stresses grow without bound along the edges of that end,
// and its other end has none. The sizes ask for about as many tets as there are.
TEST(WantedSizes, AreSmallAtTheEdgesOfASupportAndLargeWhereThereIsNoStress) {
  const Model model = make_five_tet_box({0.08, 0.02, 0.02}, {32, 8, 8}, bar_material);
  const Scene scene = held_scene(true);
  const ErrorBar bar = error_bar(model, scene, equilibrium(model, scene, 1), 1, [] {});
  ASSERT_EQ(bar.sizes.size(), model.tet_count());
  double at_support = 0.0, at_edges = 0.0, at_end = 1e9, cells = 0.0;
  int near_support = 0, near_edges = 0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    Vec3<double> middle;
    for (const int v : model.tets[t]) middle += 0.25 * model.rest[v];
    const double from_support = middle.x + 0.04;  // the right is the lower x
    const double from_side = 0.01 - std::max(std::abs(middle.y), std::abs(middle.z));
    if (from_support < 0.0025) {
      (from_side < 0.0025 ? at_edges : at_support) += bar.sizes[t];
      ++(from_side < 0.0025 ? near_edges : near_support);
    }
    if (from_support > 0.07) at_end = std::min(at_end, bar.sizes[t]);
    cells += std::pow(bar.sizes[t], -3.0) / static_cast<double>(model.tet_count());
  }
  EXPECT_LT(at_edges / near_edges, 0.8 * at_support / near_support);
  EXPECT_LT(at_edges / near_edges, 0.5 * at_end);
  EXPECT_NEAR(cells, 1.0, 0.3);
}

// Linear tets lock there and quadratic ones do not, so that their difference says nothing of these.
TEST(ErrorBar, OfNearlyIncompressibleTissueDoesNotGrowAsLinearTetsLock) {
  const auto bar_at = [](double poisson_ratio, double& found) {
    Model model = bar();
    for (Material& one : model.materials) one.poisson_ratio = poisson_ratio;
    Scene scene = held_scene(false);
    const Displacement truth = equilibrium(cut_in_eight(model), scene, 2).u;
    set_element(scene.effects, Element::smoothed, poisson_ratio);
    const State end = equilibrium(model, scene, 1);
    const ErrorBar bar = error_bar(model, scene, end, 1, [] {});
    EXPECT_EQ(bar.unknown, "");
    found = off(model, end.u, truth);
    return bar;
  };
  double found = 0.0, at_45 = 0.0;
  const ErrorBar far = bar_at(0.45, at_45);
  for (const double poisson_ratio : {0.47, 0.49, 0.495}) {
    const ErrorBar near = bar_at(poisson_ratio, found);
    EXPECT_GE(near.displacement.total, found) << poisson_ratio;
    EXPECT_LE(near.displacement.mesh / near.size, 1.1 * far.displacement.mesh / far.size)
        << poisson_ratio;
  }
}

// Held to where no vertices are, of cells of 10 mm: what that costs is known from cells of 2.5 mm.
// As elements are too stiff and the support too short, the whole error may be less than either.
TEST(ErrorBar, HasAPartForASupportThatEndsBetweenVertices) {
  const Model model = bar();
  const Model fine = make_five_tet_box({0.08, 0.02, 0.02}, {32, 8, 8}, bar_material);
  const auto truth_held_to = [&](double within) {
    Scene scene = held_scene(false);
    scene.params<Fixed>().front().within = within + 1e-9;
    return at_vertices_of(model, fine, equilibrium(fine, scene, 2).u);
  };
  const Displacement to_vertices = truth_held_to(0.01);
  for (const double within : {0.0125, 0.0175}) {
    Scene scene = held_scene(true);
    scene.params<Fixed>().front().within = within + 1e-9;
    const State end = equilibrium(model, scene, 1);
    const ErrorBar bar = error_bar(model, scene, end, 1, [] {});
    ASSERT_EQ(bar.unknown, "");
    const Displacement truth = truth_held_to(within);
    const double costs = off(model, to_vertices, truth);
    EXPECT_GT(costs, 0.05 * bar.size);
    EXPECT_GE(bar.displacement.support, 0.9 * costs) << within;
    EXPECT_LE(bar.displacement.support, 2.0 * costs) << within;
    EXPECT_GE(bar.displacement.total, off(model, end.u, truth)) << within;
  }
}

// Hung on springs over a strip of its surface that ends where no vertices are.
TEST(ErrorBar, HasAPartForABedOfSpringsThatEndsBetweenVertices) {
  const Model model = bar(), fine = make_five_tet_box({0.08, 0.02, 0.02}, {32, 8, 8}, bar_material);
  Scene scene = held_scene(true);
  scene.params<Fixed>().clear();
  auto& bed = scene.params<Spring>().emplace_back();
  bed.side = "right", bed.stiffness = 1e7;
  const auto rest_on_strip = [&](double within) {
    bed.within = within + 1e-9;
    return equilibrium(model, scene, 1);
  };
  const auto parts_of = [&](const State& end) {
    return error_bar(model, scene, end, 1, [] {}).displacement;
  };
  EXPECT_EQ(parts_of(rest_on_strip(0.02)).support, 0.0) << "it ends at vertices";
  const auto truth_of_strip = [&](double within) {
    bed.within = within + 1e-9;
    const Scene exact = with_element(Element::quadratic, bar_material.poisson_ratio, scene);
    return at_vertices_of(model, fine, equilibrium(fine, exact, 2).u);
  };
  const Displacement truth = truth_of_strip(0.0175);
  const double costs = off(model, truth_of_strip(0.01), truth);  // as far as whole faces reach
  const State end = rest_on_strip(0.0175);
  const ErrorParts parts = parts_of(end);
  EXPECT_GE(parts.support, 0.9 * costs);
  EXPECT_LE(parts.support, 2.0 * costs);
  EXPECT_GE(parts.total, off(model, end.u, truth));
}

TEST(ErrorBar, SaysWhereNothingButFrictionHoldsABody) {
  const Model model = bar();
  Scene scene = held_scene(true);
  scene.params<Ground>().emplace_back();
  EXPECT_EQ(friction_in(model, scene), Friction::beside_supports) << "its end face is held";
  scene.params<Fixed>().clear();
  EXPECT_EQ(friction_in(model, scene), Friction::alone);
  scene.params<Ground>().front().friction = 0.0;
  EXPECT_EQ(friction_in(model, scene), Friction::none);
}

// Fewer vertices than a cell's: what is there beyond is looked at instead.
TEST(ErrorBar, OfASupportThatIsThinnerThanACellCountsWhatLiesBeyond) {
  const Model model = bar();
  Scene scene = held_scene(true);
  scene.params<Fixed>().front().within = 0.004;
  const ErrorBar bar = error_bar(model, scene, equilibrium(model, scene, 1), 1, [] {});
  ASSERT_EQ(bar.unknown, "");
  EXPECT_GT(bar.displacement.support, 0.05 * bar.size);
  scene.params<Fixed>().front().within = 1e-9;
  const ErrorBar face = error_bar(model, scene, equilibrium(model, scene, 1), 1, [] {});
  EXPECT_LT(face.displacement.support, 1e-6 * face.size);
}

// What labels have that end so much beyond the faces across an axis, and no farther along the
// others: [tets] m3.
std::vector<double> missing_across(const Model& model, int axis, double distance) {
  std::vector<double> missing(model.tet_count());
  for (const TetFace& face : tet_faces(model)) {
    const Vec3<double> out = area_vector(model, face.vertices);
    const double along = std::abs(axis == 1 ? out.y : out.z);
    if (face.other < 0 && along > 0.5 * norm(out)) missing[face.tet] += distance * along;
  }
  return missing;
}

// A bar that is thicker in the plane in which its weight bends it is stiffer; one that is wider has
// more weight and as much more stiffness.
TEST(ErrorBar, HasAPartForASurfaceThatIsNotWhereTheLabelsEnd) {
  const Model model = make_five_tet_box({0.08, 0.02, 0.02}, {24, 6, 6}, bar_material);
  const Scene scene = held_scene(true);
  const State end = equilibrium(model, scene, 1);
  const ErrorBar unaware = error_bar(model, scene, end, 1, [] {});
  EXPECT_NE(unaware.surface_unknown, "");
  EXPECT_EQ(unaware.displacement.surface, 0.0);
  const Scene plain = held_scene(false);
  const auto of_bar = [&](double thicker_by) {
    return equilibrium(
               make_five_tet_box({0.08, 0.02 + 2.0 * thicker_by, 0.02}, {24, 6, 6}, bar_material),
               plain, 2)
        .u;
  };
  constexpr double distance = 1e-4;
  const double differs = 0.5 * off(model, of_bar(distance), of_bar(-distance));
  EXPECT_GT(differs, 0.01 * unaware.size);
  const ErrorBar bar = error_bar(
      model, scene, end, 1, [] {}, {}, missing_across(model, 1, -distance));
  ASSERT_EQ(bar.unknown, "");
  EXPECT_EQ(bar.surface_unknown, "");
  EXPECT_NEAR(bar.displacement.surface, differs, 0.05 * differs);
  EXPECT_NEAR(bar.displacement.total - unaware.displacement.total, bar.displacement.surface, 1e-9);
  const ErrorBar wider = error_bar(
      model, scene, end, 1, [] {}, {}, missing_across(model, 2, distance));
  EXPECT_LT(wider.displacement.surface, 0.05 * differs);
}

TEST(ErrorBar, GivesTheSolverWhatTheRunIsOffTheEquilibriumOfItsOwnElements) {
  const Model model = bar();
  const Scene scene = held_scene(true);
  State end = equilibrium(model, scene, 1);
  const ErrorBar before = error_bar(model, scene, end, 1, [] {});
  const Vec3<double> shift{0.0, 0.0, 2e-4};
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    if (model.rest[i].x > -0.04 + 1e-9) end.u[i] += shift;
  }
  const ErrorBar after = error_bar(model, scene, end, 1, [] {});
  ASSERT_EQ(after.unknown, "");
  EXPECT_NEAR(after.displacement.solver, norm(shift), 0.1 * norm(shift));
  EXPECT_NEAR(after.displacement.element, before.displacement.element,
              1e-3 * before.displacement.element);
  EXPECT_NEAR(after.displacement.mesh, before.displacement.mesh, 1e-3 * before.displacement.mesh);
}

TEST(ErrorBar, OfARunOfQuadraticTetsIsWhatTheMeshLeaves) {
  const Model model = bar();
  const Scene scene = held_scene(false);
  const ErrorBar bar = error_bar(model, scene, equilibrium(model, scene, 2), 2, [] {});
  ASSERT_EQ(bar.unknown, "");
  EXPECT_LT(bar.displacement.solver, 1e-3 * bar.size);
  EXPECT_EQ(bar.displacement.element, 0.0);
  EXPECT_GT(bar.displacement.mesh, 0.0);
}

TEST(ErrorBar, CountsTetsThatThePolicyGaveAnotherLawAsTheTissuesOwn) {
  const Model model = bar();
  Scene switched = held_scene(false);
  std::vector<char> taken(model.tet_count(), 0);
  for (std::size_t t = 0; t < taken.size(); t += 2) taken[t] = 1;
  switched.params<NeoHookean>().front().taken = taken;
  switched.params<Corotational>().emplace_back().only = taken;
  const State end = equilibrium(model, held_scene(false), 1);
  const ErrorBar bar = error_bar(model, switched, end, 1, [] {});
  ASSERT_EQ(bar.unknown, "");
  EXPECT_LT(bar.displacement.solver, 1e-3 * bar.size);
}

TEST(ErrorBar, IsUnknownWithItsReasonWhereQuadraticTetsDoNotKnowTheScene) {
  const Model model = bar();
  Scene other = held_scene(false);
  other.params<NeoHookean>().clear();
  other.params<Corotational>().emplace_back();
  const State end = equilibrium(model, held_scene(false), 1);
  EXPECT_NE(error_bar(model, other, end, 1, [] {}).unknown.find("neo_hookean"), std::string::npos);
  Scene fibred = held_scene(false);
  fibred.params<Fibre>().push_back(sample_params<Fibre>());
  EXPECT_NE(error_bar(model, fibred, end, 1, [] {}).unknown.find("fibre"), std::string::npos);
}

// On a slope that friction holds the body on, without a hold: to a solver that begins without
// contact forces it slides away.
TEST(ErrorBar, OfABodyThatFrictionHoldsDoesNotCountASlideThatIsNotThere) {
  const Model model = make_five_tet_box({0.04, 0.04, 0.02}, {4, 4, 2}, bar_material);
  Scene scene;
  scene.params<NeoHookean>().emplace_back();
  scene.params<Viscosity>().emplace_back();
  scene.params<Gravity>().emplace_back();
  auto& slope = scene.params<Ground>().emplace_back();
  slope.normal = {0.2, 0.0, 1.0}, slope.clearance = 0.0, slope.friction = 0.5;
  scene.time.substeps = 64;
  const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
  for (int frame = 0; frame < 60; ++frame) solver->advance_frame();
  const ErrorBar bar = error_bar(model, scene, solver->state(), 1, [] {});
  ASSERT_EQ(bar.unknown, "");
  EXPECT_LT(bar.displacement.total, 2e-4) << "m: the body is 20 mm high and sinks by some .1 mm";
  EXPECT_LT(bar.displacement.solver, 2e-5);
}

TEST(ErrorBar, IsUnknownWhereNothingHoldsTheBody) {
  const Model model = bar();
  Scene scene = held_scene(false);
  scene.params<Fixed>().clear();
  State end{Displacement(model.vertex_count()), Displacement(model.vertex_count()), 10};
  EXPECT_NE(error_bar(model, scene, end, 1, [] {}).unknown, "");
}

}  // namespace
}  // namespace viscera::sim
