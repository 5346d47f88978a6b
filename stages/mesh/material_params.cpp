#include "stages/mesh/material_params.hpp"

namespace viscera {

std::vector<Param> elastic_params() {
  return {quantity("E", nullptr, "Pa", 1e-3, 1e13, "Young's modulus"),
          quantity("nu", nullptr, "1", -0.99, 0.499999, "Poisson's ratio"),
          quantity("density", nullptr, "kg/m3", 1e-3, 1e5, "mass per volume")};
}

}  // namespace viscera
