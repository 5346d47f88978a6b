// What a hand does to the body, frame by frame and to the bit.
#include <regex>

#include "pipeline/base/error.hpp"
#include "tests/live/live_run.hpp"

namespace viscera::live {
namespace {

void advance(World& world, int frames) {
  for (int frame = 0; frame < frames; ++frame) world.advance();
}

Error refusal_of(World& world, const Command& command) {
  try {
    world.apply(command);
  } catch (const Error& error) {
    return error;
  }
  ADD_FAILURE() << "taken: " << to_json(command);
  return Error(ExitCode::internal, {});
}

TEST_F(Live, ADragMovesTheBodyInTheFrameThatFollows) {
  const auto world = make_world(), left_alone = make_world();
  const int corner = top_corner(*world);
  world->apply(Grab{corner});
  world->apply(Drag{{0.0, 0.0, 30.0}});
  advance(*world, 1), advance(*left_alone, 1);
  const double lead = world->state().u[corner].z - left_alone->state().u[corner].z;
  EXPECT_GT(lead, 1e-3);
  advance(*world, 30), advance(*left_alone, 30);
  EXPECT_GT(world->state().u[corner].z, 0.02) << "it is held up";
  EXPECT_LT(left_alone->state().u[corner].z, -0.003);
  world->apply(Release{});
  advance(*world, 60);
  EXPECT_LT(world->state().u[corner].z, 0.0) << "it falls";
}

TEST_F(Live, AHandThatHoldsTheBodyUpPullsWithItsWeight) {
  const auto world = make_world();
  EXPECT_EQ(norm(world->pull(world->state())), 0.0);
  world->apply(Grab{top_corner(*world)});
  world->apply(Drag{{0.0, 0.0, 60.0}});
  advance(*world, 400);
  double weight = 0.0;
  for (const double m : world->body().mass) weight += 9.80665 * m;
  const Point pull = world->pull(world->state());
  EXPECT_NEAR(pull.z, weight, 0.01 * weight);
  EXPECT_NEAR(std::hypot(pull.x, pull.y), 0.0, 0.01 * weight);
  world->apply(Release{});
  EXPECT_EQ(norm(world->pull(world->state())), 0.0);
}

TEST_F(Live, ABodyThatIsGrabbedWhereItLiesStaysThere) {
  const auto world = make_world();
  advance(*world, 120);
  const int corner = top_corner(*world);
  const Point before = world->state().u[corner];
  world->apply(Grab{corner});
  advance(*world, 10);
  EXPECT_LT(norm(world->state().u[corner] - before), 1e-3);
}

TEST_F(Live, ATurnedBodyIsNotTurnedBackByTheHand) {
  const auto world = make_world(with(live_scene, "  gravity:\n", ""));
  sim::State turned = world->state();
  const auto& rest = world->body().rest;
  for (std::size_t i = 0; i < rest.size(); ++i) {
    turned.u[i] = Point{-rest[i].y, rest[i].x, rest[i].z} - rest[i];  // a quarter turn about z
  }
  world->go_back_to(turned, 0);
  world->apply(Grab{top_corner(*world)});
  advance(*world, 30);
  const sim::State now = world->state();
  for (std::size_t i = 0; i < rest.size(); ++i) EXPECT_LT(norm(now.u[i] - turned.u[i]), 1e-4) << i;
}

TEST_F(Live, AToolPressesTheBodyAndAppearsOnlyBesideIt) {
  const auto world = make_world();
  advance(*world, 60);
  const Point center = 1e3 * world->body().origin;
  const double radius = 1e3 * world->hand().tool_radius;
  const Error inside = refusal_of(*world, MoveTool{center});
  EXPECT_EQ(inside.problem().field, "tool");
  EXPECT_FALSE(world->hand().has_tool);
  world->apply(MoveTool{center + Point{0.0, 0.0, 30.0 + radius}});
  for (int frame = 1; frame <= 20; ++frame) {
    world->apply(MoveTool{center + Point{0.0, 0.0, 30.0 + radius - frame}});
    world->advance();
  }
  const sim::State pressed = world->state();
  const double bottom_of_ball = world->hand().tool.z - world->hand().tool_radius;
  double highest = -1.0, nearest = 1.0;
  for (std::size_t i = 0; i < pressed.u.size(); ++i) {
    const Point at = world->body().origin + world->body().rest[i] + pressed.u[i];
    highest = std::max(highest, at.z);
    nearest = std::min(nearest, norm(at - world->hand().tool));
  }
  EXPECT_GT(highest, bottom_of_ball) << "flesh rises around it";
  EXPECT_GT(nearest, 0.74 * world->hand().tool_radius) << "and never goes through";
  EXPECT_EQ(world->setting()->scene.params<sim::Collider<sim::Sphere>>().size(), 1u);
  world->apply(LiftTool{});
  EXPECT_TRUE(world->setting()->scene.params<sim::Collider<sim::Sphere>>().empty())
      << "a tool that is away costs nothing";
  advance(*world, 90);
  EXPECT_GT(diagnose(world->body(), world->setting()->scene, world->state()).volume_ratio, 0.97);
}

// 1.67 m a frame, to and fro.
TEST_F(Live, AToolThroughTheBodyAtAHundredMetresPerSecondLeavesFiniteNumbers) {
  const auto world = make_world();
  const Point center = 1e3 * world->body().origin;
  const double far = 0.5 * 1e3 * 100.0 / 60.0;
  for (int pass = 0; pass <= 6; ++pass) {
    world->apply(MoveTool{center + Point{pass % 2 == 0 ? -far : far, 1.0 * pass, 0.0}});
    world->advance();
    EXPECT_TRUE(world->state().finite()) << pass;
  }
  world->apply(LiftTool{});
  advance(*world, 180);
  EXPECT_TRUE(world->state().finite());
}

TEST_F(Live, AToolFasterThanAnyIsRefused) {
  const auto world = make_world();
  world->apply(MoveTool{{0.0, 0.0, 1000.0}});
  EXPECT_EQ(refusal_of(*world, MoveTool{{0.0, 0.0, 1e5}}).problem().field, "tool");
  EXPECT_EQ(refusal_of(*world, MoveTool{{0.0, 0.0, std::nan("")}}).problem().field, "tool");
}

TEST_F(Live, AStiffnessActsAtOnceAndOnARunThatGoesOn) {
  const auto soft = make_world(), stiff = make_world();
  advance(*soft, 20), advance(*stiff, 20);
  stiff->apply(Change{{{"materials.liver.E", "10 kPa"}}});
  EXPECT_EQ(soft->state().hash(), stiff->state().hash()) << "a change by itself moves nothing";
  EXPECT_EQ(stiff->setting()->materials[0].youngs_modulus, 1e4);
  advance(*soft, 1), advance(*stiff, 1);
  EXPECT_NE(soft->state().hash(), stiff->state().hash());
  advance(*soft, 90), advance(*stiff, 90);
  const auto sag = [](const World& world) {
    return diagnose(world.body(), world.setting()->scene, world.state()).elastic;
  };
  EXPECT_GT(sag(*soft), 1.5 * sag(*stiff));
}

// Groups of tets come with it, as in a run that begins so.
TEST_F(Live, ANuNearerToOneHalfThanTheStartsGivesTheBodyThatBeginsWithIt) {
  const std::string soft = std::regex_replace(live_scene, std::regex("nu: 0.45"), "nu: 0.4");
  const auto changed = make_world(soft);
  changed->apply(Change{{{"materials.liver.nu", 0.49}}});
  const auto begun = make_world(std::regex_replace(live_scene, std::regex("nu: 0.45"), "nu: 0.49"));
  EXPECT_TRUE(changed->setting()->scene.has<sim::GroupedVolume>());
  advance(*changed, 20), advance(*begun, 20);
  for (std::size_t v = 0; v < begun->state().u.size(); ++v)
    EXPECT_LT(norm(changed->state().u[v] - begun->state().u[v]), 1e-6) << v;
}

TEST_F(Live, WhatIsOnItsWayGoesOnFromWhereItIsWhenAHandChangesIt) {
  const std::string led = std::regex_replace(live_scene, std::regex("ground: .*"),
                                             "prescribed: {side: superior, within: 1 mm, "
                                             "displacement: [0 mm, 0 mm, 10 mm], duration: 1 s}");
  const auto world = make_world(led);
  const int corner = top_corner(*world);
  advance(*world, 15);
  const double before = world->state().u[corner].z;
  EXPECT_NEAR(before, 0.0025, 0.0025);
  world->apply(Change{{{"effects.prescribed.displacement", Json{"0 mm", "0 mm", "30 mm"}}}});
  advance(*world, 1);
  EXPECT_NEAR(world->state().u[corner].z, before, 6e-4);
  world->apply(Change{{{"effects.prescribed.displacement", Json{"0 mm", "0 mm", "30 mm"}},
                       {"materials.liver.E", "6 kPa"}}});
  advance(*world, 70);
  EXPECT_NEAR(world->state().u[corner].z, 0.03, 1e-5);
}

TEST_F(Live, ValuesOutOfRangeAreRefusedByNameAndChangeNothing) {
  const auto world = make_world(), left_alone = make_world();
  advance(*world, 3), advance(*left_alone, 3);
  const std::vector<std::pair<const char*, Json>> bad = {{"materials.liver.nu", 0.5},
                                                         {"materials.liver.E", "-1 kPa"},
                                                         {"materials.liver.E", "5 mm"},
                                                         {"materials.spleen.E", "5 kPa"},
                                                         {"materials.liver.density", "500 kg/m3"},
                                                         {"effects.ground.friction", -0.1}};
  for (const auto& [name, value] : bad) {
    const Problem problem = refusal_of(*world, Change{{{name, value}}}).problem();
    EXPECT_FALSE(problem.field.empty()) << name;
    EXPECT_FALSE(problem.allowed.empty()) << name;
    EXPECT_TRUE(world->setting()->changes.empty()) << name;
  }
  EXPECT_EQ(refusal_of(*world, Grab{100000}).problem().field, "grab");
  EXPECT_EQ(refusal_of(*world, Grab{-1}).problem().field, "grab");
  world->apply(Grab{0});
  EXPECT_EQ(refusal_of(*world, Drag{{std::nan(""), 0, 0}}).problem().field, "effects.grip.offset");
  world->apply(Reset{});
  left_alone->apply(Drop{});
  advance(*world, 3), advance(*left_alone, 3);
  EXPECT_EQ(world->state().hash(), left_alone->state().hash());
}

TEST_F(Live, ResetGivesTheInitialBitsWhateverWasDone) {
  const auto world = make_world();
  std::vector<std::uint64_t> hashes;
  for (int frame = 0; frame < 5; ++frame) {
    hashes.push_back(world->state().hash());
    world->advance();
  }
  world->apply(Change{{{"materials.liver.E", "9 kPa"}, {"effects.ground.friction", 0.9}}});
  world->apply(MoveTool{1e3 * world->body().origin + Point{0.0, 0.0, 60.0}});
  world->apply(Grab{top_corner(*world)});
  world->apply(Drag{{20.0, 0.0, 5.0}});
  advance(*world, 10);
  world->apply(Reset{});
  EXPECT_TRUE(world->setting()->changes.empty());
  EXPECT_FALSE(world->hand().holds || world->hand().has_tool);
  for (const std::uint64_t hash : hashes) {
    EXPECT_EQ(world->state().hash(), hash);
    world->advance();
  }
}

TEST_F(Live, DropAgainStartsAnewWithTheValuesAsTheyAre) {
  const auto world = make_world();
  const auto start = world->state().hash();
  world->apply(Change{{{"materials.liver.E", "9 kPa"}}});
  advance(*world, 10);
  world->apply(Drop{});
  EXPECT_EQ(world->state().hash(), start);
  EXPECT_EQ(world->time_s(), 0.0);
  EXPECT_EQ(world->setting()->materials[0].youngs_modulus, 9e3);
}

// A stiffness that the substeps do not bear: more of them, and the motion goes on.
TEST_F(Live, SubstepsAreRaisedAloudWhereAStiffnessNeedsThem) {
  const auto world = make_world();
  advance(*world, 20);
  const Point before = world->state().u[0];
  const int substeps = world->setting()->scene.time.substeps;
  world->apply(Change{{{"materials.liver.E", "2000 kPa"}}});
  EXPECT_GT(world->setting()->scene.time.substeps, substeps);
  EXPECT_EQ(world->state().u[0], before);
  EXPECT_DOUBLE_EQ(world->time_s(), 20.0 / 60.0);
  advance(*world, 2);
  EXPECT_TRUE(world->state().finite());
  EXPECT_GT(world->seconds().at("smoothed_neo_hookean"), 0.0);
  world->apply(Reset{});
  EXPECT_EQ(world->setting()->scene.time.substeps, substeps);
}

TEST_F(Live, ThePolicyOfTheSceneDecidesAboutSubsteps) {
  const auto refuses = make_world(std::string(live_scene) + "stability: refuse\n");
  const Error error = refusal_of(*refuses, Change{{{"materials.liver.E", "2000 kPa"}}});
  EXPECT_EQ(error.problem().field, "time.substeps");
  const auto warns = make_world(std::string(live_scene) + "stability: warn\n");
  warns->apply(Change{{{"materials.liver.E", "2000 kPa"}}});
  EXPECT_GT(warns->setting()->stability.limit.value, warns->setting()->stability.limit.at_most);
}

TEST_F(Live, EveryMethodIsTakenInTheHand) {
  for (const char* method : {"xpbd", "fem", "tled"}) {
    const bool implicit = method == std::string("fem");
    const auto world = make_world(
        live_scene, {std::string("solver=") + method, implicit ? "substeps=8" : "substeps=64"});
    const int corner = top_corner(*world);
    world->apply(Grab{corner});
    world->apply(Drag{{0.0, 0.0, 30.0}});
    advance(*world, 20);
    EXPECT_GT(world->state().u[corner].z, 0.015) << method;
  }
}

}  // namespace
}  // namespace viscera::live
