#include "sim/stress/traction.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "sim/measures/forces.hpp"
#include "sim/model/surface.hpp"

namespace viscera::sim {
namespace {

// Effects without an energy of the strain are none of the tissue's.
Scene tissue_alone(Scene scene) {
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (!requires { &Effect::energy; }) std::get<i>(scene.effects).clear();
  });
  return scene;
}

Mat3<double> outer(const Vec3<double>& a, const Vec3<double>& b) {
  return {{b.x * a, b.y * a, b.z * a}};
}

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + std::ssize(values) / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The directions that a quarter of the normals' weight or more lies in: one on a smooth surface,
// two at an edge of 60 degrees and more, three at the corner of a box.
std::vector<Vec3<double>> main_directions(const Mat3<double>& normals, double area) {
  constexpr double large = 0.25;
  const auto& [x, y, z] = normals.col;
  Eigen::Matrix3d m;
  m << x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solved(m);
  std::vector<Vec3<double>> found;
  for (int k = 2; k >= 0; --k) {
    if (solved.eigenvalues()[k] < large * area) break;
    const Eigen::Vector3d d = solved.eigenvectors().col(k);
    found.push_back({d[0], d[1], d[2]});
  }
  return found;
}

}  // namespace

SurfaceTraction::SurfaceTraction(const Model& model, const Scene& scene, const State& state)
    : at_(model.vertex_count()) {
  const auto faces = boundary_faces(model);
  for (const auto& face : faces) {
    const auto place = [&](int k) { return model.rest[face[k]] + state.u[face[k]]; };
    const Vec3<double> third = (1.0 / 6.0) * cross(place(1) - place(0), place(2) - place(0));
    const double area = norm(third);
    if (area == 0.0) continue;
    for (const int v : face) {
      at_[v].normal_area += third;
      at_[v].normals = at_[v].normals + outer((1.0 / area) * third, third);
      at_[v].area += area;
    }
  }
  const auto forces = element_forces(model, tissue_alone(scene), state);
  std::vector<double> inside[3];  // m/s2
  for (std::size_t v = 0; v < at_.size(); ++v) {
    if (at_[v].area > 0.0) continue;
    const Vec3<double> body_force = (-1.0 / model.mass[v]) * forces[v];
    inside[0].push_back(body_force.x);
    inside[1].push_back(body_force.y);
    inside[2].push_back(body_force.z);
  }
  const Vec3<double> b = {median(inside[0]), median(inside[1]), median(inside[2])};
  for (std::size_t v = 0; v < at_.size(); ++v)
    at_[v].force = -1.0 * (forces[v] + model.mass[v] * b);
  for (const auto& face : faces) {
    double largest = 0.0;
    for (const int v : face) {
      if (at_[v].area > 0.0) largest = std::max(largest, norm(at_[v].force) / at_[v].area);
    }
    for (const int v : face) at_[v].traction = std::max(at_[v].traction, largest);
  }
}

void SurfaceTraction::fit(int vertex, Strained& recovered) const {
  // Of the stress: at an edge a traction below it is none, for what acts on the faces on either
  // side is known in sum alone.
  constexpr double nothing = 0.1;
  // Of the faces' area: a sum of their normals that is less has no direction to speak of.
  constexpr double least_area = 0.3;
  const Place& place = at_[vertex];
  if (place.area == 0.0) return;
  Mat3<double> sigma = full(recovered.cauchy);
  std::vector<Vec3<double>> normals = main_directions(place.normals, place.area);
  Vec3<double> traction{};
  if (normals.size() == 1 || place.traction > nothing * std::sqrt(squared_norm(sigma))) {
    const double area = norm(place.normal_area);
    if (area < least_area * place.area) return;
    normals = {(1.0 / area) * place.normal_area};
    traction = (1.0 / area) * place.force;
  }
  double lacking = 0.0;
  for (const auto& n : normals) lacking += dot(n, traction - sigma * n);
  sigma = plus_identity(lacking / static_cast<double>(normals.size()), sigma);
  for (const auto& n : normals) {
    const Vec3<double> r = traction - sigma * n;
    sigma = sigma + outer(r, n) + outer(n, r) + outer((-dot(r, n)) * n, n);
  }
  recovered.cauchy = tensor6(sigma);
}

}  // namespace viscera::sim
