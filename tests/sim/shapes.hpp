// Small bodies for the tests of the simulation, SI units.
#pragma once

#include <random>

#include "sim/make.hpp"
#include "sim/scene/diagnostics.hpp"

namespace viscera::sim {

inline const Material soft_tissue = {
    .youngs_modulus = 5e3, .poisson_ratio = 0.45, .density = 1060.0, .damping = 0.01};

// Cuts a box of `size` m into cells, each by `cut(cell, corner index)`: a list of tets whose
// entries number the cell's corners, bit 0 for x, bit 1 for y, bit 2 for z.
template <class Cut>
Model make_cut_box(Vec3<double> size, std::array<int, 3> cells, const Material& material,
                   Vec3<double> corner, Cut&& cut) {
  std::vector<Vec3<double>> p;
  for (int k = 0; k <= cells[2]; ++k) {
    for (int j = 0; j <= cells[1]; ++j) {
      for (int i = 0; i <= cells[0]; ++i) {
        p.push_back(corner + Vec3<double>{size.x * i / cells[0], size.y * j / cells[1],
                                          size.z * k / cells[2]});
      }
    }
  }
  std::vector<Tet> tets;
  for (int cell = 0; cell < cells[0] * cells[1] * cells[2]; ++cell) {
    const int i = cell % cells[0], j = cell / cells[0] % cells[1], k = cell / cells[0] / cells[1];
    for (const Tet& corners : cut(i + j + k)) {
      Tet tet;
      for (int v = 0; v < 4; ++v) {
        const int c = corners[v];
        tet[v] =
            ((k + (c >> 2)) * (cells[1] + 1) + j + (c >> 1 & 1)) * (cells[0] + 1) + i + (c & 1);
      }
      const Vec3<double> a = p[tet[1]] - p[tet[0]], b = p[tet[2]] - p[tet[0]];
      if (dot(cross(a, b), p[tet[3]] - p[tet[0]]) < 0.0) std::swap(tet[1], tet[2]);
      tets.push_back(tet);
    }
  }
  const std::vector<int> labels(tets.size(), 1);
  return make_model(p, tets, labels, {{1, material}});
}

// Six tets a cell around its diagonal (Kuhn).
inline Model make_box(Vec3<double> size, std::array<int, 3> cells, const Material& material,
                      Vec3<double> corner = {}) {
  return make_cut_box(size, cells, material, corner, [](int) {
    return std::array<Tet, 6>{
        {{0, 1, 3, 7}, {0, 1, 5, 7}, {0, 2, 3, 7}, {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 4, 6, 7}}};
  });
}

// Five tets a cell, mirrored from cell to cell so that the faces match.
inline Model make_five_tet_box(Vec3<double> size, std::array<int, 3> cells,
                               const Material& material) {
  return make_cut_box(size, cells, material, {}, [](int parity) {
    std::array<Tet, 5> tets{{{0, 3, 5, 6}, {1, 0, 3, 5}, {2, 0, 3, 6}, {4, 0, 5, 6}, {7, 3, 5, 6}}};
    for (auto& tet : tets) {
      for (int& c : tet) c ^= parity & 1;
    }
    return tets;
  });
}

inline Model make_cube(int cells, const Material& material = soft_tissue, double edge = 0.05) {
  return make_box({edge, edge, edge}, {cells, cells, cells}, material);
}

inline Scene elastic_scene() {
  Scene scene;
  scene.params<NeoHookean>().emplace_back();
  return scene;
}

// A body above the ground with every effect on.
inline Scene drop_scene() {
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  scene.params<Gravity>().emplace_back();
  scene.params<Ground>().emplace_back();
  return scene;
}

// The body's vertices without elasticity: each on its own.
inline Scene particle_scene() {
  Scene scene;
  scene.params<Gravity>().emplace_back();
  return scene;
}

inline Mat3<double> diagonal(double x, double y, double z) {
  return {{{x, 0, 0}, {0, y, 0}, {0, 0, z}}};
}

// Parameters with which an effect does something.
template <class Effect>
typename Effect::Params sample_params() {
  typename Effect::Params params{};
  if constexpr (std::is_base_of_v<Selection, typename Effect::Params>) params.side = "left";
  if constexpr (std::is_same_v<Effect, Fibre>) params = {1e4, {1.0, 2.0, -0.5}, ""};
  if constexpr (std::is_same_v<Effect, Prony>) params = {0.7, 0.01};
  if constexpr (std::is_same_v<Effect, MooneyRivlin>) params.second = 0.4;
  if constexpr (std::is_same_v<Effect, Ogden>) params = {-4.7, 1.0};
  if constexpr (is_smoothed<Effect>) {
    static_cast<typename Effect::Law::Params&>(params) = sample_params<typename Effect::Law>();
  }
  if constexpr (std::is_same_v<Effect, Pressure>) params.pressure = 500.0;
  if constexpr (std::is_same_v<Effect, Load>) params.force = {0.1, 0.2, -0.3};
  if constexpr (std::is_same_v<Effect, Spring>) params.stiffness = 1e6;
  if constexpr (std::is_same_v<Effect, Prescribed>) params.displacement = {0.0, 0.0, 0.005};
  if constexpr (std::is_same_v<Effect, Grip>) {
    params.point = {0.025, 0.025, 0.05};
    params.radius = 0.03;
    params.offset = {0.002, 0.0, 0.005};
    params.rotation = {0.0, 0.1, 0.2};
  }
  // Obstacles a millimetre below a cube of 5 cm at the origin.
  if constexpr (std::is_same_v<Effect, Collider<Plane>>) params.point = {0.0, 0.0, -0.001};
  if constexpr (std::is_same_v<Effect, Collider<Sphere>>) {
    params.center = {0.025, 0.025, -0.021};
    params.radius = 0.02;
  }
  if constexpr (std::is_same_v<Effect, Collider<Capsule>>) {
    params.from = {0.0, 0.025, -0.011};
    params.to = {0.05, 0.025, -0.011};
    params.radius = 0.01;
  }
  if constexpr (std::is_same_v<Effect, Collider<Box>>) {
    params.center = {0.025, 0.025, -0.011};
    params.size = {0.02, 0.02, 0.02};
  }
  return params;
}

inline double random_in(std::mt19937& generator, double lo, double hi) {
  return lo + (hi - lo) * (static_cast<double>(generator()) / 4294967296.0);
}
inline Vec3<double> random_vector(std::mt19937& generator, double size) {
  const double x = random_in(generator, -size, size);
  const double y = random_in(generator, -size, size);
  return {x, y, random_in(generator, -size, size)};
}

}  // namespace viscera::sim
