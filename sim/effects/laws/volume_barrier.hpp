// A barrier that keeps an elastic law's tets from turning inside out. The stable Neo-Hookean energy
// is finite at J = det F <= 0, so a tet that a load has turned over may rest there. The barrier
// adds, per rest volume and with lambda the law's volumetric constant (Lame::neo_hookean_lambda(),
// Pa),
//
//   b(J)   = -lambda (J - J_b)^2 ln(J / J_b)                                   for 0 < J < J_b
//   b'(J)  = -lambda ((J - J_b)^2 / J + 2 (J - J_b) ln(J / J_b))
//   b''(J) =  lambda ((J - J_b)^2 / J^2 - 4 (J - J_b) / J - 2 ln(J / J_b))
//
// and nothing from J_b up: the law is untouched there, and b is twice continuously differentiable
// at J_b. It is the form of Li et al., "Incremental Potential Contact" (SIGGRAPH 2020), equation 5,
// with J in place of the distance. b is convex and falls from infinity at J -> 0, so no path of
// finite energy leads from J > 0 to J <= 0. A tet that is at J <= 0 already has no barrier: it
// would hold it there. Who uses it decides at the beginning of each step which tets are open and
// have one.
#pragma once

#include <cmath>

#include "sim/base/math.hpp"

namespace viscera::sim {

struct VolumeBarrier {
  static constexpr double onset = 0.3;  // J_b

  // Per rest volume.
  template <class T>
  struct Value {
    T energy = T(0);     // b, J/m3
    T slope = T(0);      // db/dJ, Pa
    T curvature = T(0);  // d2b/dJ2, Pa
  };

  // For j > 0.
  template <class T>
  SIM_HD static Value<T> at(T lambda, T j) {
    constexpr T j_b = T(onset);
    if (j >= j_b) return {};
    using std::log;
    const T gap = j - j_b, log_ratio = log(j / j_b), ratio = gap / j;
    return {.energy = -lambda * gap * gap * log_ratio,
            .slope = -lambda * gap * (ratio + T(2) * log_ratio),
            .curvature = lambda * (ratio * ratio - T(4) * ratio - T(2) * log_ratio)};
  }
};

}  // namespace viscera::sim
