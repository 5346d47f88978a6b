// How long the steps of the implicit finite elements are, where they are of second order.
//
// A step of the scene's grid is made at once, or in halves of halves of it, down to a 64th. The
// error that a step makes in the place of a node is known from where the changes over the last step
// would have led it. With h the step, l the last one, x''' the third derivative of the place, and
// the acceleration over the last step as the mean a_l = (v_n - v_n-1) / l,
//
//   BDF2                                  x_n+1 - x(t_n+1) = -h^2 (h + l)^2 / (6 (2 h + l)) x'''
//   x_n + h v_n + h^2 / 2 a_l             is off by          -(h^3 / 6 + h^2 l / 4) x'''
//
// so the error is the difference of the two times the first factor over the sum of both, but for
// the sign (Milne's device: Hairer, Norsett and Wanner, "Solving Ordinary Differential Equations
// I", sections III.5 and III.7). It is the root mean square over the mass of the nodes that no
// obstacle stops: along a stop the step is of first order (time_rule.hpp). It may be `share` of
// how far the body goes in the step, with a floor for bodies that come to rest: a body that is
// slower than `slow` of its size a second needs no shorter steps than at that speed. A run without
// a past begins with the shortest step, as if the forces from outside alone had acted before; the
// steps after it may each be twice as long.
#pragma once

#include <algorithm>
#include <cmath>

#include "sim/solvers/time_rule.hpp"

namespace viscera::sim {

// The error of BDF2 in the place, as a share of its distance to the prediction from the last step.
inline double share_of_prediction(double h, double last_h) {
  const double made = h * h * (h + last_h) * (h + last_h) / (6.0 * (2.0 * h + last_h));
  const double predicted = h * h * (h / 6.0 + last_h / 4.0);
  return made / (made + predicted);
}

class StepLength {
 public:
  static constexpr int parts = 64;      // of a step of the grid
  static constexpr double slow = 0.05;  // 1/s, of the body's size
  static constexpr double spare =
      0.15;  // of the error allowed: below, the next may be twice as long

  explicit StepLength(int length = parts) : length_(std::clamp(length, 1, parts)) {}

  // In parts; halves begin at multiples of their length, so that they end where the grid does.
  int from(int part) const {
    int length = length_;
    while (part % length != 0 || part + length > parts) length /= 2;
    return length;
  }
  // After a step of `length` that was made, or was not; with the error over what is allowed.
  void made(int length, double error) {
    length_ = error <= spare ? std::min(2 * length, parts) : length;
  }
  void failed(int length) { length_ = std::max(1, length / 2); }

  int longest() const { return length_; }  // of the next step

 private:
  int length_;
};

}  // namespace viscera::sim
