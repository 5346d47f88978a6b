// Linear elasticity: e = sym(H), with H the gradient of displacement. Exact to first order in both
// strain and rotation; a body that turns swells, so it is for small motion and for comparison.
#pragma once

#include "sim/effects/laws/hookean.hpp"

namespace viscera::sim {

struct Linear : Hookean<Linear> {
  static constexpr const char* name = "linear";
  static constexpr const char* doc =
      "linear elasticity with each label's E and nu; small rotations";

  template <class T>
  SIM_HD static Strain<T> strain(const Mat3<T>& h) {
    return {symmetric_part(h), plus_identity(T(1), Mat3<T>{})};
  }
};

}  // namespace viscera::sim
