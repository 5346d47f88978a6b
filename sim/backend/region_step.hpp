// What shape matching does with one region and one of its members, for host and device; equations
// in effects/laws/shape_matching.hpp. Sums are taken in double.
#pragma once

#include <algorithm>

#include "sim/base/best_rotation.hpp"
#include "sim/model/regions.hpp"
#include "sim/solvers/xpbd/arithmetic.hpp"

namespace viscera::sim {

struct RegionSums {
  Vec3<double> first;    // sum m w, kg m
  Mat3<double> mixed{};  // sum m w r^T, kg m2

  // w is the displacement of a member from rest, m.
  SIM_HD void add(const RegionMember& member, const Vec3<double>& w) {
    const Vec3<double> mw = member.mass * w;
    first += mw;
    mixed.col[0] += member.arm.x * mw;
    mixed.col[1] += member.arm.y * mw;
    mixed.col[2] += member.arm.z * mw;
  }
  SIM_HD RegionSums& operator+=(const RegionSums& other) {
    first += other.first;
    for (int k = 0; k < 3; ++k) mixed.col[k] += other.mixed.col[k];
    return *this;
  }
};

// How a region as a whole has moved.
struct RegionFit {
  Vec3<double> shift;  // c_w, m
  Quaternion<double> rotation;

  // Of a region whose sums begin with no motion at all.
  SIM_HD static RegionSums begin(const Region& region) { return {{}, region.inertia}; }
  SIM_HD RegionFit(const Region& region, const RegionSums& all)
      : shift((1.0 / region.mass) * all.first), rotation(best_rotation(all.mixed)) {}
  RegionFit() = default;
};

// The displacement of a vertex from rest that its regions see, m: explicit forces act at the start
// of the substep.
template <class T>
SIM_HD Vec3<double> seen_by_regions(const Vec3<T>& u, const Vec3<T>& d, Arithmetic arithmetic) {
  const Vec3<double> start = cast<double>(u);
  return arithmetic == Arithmetic::force ? start : start + cast<double>(d);
}

// The region of each member.
inline std::vector<int> regions_of_members(const Regions& all) {
  std::vector<int> result(all.members.size());
  for (std::size_t r = 0; r < all.regions.size(); ++r) {
    const auto& region = all.regions[r];
    std::fill(result.begin() + region.begin, result.begin() + region.end, static_cast<int>(r));
  }
  return result;
}

// What an iteration adds to the displacement of a member's replica, w before it. With o = omega^2
// dt^2 and l what it added so far in this substep (`so_far`, where there are several iterations),
// XPBD's equation 18 reads dl = -(o C + l) / (1 + o).
SIM_HD Vec3<double> pull_member(const RegionFit& goal, const RegionMember& member,
                                const Vec3<double>& w, double o, Arithmetic arithmetic,
                                double pbd_stiffness, Vec3<double>* so_far) {
  const Vec3<double> error = (w - goal.shift) - turn(goal.rotation, member.arm);
  if (arithmetic == Arithmetic::pbd) return -pbd_stiffness * error;
  if (arithmetic == Arithmetic::force) return -o * error;
  if (arithmetic == Arithmetic::xpbd_only) return -o / (1.0 + o) * error;
  if (arithmetic == Arithmetic::xpbd_first) *so_far = {};
  const Vec3<double> more = -1.0 / (1.0 + o) * (o * error + *so_far);
  *so_far += more;
  return more;
}

}  // namespace viscera::sim
