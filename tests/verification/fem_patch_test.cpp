// What a scene lays on a patch of the surface, under linear and quadratic tets: resultants and
// moments against closed forms, balance at rest, and that both orders have the same limit.
#include <gtest/gtest.h>

#include "sim/solvers/fem/effect.hpp"
#include "sim/solvers/fem/mesh.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

constexpr double edge = 0.1, bed_stiffness = 4e5;

struct Wrench {
  Vec3<double> force, moment;
};

// Of a patch effect's elements on nodes that are displaced by `u`, about the middle of the body.
template <class Effect, class Displacement>
Wrench wrench_of(const Model& model, int order, const typename Effect::Params& params,
                 Displacement&& u) {
  const FemMesh mesh(model, order);
  const Prepared<Effect, double> prepared(mesh.body(model), params, 1e-3);
  NodeField moved;
  for (const auto& x : mesh.rest) moved.push_back(u(x));
  FemForces forces(mesh.node_count());
  EffectTerm<Effect>(prepared, 1e-3)
      .add_forces({moved, NodeField(moved.size()), {1e-3, 0.0}}, forces);
  Wrench sum;
  for (std::size_t i = 0; i < mesh.node_count(); ++i) {
    sum.force += forces.sum[i];
    sum.moment += cross(mesh.rest[i], forces.sum[i]);
  }
  return sum;
}

Spring::Params bed_on(const char* side) {
  Spring::Params bed;
  bed.stiffness = bed_stiffness;
  bed.side = side;
  return bed;
}

TEST(FemPatch, ABedAnswersAShiftOrATurnWithItsForceAndMoment) {
  const Model model = make_box({edge, edge, edge}, {3, 2, 2}, soft_tissue);
  const Vec3<double> shift{1e-3, -2e-3, 3e-3};
  constexpr double area = edge * edge, angle = 1e-2;
  for (const int order : {1, 2}) {
    const auto shifted = wrench_of<Spring>(model, order, bed_on("superior"),
                                           [&](const Vec3<double>&) { return shift; });
    EXPECT_LT(norm(shifted.force + bed_stiffness * area * shift), 1e-12) << order;
    const Vec3<double> arm{0.0, 0.0, edge / 2};
    EXPECT_LT(norm(shifted.moment - cross(arm, shifted.force)), 1e-12) << order;
  }
  // About the patch's normal: k angle times the polar moment of a square, edge^4 / 6. A product of
  // two linear functions is beyond linear triangles' vertices, not beyond quadratic ones' edges.
  const auto turned = wrench_of<Spring>(model, 2, bed_on("superior"), [&](const Vec3<double>& x) {
    return angle * cross(Vec3<double>{0, 0, 1}, x);
  });
  const double expected = -bed_stiffness * angle * area * area / 6.0;
  EXPECT_LT(norm(turned.force), 1e-12);
  EXPECT_NEAR(turned.moment.z, expected, 1e-12 * std::abs(expected));
}

TEST(FemPatch, ALoadByAreaIsCarriedByTheMiddlesOfEdgesWhereTetsAreQuadratic) {
  const Model model = make_box({edge, edge, edge}, {3, 2, 2}, soft_tissue);
  Load::Params load;
  load.force = {0.1, 0.2, -0.3};
  load.side = "left";
  const auto loaded = Load::elements(FemMesh(model, 2).body(model), load);
  for (const auto& [node] : loaded) EXPECT_GE(node, static_cast<int>(model.vertex_count()));
  for (const int order : {1, 2}) {
    const auto sum =
        wrench_of<Load>(model, order, load, [](const Vec3<double>&) { return Vec3<double>{}; });
    EXPECT_LT(norm(sum.force - load.force), 1e-15) << order;
    EXPECT_LT(norm(sum.moment - cross(Vec3<double>{edge / 2, 0, 0}, load.force)), 1e-15) << order;
  }
}

SolverOptions equilibrium_of(int order) {
  SolverOptions options{.method = Method::fem};
  options.fem.time = FemOptions::Time::quasi_static;
  options.fem.tolerance = 1e-10;
  options.fem.order = order;
  return options;
}

