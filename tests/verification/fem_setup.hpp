// What the tests of the finite elements share: options, and the tissue of the bar that an
// independent code has computed too.
#pragma once

#include "tests/sim/shapes.hpp"

namespace viscera::sim {

inline SolverOptions statics(double tolerance = 1e-12, int order = 1) {
  SolverOptions options{.method = Method::fem};
  options.fem.time = FemOptions::Time::quasi_static;
  options.fem.tolerance = tolerance;
  options.fem.order = order;
  return options;
}
inline SolverOptions dynamics(double tolerance = 1e-10) {
  SolverOptions options{.method = Method::fem};
  options.fem.tolerance = tolerance;
  return options;
}

inline constexpr Material bar_material = {
    .youngs_modulus = 5e4, .poisson_ratio = 0.45, .density = 1060.0};

}  // namespace viscera::sim
