// Points in space, asked whether one of them is near. Lengths in mm.
#pragma once

#include <map>
#include <vector>

#include "stages/mesh/vec.hpp"

namespace viscera {

// Buckets as wide as the largest distance asked for, so that 27 of them hold every near point.
class Spread {
 public:
  explicit Spread(double width) : width_(width) {}

  bool has_near(const Vec& p, double distance) const {
    const auto at = bucket(p);
    for (int n = 0; n < 27; ++n) {
      const auto found =
          points_.find({at[0] + n % 3 - 1, at[1] + n / 3 % 3 - 1, at[2] + n / 9 - 1});
      if (found == points_.end()) continue;
      for (const auto& q : found->second)
        if (norm(sub(p, q)) < distance) return true;
    }
    return false;
  }
  void add(const Vec& p) { points_[bucket(p)].push_back(p); }

 private:
  std::array<int, 3> bucket(const Vec& p) const {
    std::array<int, 3> at{};
    for (int a = 0; a < 3; ++a) at[a] = static_cast<int>(std::floor(p[a] / width_));
    return at;
  }
  double width_;
  std::map<std::array<int, 3>, std::vector<Vec>> points_;
};

}  // namespace viscera
