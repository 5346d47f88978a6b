// Isotropic material of one label, SI units, and its Lamé constants.
#pragma once

#include "sim/base/assert.hpp"

namespace viscera::sim {

struct Material {
  double youngs_modulus = 0.0;  // E, Pa
  double poisson_ratio = 0.0;   // nu, 1
  double density = 0.0;         // kg/m3
  double damping = 0.0;         // relaxation time tau, s: viscosity eta = mu tau
};

struct Lame {
  double lambda = 0.0;  // of linear elasticity, Pa
  double mu = 0.0;      // shear modulus, Pa

  // The lambda that the Neo-Hookean energy must be given: its linearisation has lambda - mu as
  // Lamé's first constant (Smith, de Goes and Kim 2018, section 3.4).
  double neo_hookean_lambda() const { return lambda + mu; }
};

// lambda = E nu / ((1 + nu)(1 - 2 nu)), mu = E / (2 (1 + nu)).
inline Lame lame(const Material& m) {
  const double nu = m.poisson_ratio;
  VISCERA_ASSERT(m.youngs_modulus >= 0.0 && -1.0 < nu && nu < 0.5,
                 "E " << m.youngs_modulus << " Pa, nu " << nu);
  return {.lambda = m.youngs_modulus * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)),
          .mu = m.youngs_modulus / (2.0 * (1.0 + nu))};
}

}  // namespace viscera::sim
