#include "sim/stress/strained.hpp"

#include <Eigen/Dense>

namespace viscera::sim {

Mat3<double> full(const Tensor6& s) {
  return {{{s[0], s[3], s[5]}, {s[3], s[1], s[4]}, {s[5], s[4], s[2]}}};
}

Tensor6 tensor6(const Mat3<double>& m) {
  const auto& [x, y, z] = m.col;
  return {x.x, y.y, z.z, 0.5 * (x.y + y.x), 0.5 * (y.z + z.y), 0.5 * (x.z + z.x)};
}

std::array<double, 3> principal_values(const Tensor6& s) {
  Eigen::Matrix3d m;
  m << s[0], s[3], s[5], s[3], s[1], s[4], s[5], s[4], s[2];
  const Eigen::Vector3d ascending =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(m, Eigen::EigenvaluesOnly).eigenvalues();
  return {ascending[2], ascending[1], ascending[0]};
}

void Strained::add(double share, const Strained& other) {
  for (int k = 0; k < 6; ++k) {
    cauchy[k] += share * other.cauchy[k];
    green[k] += share * other.green[k];
  }
  volume_ratio += share * other.volume_ratio;
}

}  // namespace viscera::sim
