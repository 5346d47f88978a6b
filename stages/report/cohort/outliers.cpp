#include "stages/report/cohort/outliers.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace viscera {
namespace {

constexpr double z_limit = 3.5;
constexpr std::size_t min_values = 5;
constexpr double mad_to_deviation = 1.4826, mean_to_deviation = 1.2533;  // of a normal distribution
constexpr double rounding = 1e-9;  // relative; what differs by less is equal

double median_of(std::vector<double> values) {
  std::ranges::sort(values);
  const std::size_t middle = values.size() / 2;
  return values.size() % 2 ? values[middle] : 0.5 * (values[middle - 1] + values[middle]);
}

}  // namespace

ValueSpread spread_of(const std::vector<double>& values) {
  const auto [least, most] = std::ranges::minmax(values);
  ValueSpread spread{.least = least, .median = median_of(values), .most = most};
  spread.outlier.assign(values.size(), false);
  if (values.size() < min_values) return spread;
  std::vector<double> distances;
  for (const double value : values) distances.push_back(std::abs(value - spread.median));
  const double same = rounding * std::max(std::abs(least), std::abs(most));
  double deviation = mad_to_deviation * median_of(distances);
  if (deviation <= same) {
    deviation = mean_to_deviation * std::accumulate(distances.begin(), distances.end(), 0.0) /
                static_cast<double>(distances.size());
  }
  if (deviation <= same) return spread;
  for (std::size_t i = 0; i < values.size(); ++i) {
    spread.outlier[i] = distances[i] > z_limit * deviation;
  }
  return spread;
}

}  // namespace viscera
