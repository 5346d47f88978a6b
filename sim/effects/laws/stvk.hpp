// St. Venant-Kirchhoff elasticity: Hooke's law of Green's strain, e = (H + H^T + H^T H)/2,
// de = sym(F^T dF). Turns with the body, but softens in compression: under uniaxial stress it gives
// way at a stretch of 1/sqrt 3 and may invert (Sifakis and Barbic, "FEM Simulation of 3D Deformable
// Solids", SIGGRAPH 2012 courses, section 3.3).
#pragma once

#include "sim/effects/laws/hookean.hpp"

namespace viscera::sim {

struct StVK : Hookean<StVK> {
  static constexpr const char* name = "stvk";
  static constexpr const char* doc = "St. Venant-Kirchhoff elasticity with each label's E and nu";
  static constexpr bool loses_stiffness = true;

  template <class T>
  SIM_HD static Strain<T> strain(const Mat3<T>& h) {
    return {green_strain(h), plus_identity(T(1), h)};
  }
};

}  // namespace viscera::sim
