// Shape matching: the rotation it finds, that rigid motion costs nothing, and what its stiffness
// means.
#include <gtest/gtest.h>

#include <map>

#include "sim/base/best_rotation.hpp"
#include "sim/model/regions.hpp"
#include "tests/sim/measures/two_cubes.hpp"

namespace viscera::sim {
namespace {

Quaternion<double> rotation_about(const Vec3<double>& axis, double angle) {
  return {std::cos(0.5 * angle), (std::sin(0.5 * angle) / norm(axis)) * axis};
}
Mat3<double> matrix_of(const Quaternion<double>& q) {
  const auto image = [&q](const Vec3<double>& e) { return e + turn(q, e); };
  return {{image({1, 0, 0}), image({0, 1, 0}), image({0, 0, 1})}};
}
double distance(const Mat3<double>& a, const Mat3<double>& b) {
  return std::sqrt(squared_norm(a - b));
}

TEST(Rotation, IsThePolarFactorWhateverTheAngleAndTheStretch) {
  std::mt19937 generator(4);
  for (const double angle : {0.0, 1e-12, 1e-6, 0.3, 2.0, 3.0, M_PI - 1e-9, M_PI}) {
    for (int sample = 0; sample < 20; ++sample) {
      const Mat3<double> r = matrix_of(rotation_about(random_vector(generator, 1.0), angle));
      const Mat3<double> root{{random_vector(generator, 1.0), random_vector(generator, 1.0),
                               random_vector(generator, 1.0)}};
      const Mat3<double> stretch = plus_identity(0.1, transpose(root) * root);
      EXPECT_LT(distance(matrix_of(best_rotation(r * stretch)), r), 1e-13) << angle;
    }
  }
}

TEST(Rotation, OfASymmetricMatrixIsTheIdentityToTheBitAndOfACollapseProper) {
  const Quaternion<double> q = best_rotation({{{2, 0.3, 0.1}, {0.3, 1, 0.2}, {0.1, 0.2, 3}}});
  EXPECT_EQ(q.w, 1.0);
  EXPECT_EQ(norm(q.v), 0.0);
  const Mat3<double> collapsed[] = {{{{1, 0, 0}, {0, 1, 0}, {0, 0, -1}}},  // mirrored
                                    {{{1, 0, 0}, {0, 1, 0}, {0, 0, 0}}},   // a plane
                                    {{{1, 0, 0}, {1, 0, 0}, {1, 0, 0}}},   // a line
                                    {}};                                   // a point
  for (const auto& m : collapsed) {
    EXPECT_NEAR(det(matrix_of(best_rotation(m))), 1.0, 1e-14);
  }
}

Scene matching_scene(const char* regions = "body") {
  Scene scene;
  auto& params = scene.params<ShapeMatching>().emplace_back();
  params.regions = regions;
  params.tets = 60.0;
  return scene;
}

TEST(ShapeMatching, RegionsAreOfTetsThatHangTogether) {
  const Model two = two_cubes(1), one = make_cube(2);
  for (const char* const regions : {"body", "label", "blocks"}) {
    const auto region = ShapeMatching::regions(two, {regions, 1000.0});
    for (std::size_t t = 0; t < region.size(); ++t)
      EXPECT_EQ(region[t], t < one.tet_count() ? 0 : 1) << regions << " " << t;
  }
  for (const int region : ShapeMatching::regions(one, {"body", 200.0})) EXPECT_EQ(region, 0);
}

State at_rest(const Model& model) {
  return {std::vector<Vec3<double>>(model.vertex_count()),
          std::vector<Vec3<double>>(model.vertex_count())};
}

double largest(const std::vector<Vec3<double>>& field) {
  double size = 0.0;
  for (const auto& a : field) size = std::max(size, norm(a));
  return size;
}

TEST(ShapeMatching, RigidMotionCostsNothing) {
  const Model model = make_cube(4);
  for (const char* regions : {"body", "blocks"}) {
    for (const auto& [precision, limit] :
         {std::pair{Precision::fp64, 1e-12}, std::pair{Precision::fp32, 2e-6}}) {
      for (const double angle : {0.0, 0.7, M_PI}) {
        const Quaternion<double> q = rotation_about({1.0, 2.0, -0.5}, angle);
        State start = at_rest(model);
        for (std::size_t i = 0; i < model.vertex_count(); ++i) {
          start.u[i] = turn(q, model.rest[i]) + Vec3<double>{0.1, -0.2, 0.05};
        }
        const auto solver = make_on_cpu(model, matching_scene(regions), {.precision = precision});
        solver->set_state(start);
        for (int frame = 0; frame < 5; ++frame) solver->advance_frame();
        State end = solver->state();
        for (std::size_t i = 0; i < model.vertex_count(); ++i) end.u[i] -= start.u[i];
        EXPECT_LT(largest(end.u), limit) << regions << ", " << angle;
      }
    }
    const auto still = make_on_cpu(model, matching_scene(regions), {});
    for (int frame = 0; frame < 5; ++frame) still->advance_frame();
    EXPECT_EQ(largest(still->state().u), 0.0);
  }
}

// Angular momentum is kept as far as a step allows: what it is off by falls with dt.
TEST(ShapeMatching, KeepsLinearAndAngularMomentum) {
  const Model model = make_cube(4);
  for (const char* regions : {"body", "blocks"}) {
    std::vector<double> off;
    for (const int substeps : {64, 128}) {
      Scene scene = matching_scene(regions);
      scene.time.substeps = substeps;
      const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
      State start = at_rest(model);
      std::mt19937 generator(8);
      for (auto& u : start.u) u = random_vector(generator, 2e-3);
      for (auto& v : start.v) v = random_vector(generator, 0.1);
      solver->set_state(start);
      for (int frame = 0; frame < 10; ++frame) solver->advance_frame();
      Vec3<double> linear, angular, scale;
      for (const auto& [state, sign] : {std::pair{solver->state(), 1.0}, std::pair{start, -1.0}}) {
        for (std::size_t i = 0; i < model.vertex_count(); ++i) {
          const Vec3<double> p = (sign * model.mass[i]) * state.v[i];
          linear += p;
          angular += cross(model.rest[i] + state.u[i], p);
          scale.x += norm(p);
          scale.y += norm(cross(model.rest[i] + state.u[i], p));
        }
      }
      EXPECT_LT(norm(linear), 1e-13 * scale.x) << regions;
      off.push_back(norm(angular) / scale.y);
    }
    EXPECT_LT(off[1], 2e-3) << regions;
    EXPECT_LT(off[1], 0.6 * off[0]) << regions;
  }
}

TEST(ShapeMatching, AStretchedRegionRingsAtTheFrequencyOfItsShearStiffness) {
  const Model model = make_cube(6);
  Scene scene = matching_scene();
  scene.time.frame_s = 1e-4;
  scene.time.substeps = 8;
  const auto frequency = [&](Method method) {
    const auto solver = make_on_cpu(model, scene, {.method = method, .precision = Precision::fp64});
    State start = at_rest(model);
    for (std::size_t i = 0; i < model.vertex_count(); ++i) start.u[i].x = 0.01 * model.rest[i].x;
    solver->set_state(start);
    const std::size_t corner = model.vertex_count() - 1;
    int frame = 0;
    while (frame < 2000 && solver->state().u[corner].x > 0.0) {
      solver->advance_frame();
      ++frame;
    }
    return M_PI / 2.0 / ((frame - 0.5) * scene.time.frame_s);
  };
  // A cube of edge L: omega^2 = 6 mu V / (rho V L^2 / 4).
  const double l = 0.05, mu = lame(soft_tissue).mu;
  const Regions one(model, std::vector<int>(model.tet_count(), 0));
  const auto& [a, b, c] = one.regions.front().inertia.col;
  const double inertia = a.x + b.y + c.z;
  const double lumped = 1.0 + 2.0 / (6.0 * 6.0);  // masses at the corners of six cells an edge
  EXPECT_NEAR(inertia, lumped * soft_tissue.density * l * l * l * l * l / 4.0, 1e-9 * inertia);
  const double omega = std::sqrt(6.0 * mu * l * l * l / inertia);
  EXPECT_NEAR(frequency(Method::xpbd), omega, 0.02 * omega);
  EXPECT_NEAR(frequency(Method::tled), omega, 0.02 * omega);
}

TEST(ShapeMatching, ItsEnergyOfAHomogeneousStrainIsTheMaterials) {
  const Model model = make_cube(6);
  const Regions one(model, std::vector<int>(model.tet_count(), 0));
  const Region& region = one.regions.front();
  const auto& [a, b, c] = region.inertia.col;
  const double omega2 = ShapeMatching::squared_frequency(region.shear, a.x + b.y + c.z);
  const Mat3<double> strains[] = {{{{0, 0.01, 0}, {0.01, 0, 0}, {0, 0, 0}}},
                                  {{{0.02, 0, 0}, {0, -0.01, 0}, {0, 0, -0.01}}}};
  for (const auto& e : strains) {
    double stored = 0.0;
    for (const auto& member : one.members) {
      const Vec3<double> error = e * member.arm;
      stored += 0.5 * member.mass * omega2 * dot(error, error);
    }
    const double material = lame(soft_tissue).mu * 0.05 * 0.05 * 0.05 * squared_norm(e);
    EXPECT_NEAR(stored, material, 0.02 * material);
  }
}

// The largest relative change of length of an edge: 0 for the rest shape wherever it is.
double worst_edge(const Model& model, const State& state) {
  double worst = 0.0;
  for (const Tet& tet : model.tets) {
    for (int k = 1; k < 4; ++k) {
      const Vec3<double> rest = model.rest[tet[k]] - model.rest[tet[0]];
      const Vec3<double> now = rest + state.u[tet[k]] - state.u[tet[0]];
      worst = std::max(worst, std::abs(norm(now) / norm(rest) - 1.0));
    }
  }
  return worst;
}

TEST(ShapeMatching, AStretchedFlattenedAndMirroredBodyRecovers) {
  const Model model = make_cube(3);
  for (const Method method : {Method::xpbd, Method::pbd}) {
    for (const char* regions : {"body", "blocks"}) {
      for (const double stretch : {2.0, 0.01, -1.0}) {
        Scene scene = matching_scene(regions);
        scene.time.substeps = 2;  // implicit steps lose energy
        const auto solver = make_on_cpu(
            model, scene, {.method = method, .precision = Precision::fp64, .stiffness = 0.5});
        State start = at_rest(model);
        for (std::size_t i = 0; i < model.vertex_count(); ++i) {
          start.u[i].x = (stretch - 1.0) * model.rest[i].x;
        }
        solver->set_state(start);
        for (int frame = 0; frame < 240; ++frame) solver->advance_frame();
        const State end = solver->state();
        ASSERT_TRUE(end.finite());
        EXPECT_LT(worst_edge(model, end), 0.02) << regions << ", " << stretch;
      }
    }
  }
}

TEST(ShapeMatching, FullStiffnessInPbdRestoresTheShapeInOneStep) {
  const Model model = make_cube(3);
  Scene scene = matching_scene();
  scene.time.substeps = 1;
  const auto solver =
      make_on_cpu(model, scene, {.method = Method::pbd, .precision = Precision::fp64});
  State start = at_rest(model);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) start.u[i].x = 0.3 * model.rest[i].x;
  solver->set_state(start);
  solver->advance_frame();
  EXPECT_LT(worst_edge(model, solver->state()), 1e-13);
}

TEST(ShapeMatching, TheNumberOfThreadsAndARestartDoNotChangeABit) {
  const Model model = make_cube(6);
  for (const char* regions : {"body", "blocks"}) {
    for (const int iterations : {1, 3}) {
      Scene scene = drop_scene();
      scene.time.substeps = 16;
      scene.params<Ground>().front().clearance = 0.0;
      scene.params<ShapeMatching>() = matching_scene(regions).params<ShapeMatching>();
      std::uint64_t hash[3];
      for (int run = 0; run < 3; ++run) {
        const SolverOptions options = {
            .precision = Precision::fp32, .iterations = iterations, .threads = 1 + run % 2};
        auto solver = make_on_cpu(model, scene, options);
        for (int frame = 0; frame < 6; ++frame) {
          if (run == 2 && frame == 3) {
            const State so_far = solver->state();
            solver = make_on_cpu(model, scene, options);
            solver->set_state(so_far);
          }
          solver->advance_frame();
        }
        hash[run] = solver->state().hash();
      }
      EXPECT_EQ(hash[0], hash[1]);
      EXPECT_EQ(hash[0], hash[2]);
    }
  }
}

TEST(ShapeMatching, EveryTetIsInTheBlockOfItsPlaceWhicheverTetComesFirst) {
  Model model = make_cube(4);
  std::ranges::reverse(model.tets);
  const Blocks blocks(model, 60);
  const auto regions = ShapeMatching::regions(model, {.regions = "blocks", .tets = 60.0});
  ASSERT_EQ(regions.size(), model.tet_count());
  EXPECT_NE(regions.front(), regions.back());
  std::map<int, int> block_of_region;
  for (std::size_t t = 0; t < regions.size(); ++t) {
    const int block = blocks.block_of(model.tets[t]);
    EXPECT_EQ(block_of_region.try_emplace(regions[t], block).first->second, block) << t;
  }
  EXPECT_EQ(block_of_region.size(), static_cast<std::size_t>(blocks.count()));
}

TEST(ShapeMatching, SolversThatCannotDoItSaySo) {
  try {
    make_on_cpu(make_cube(1), matching_scene(), {.method = Method::fem});
    FAIL() << "made";
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.field, "effects.shape_matching");
  }
  EXPECT_THROW(make_on_cpu(make_cube(1), matching_scene("organs"), {}), Refusal);
}

TEST(ShapeMatching, EveryLabelIsARegionWhereItIsAskedForByLabel) {
  Model model = make_cube(2);
  for (std::size_t t = 0; t < model.tet_count(); ++t) model.material_of[t] = t % 3 == 0;
  const auto regions = ShapeMatching::regions(model, {.regions = "label"});
  EXPECT_EQ(regions, connected_parts(model, model.material_of));
  for (std::size_t t = 0; t < regions.size(); ++t)
    EXPECT_EQ(regions[t] == regions[0], model.material_of[t] == model.material_of[0]) << t;
}

}  // namespace
}  // namespace viscera::sim
