// The material parameters that every stage understands, as people write them: E, nu, density.
#pragma once

#include <string>
#include <vector>

#include "pipeline/base/param.hpp"

namespace viscera {

struct Elastic {
  double youngs_modulus = 0.0;  // Pa
  double poisson_ratio = 0.0;
  double density = 0.0;  // kg/m3
};

// Declarations of E, nu and density, none of which has a default.
std::vector<Param> elastic_params();

}  // namespace viscera
