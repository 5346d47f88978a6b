// Stress and strain in one place.
#pragma once

#include <array>

#include "sim/base/math.hpp"

namespace viscera::sim {

using Tensor6 = std::array<double, 6>;  // xx, yy, zz, xy, yz, xz, as VTK has them

Mat3<double> full(const Tensor6& tensor);
// Of the symmetric part.
Tensor6 tensor6(const Mat3<double>& m);
std::array<double, 3> principal_values(const Tensor6& tensor);  // the largest first

struct Strained {
  Tensor6 cauchy{};           // Pa, without viscosity
  Tensor6 green{};            // (F^T F - I) / 2
  double volume_ratio = 0.0;  // det F

  double mean_stress() const { return (cauchy[0] + cauchy[1] + cauchy[2]) / 3.0; }
  void add_stress(const Tensor6& pa) {
    for (int k = 0; k < 6; ++k) cauchy[k] += pa[k];
  }
  void add_mean_stress(double pa) {
    for (int k = 0; k < 3; ++k) cauchy[k] += pa;
  }
  // Adds `share` of another one.
  void add(double share, const Strained& other);
};

}  // namespace viscera::sim
