// What the benchmarks of bodies make of their measurements.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <vector>

#include "sim/base/math.hpp"

namespace viscera {

// Of a, or of its difference to b.
inline double root_mean_square(const std::vector<sim::Vec3<double>>& a,
                               const std::vector<sim::Vec3<double>>* b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const sim::Vec3<double> e = b ? a[i] - (*b)[i] : a[i];
    sum += dot(e, e);
  }
  return std::sqrt(sum / static_cast<double>(a.size()));
}

struct Times {
  double median, q1, q3;  // ms a frame

  static Times of(std::vector<double> ms) {
    std::ranges::sort(ms);
    return {ms[ms.size() / 2], ms[ms.size() / 4], ms[3 * ms.size() / 4]};
  }
};

// What advance() takes, ms.
template <class Advance>
double time_frame(Advance&& advance) {
  const auto begin = std::chrono::steady_clock::now();
  advance();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
      .count();
}

}  // namespace viscera
