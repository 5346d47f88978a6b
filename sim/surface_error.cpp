#include "sim/surface_error.hpp"

#include "sim/equilibrium.hpp"
#include "sim/model/corner_gradients.hpp"
#include "sim/model/surface.hpp"
#include "sim/scene/elasticity.hpp"
#include "sim/solvers/fem/fem.hpp"
#include "sim/solvers/fem/mesh.hpp"

namespace viscera::sim {
namespace {

// How well the one linear system is solved.
constexpr double solved_to = 1e-8;

// The rule of three points on a triangle, exact to degree 2 (Hammer and Stroud 1956).
constexpr double own_share = 2.0 / 3.0, other_share = 1.0 / 6.0;

class Layer {
 public:
  Layer(const Model& model, const Scene& scene, const State& end)
      : model_(model), scene_(scene), mesh_(model, 2), u_(mesh_.displacements(end)) {
    for (const auto& gravity : scene.params<Gravity>()) gravity_ += Gravity::vector(gravity);
  }

  // Of what lies d beyond the faces of tets: [nodes] N. `missing` is [tets] m3.
  std::vector<Vec3<double>> forces(std::span<const double> missing) const {
    const auto faces = tet_faces(model_);
    std::vector<double> area(model_.tet_count());
    for (const TetFace& face : faces) {
      if (face.other < 0) area[face.tet] += norm(area_vector(model_, face.vertices));
    }
    std::vector<Vec3<double>> forces(mesh_.node_count());
    for (const TetFace& face : faces) {
      if (face.other >= 0 || missing[face.tet] == 0.0) continue;
      const double share = norm(area_vector(model_, face.vertices)) / area[face.tet];
      for (const int v : face.vertices) {
        add(face, v, share * missing[face.tet] / 3.0, forces);
      }
    }
    return forces;
  }

 private:
  // Adds those of so much tissue, m3, at the point of a face that is nearest to a vertex.
  void add(const TetFace& face, int vertex, double volume,
           std::vector<Vec3<double>>& forces) const {
    const Tet& tet = model_.tets[face.tet];
    std::array<double, 4> l{};
    for (int k = 0; k < 4; ++k) {
      if (std::ranges::count(face.vertices, tet[k]) > 0)
        l[k] = tet[k] == vertex ? own_share : other_share;
    }
    const auto& nodes = mesh_.quadratic[face.tet].nodes;
    const QuadraturePoint<10> point{
        quadratic_gradients(corner_gradients(model_.rest_inverse[face.tet]), l), volume};
    const std::array<double, 10> shapes = quadratic_shapes(l);
    const Mat3<double> h = gradient_at<10>(nodes, point, u_);
    // P = sigma cof F
    const Mat3<double> stress =
        cauchy_stress(model_, scene_, static_cast<std::size_t>(face.tet), h) *
        cofactor(plus_identity(1.0, h));
    const Vec3<double> weight =
        model_.material(static_cast<std::size_t>(face.tet)).density * gravity_;
    for (int i = 0; i < 10; ++i) {
      forces[nodes[i]] += volume * (shapes[i] * weight - stress * point.gradient[i]);
    }
  }

  const Model& model_;
  const Scene& scene_;
  FemMesh mesh_;
  std::vector<Vec3<double>> u_;  // [nodes] m
  Vec3<double> gravity_;         // m/s2
};

}  // namespace

std::vector<Vec3<double>> moved_by_surface(const Model& model, const Scene& scene, const State& end,
                                           std::span<const double> missing,
                                           const std::function<void()>& pause_point) {
  const Scene quadratic = with_element(Element::quadratic, model.largest_poisson_ratio(), scene);
  if (pause_point) pause_point();
  const auto rest = make_fem_rest(model, quadratic,
                                  newton_options(Element::quadratic, solved_to, pause_point), end);
  auto moved = rest->moved_by(Layer(model, quadratic, end).forces(missing));
  moved.resize(model.vertex_count());
  return moved;
}

}  // namespace viscera::sim
