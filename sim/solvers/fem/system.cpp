#include "sim/solvers/fem/system.hpp"

#include <algorithm>

#include "sim/base/assert.hpp"

namespace viscera::sim {

FemSystem::FemSystem(std::vector<char> fixed, FemOptions::Linear linear)
    : linear_(make_linear_solver(linear)) {
  for (std::size_t i = 0; i < fixed.size(); ++i) {
    dof_.push_back(fixed[i] ? -1 : free_count());
    if (!fixed[i]) nodes_.push_back(static_cast<int>(i));
  }
  for (int i = 0; i < free_count(); ++i) below_.push_back({i});
}

void FemSystem::connect(std::span<const int> nodes) {
  for (const int a : nodes) {
    for (const int b : nodes) {
      if (is_free(a) && is_free(b) && dof_[a] > dof_[b]) below_[dof_[b]].push_back(dof_[a]);
    }
  }
}

void FemSystem::analyse() {
  for (auto& rows : below_) {
    std::ranges::sort(rows);
    rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  }
  Eigen::VectorXi entries(3 * free_count());
  for (int j = 0; j < entries.size(); ++j) entries[j] = 3 * static_cast<int>(below_[j / 3].size());
  lower_.resize(entries.size(), entries.size());
  lower_.reserve(entries);
  for (int j = 0; j < entries.size(); ++j) {
    for (const int i : below_[j / 3]) {
      for (int row = 0; row < 3; ++row) lower_.insert(3 * i + row, j) = 0.0;
    }
  }
  lower_.makeCompressed();
  r_.resize(entries.size());
  p_.resize(entries.size());
  linear_->analyse(lower_);
}

// Of the block's first value; its columns are a column's length apart.
int FemSystem::place_of(int a, int b) const {
  if (!is_free(a) || !is_free(b)) return -1;
  const auto [column, row] = std::minmax(dof_[a], dof_[b]);
  const auto& rows = below_[column];
  const auto at = std::ranges::lower_bound(rows, row) - rows.begin();
  return lower_.outerIndexPtr()[3 * column] + 3 * static_cast<int>(at);
}

void FemSystem::begin(const std::vector<Vec3<double>>& residual,
                      const std::vector<Vec3<double>>& moves) {
  Eigen::Map<Eigen::VectorXd>(lower_.valuePtr(), lower_.nonZeros()).setZero();
  for (int i = 0; i < free_count(); ++i) {
    const auto& r = residual[nodes_[i]];
    r_.segment<3>(3 * i) << r.x, r.y, r.z;
  }
  moves_ = moves;
  moving_ = std::ranges::any_of(moves, [](const auto& m) { return dot(m, m) > 0.0; });
}

void FemSystem::add_block(int a, int b, int place, const Eigen::Matrix3d& block) {
  if (place >= 0) {
    const bool turned = dof_[a] < dof_[b];
    const int length = 3 * static_cast<int>(below_[turned ? dof_[a] : dof_[b]].size());
    for (int column = 0; column < 3; ++column) {
      double* const to = lower_.valuePtr() + place + column * length;
      for (int row = 0; row < 3; ++row) {
        to[row] += turned ? block(column, row) : block(row, column);
      }
    }
    return;
  }
  if (!moving_) return;
  const auto vector = [](const Vec3<double>& m) { return Eigen::Vector3d(m.x, m.y, m.z); };
  if (is_free(a)) r_.segment<3>(3 * dof_[a]) -= block * vector(moves_[b]);
  if (is_free(b)) r_.segment<3>(3 * dof_[b]) -= block.transpose() * vector(moves_[a]);
}

void FemSystem::add_diagonal(double factor, const std::vector<double>& k) {
  for (int i = 0; i < free_count(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const int column = 3 * i + axis, place = lower_.outerIndexPtr()[column] + axis;
      VISCERA_ASSERT(lower_.innerIndexPtr()[place] == column,
                     "row " << lower_.innerIndexPtr()[place] << " of column " << column);
      lower_.valuePtr()[place] += factor * k[nodes_[i]];
    }
  }
}

bool FemSystem::solve(double tolerance, std::vector<Vec3<double>>& step) {
  if (free_count() > 0 && !linear_->solve(lower_, r_, tolerance, p_)) return false;
  step = moves_;
  for (int i = 0; i < free_count(); ++i) {
    step[nodes_[i]] = {p_[3 * i], p_[3 * i + 1], p_[3 * i + 2]};
  }
  return free_count() == 0 || (p_.allFinite() && (moving_ || p_.dot(r_) >= 0.0));
}

}  // namespace viscera::sim
