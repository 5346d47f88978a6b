#include "stages/image/frame_repair.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "stages/image/image_header.hpp"

namespace viscera {

using Matrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

FrameRepair orthonormalise(const std::filesystem::path& path, Frame& frame) {
  FrameRepair repair;
  Eigen::Map<Matrix> axes(frame.direction.data());
  if (!axes.allFinite() || !(std::abs(axes.determinant()) > 1e-6)) {
    throw bad_image(path, "direction", "axes that span no volume", "three orthonormal axes",
                    "export the volume again with a valid orientation");
  }
  repair.skew = (axes.transpose() * axes - Matrix::Identity()).cwiseAbs().maxCoeff();
  if (repair.skew < 1e-6) return repair;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(Eigen::Matrix3d(axes),
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d nearest = svd.matrixU() * svd.matrixV().transpose();
  const Eigen::Matrix3d change = nearest - Eigen::Matrix3d(axes);
  Eigen::Vector3d half;
  for (int a = 0; a < 3; ++a) half[a] = 0.5 * (frame.size[a] - 1) * frame.spacing[a];
  for (int corner = 0; corner < 4; ++corner) {
    const Eigen::Vector3d p(half[0], corner & 1 ? half[1] : -half[1],
                            corner & 2 ? half[2] : -half[2]);
    repair.shift_mm = std::max(repair.shift_mm, (change * p).norm());
  }
  const double allowed = 0.5 * *std::max_element(frame.spacing.begin(), frame.spacing.end());
  if (repair.shift_mm > allowed) {
    throw bad_image(
        path, "direction",
        fmt::format("axes are not orthonormal: repairing them moves a corner by {:.3g} mm",
                    repair.shift_mm),
        fmt::format("at most half a voxel ({:.3g} mm)", allowed),
        "resample the volume onto an orthogonal grid");
  }
  Eigen::Map<Eigen::Vector3d>(frame.origin.data()) -= change * half;
  axes = nearest;
  return repair;
}

}  // namespace viscera