// All nodes' displacements: those of midside nodes are what State::nodes begins with.
NodeField node_displacements(const State& state, const FemMesh& mesh) {
  NodeField u = state.u;
  for (std::size_t m = 0; m < mesh.parents.size(); ++m) {
    u.push_back({state.nodes[3 * m], state.nodes[3 * m + 1], state.nodes[3 * m + 2]});
  }
  return u;
}

struct Sag {
  double corner, middle;  // of the upper face, m
  double carried;         // by the bed, over the weight
};

// A block under its own weight, the bed under all of its lower face.
Sag sag_on_a_bed(int order, int cells) {
  Material soft = soft_tissue;
  soft.poisson_ratio = 0.3;  // linear tets do not lock
  const Model model = make_five_tet_box({edge, edge, edge / 2}, {cells, cells, cells / 2}, soft);
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  scene.params<Spring>().push_back(bed_on("inferior"));
  const auto solver = make_on_cpu(model, scene, equilibrium_of(order));
  solver->advance_frame();
  const FemMesh mesh(model, order);
  const NodeField u = node_displacements(solver->state(), mesh);
  const PatchNodes bed(mesh.body(model), select_faces(model, bed_on("inferior"), "spring"));
  Sag sag{};
  for (std::size_t e = 0; e < bed.size(); ++e) {
    sag.carried -= bed_stiffness * bed.area[e] * u[bed[e][0]].z;
  }
  sag.carried /= soft.density * edge * edge * edge / 2 * 9.80665;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const Vec3<double>& x = model.rest[i];
    if (x.z < edge / 4 - 1e-9) continue;
    if (std::min(x.x, x.y) > edge / 2 - 1e-9) sag.corner = u[i].z;
    if (std::hypot(x.x, x.y) < 1e-9) sag.middle = u[i].z;
  }
  return sag;
}

TEST(FemPatch, OnABedLinearAndQuadraticTetsHaveTheSameLimit) {
  const Sag coarse = sag_on_a_bed(1, 16), fine = sag_on_a_bed(1, 24);
  const Sag quadratic = sag_on_a_bed(2, 4), finer = sag_on_a_bed(2, 8);
  for (const Sag& sag : {coarse, fine, quadratic, finer}) EXPECT_NEAR(sag.carried, 1.0, 1e-8);
  for (const auto where : {&Sag::corner, &Sag::middle}) {
    // Richardson: linear tets err by h^2.
    const double limit =
        fine.*where + (fine.*where - coarse.*where) / (24.0 * 24.0 / (16.0 * 16.0) - 1.0);
    const auto off = [&](const Sag& sag) { return std::abs(sag.*where - limit); };
    EXPECT_LT(off(finer), 2e-3 * std::abs(limit));
    EXPECT_LT(off(finer), 0.5 * off(quadratic));
    EXPECT_LT(off(finer), 0.5 * off(coarse)) << "linear tets on as many nodes";
  }
}

TEST(FemPatch, QuadraticTetsRestOnTheGroundWithTheMiddlesOfTheirEdgesToo) {
  const Model model = make_cube(2);
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  scene.params<Ground>().emplace_back();
  scene.params<Ground>().front().clearance = 1e-3;
  scene.time.substeps = 1;
  SolverOptions options{.method = Method::fem};
  options.fem.time =
      FemOptions::Time::implicit_euler;  // which damps: quadratic tets have no viscosity
  options.fem.order = 2;
  const auto solver = make_on_cpu(model, scene, options);
  for (int frame = 0; frame < 60; ++frame) solver->advance_frame();
  const FemMesh mesh(model, 2);
  const State state = solver->state();
  const NodeField u = node_displacements(state, mesh);
  EXPECT_LT(diagnose(model, scene, state).max_speed, 1e-3);
  EXPECT_GT(solver->contact_count(), 9u) << "more than the vertices below";
  for (std::size_t i = 0; i < mesh.node_count(); ++i) {
    EXPECT_GE(mesh.rest[i].z + u[i].z, -0.025 - 1e-3 - 1e-8);
  }
}

}  // namespace
}  // namespace viscera::sim
