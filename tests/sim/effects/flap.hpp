// A flap that folds onto itself, and bodies of parts. SI units.
#pragma once

#include "tests/sim/shapes.hpp"

namespace viscera::sim {

inline constexpr double flap_thickness = 1e-3;

// A body of the tets whose centre satisfies `keep`, or of several bodies.
template <class Keep>
Model assembled(const std::vector<Model>& parts, const Material& material, Keep&& keep) {
  std::vector<Vec3<double>> points;
  std::vector<Tet> tets;
  for (const Model& part : parts) {
    std::vector<int> number(part.vertex_count(), -1);
    for (const Tet& tet : part.tets) {
      Vec3<double> center;
      for (const int v : tet) center += 0.25 * (part.rest[v] + part.origin);
      if (!keep(center)) continue;
      Tet& own = tets.emplace_back();
      for (int k = 0; k < 4; ++k) {
        int& n = number[tet[k]];
        if (n < 0) {
          n = static_cast<int>(points.size());
          points.push_back(part.rest[tet[k]] + part.origin);
        }
        own[k] = n;
      }
    }
  }
  return make_model(points, tets, std::vector<int>(tets.size(), 1), {{1, material}});
}

inline Vec3<double> place(const Model& model, std::size_t i) {
  return model.rest[i] + model.origin;
}

// 60 x 20 x 20 mm with a slot 4 mm wide from x = 15 mm on; below the slot it is held.
inline Model make_flap() {
  Material soft = soft_tissue;
  soft.youngs_modulus = 3e3;
  const Model block = make_box({0.06, 0.02, 0.02}, {12, 4, 5}, soft);
  Model model = assembled({block}, soft, [](const Vec3<double>& x) {
    return !(x.x > 0.015 && x.z > 0.008 && x.z < 0.012);
  });
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = place(model, i).z < 0.0081 && place(model, i).x > 0.0;
  }
  return model;
}

inline Scene folding_scene(bool self_contact) {
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  scene.params<Gravity>().emplace_back();
  scene.time.substeps = 32;
  if (self_contact) scene.params<SelfContact>().push_back({.thickness = flap_thickness});
  return scene;
}

}  // namespace viscera::sim
