// A beam of silicone that was measured: Dubied et al., "Sim-to-Real for Soft Robots using
// Differentiable FEM" (RA-L 2022, arXiv 2201.12560), 10 x 3 x 3 cm, clamped at one end.
// Markers sat on the tip's face: on the middle of its top edge, and on either side.
#pragma once

#include <algorithm>
#include <array>

#include "tests/sim/shapes.hpp"

namespace viscera::sim {

struct Beam {
  static constexpr double load_n = 0.51012, own_weight_hz = 7.75;
  // Drops of the markers, mm. Repeats differ by up to 1 mm.
  static constexpr std::array<double, 3> weight_mm = {6.84, 6.66, 6.47},
                                         loaded_mm = {17.46, 17.31, 15.94};
  static constexpr double allowed_mm = 1.0, allowed_share = 0.05;  // whichever is more

  Model model;
  std::array<int, 3> markers{};  // vertices

  explicit Beam(std::array<int, 3> cells)
      : model(make_five_tet_box({0.1, 0.03, 0.03}, cells,
                                {.youngs_modulus = 2.6e5,
                                 .poisson_ratio = 0.499,
                                 .density = 1070.0,
                                 .damping = 0.01})) {
    const std::array<Vec3<double>, 3> places = {
        {{0.1, 0.015, 0.03}, {0.1, 0.0, 0.024}, {0.1, 0.03, 0.006}}};
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      model.fixed[i] = model.rest[i].x + model.origin.x < 1e-9;
    }
    for (std::size_t m = 0; m < markers.size(); ++m) {
      const auto nearest = std::ranges::min_element(model.rest, {}, [&](const Vec3<double>& x) {
        return norm(x + model.origin - places[m]);
      });
      markers[m] = static_cast<int>(nearest - model.rest.begin());
    }
  }
  double youngs_modulus() const { return model.materials.front().youngs_modulus; }
  std::array<double, 3> drops_mm(const State& state) const {
    std::array<double, 3> drops{};
    for (std::size_t m = 0; m < markers.size(); ++m) drops[m] = -1e3 * state.u[markers[m]].z;
    return drops;
  }

  // Under its own weight, and with the load on the top edge of its tip.
  static Scene scene(bool loaded) {
    Scene scene = elastic_scene();
    scene.params<Gravity>().emplace_back().acceleration = 9.80709;
    if (!loaded) return scene;
    Load::Params load;
    load.box_lo = {0.1 - 1e-6, -1.0, 0.03 - 1e-6};
    load.box_hi = {0.1 + 1e-6, 1.0, 0.03 + 1e-6};
    load.force = {0.0, 0.0, -load_n};
    load.spread = "vertices";
    scene.params<Load>().push_back(load);
    return scene;
  }

  static double mean(const std::array<double, 3>& values) {
    return (values[0] + values[1] + values[2]) / 3.0;
  }
  // E is fitted on the beam's own weight alone, as in the paper: drops go about as 1/E.
  template <class Settle>
  void fit_to_own_weight(Settle&& settle) {
    for (int round = 0; round < 4; ++round) {
      const double found = mean(drops_mm(settle(model, scene(false))));
      model.materials.front().youngs_modulus *= found / mean(weight_mm);
    }
  }
  // How far the markers are off, in units of what is allowed.
  static double worst_miss(const std::array<double, 3>& found,
                           const std::array<double, 3>& measured) {
    double worst = 0.0;
    for (int m = 0; m < 3; ++m) {
      const double allowed = std::max(allowed_mm, allowed_share * measured[m]);
      worst = std::max(worst, std::abs(found[m] - measured[m]) / allowed);
    }
    return worst;
  }
};

}  // namespace viscera::sim
