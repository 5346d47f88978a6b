// Which cases stand out by a figure. A case does when its modified z-score passes 3.5 (B. Iglewicz,
// D. C. Hoaglin, How to Detect and Handle Outliers, ASQC 1993):
//
//   z = (x - median) / (1.4826 MAD),   MAD = median |x - median|
//
// and where more than half of the values are equal (MAD = 0), with 1.2533 times the mean of
// |x - median| in the denominator. Under five values nothing is called an outlier.
#pragma once

#include <vector>

namespace viscera {

struct ValueSpread {
  double least = 0.0, median = 0.0, most = 0.0;
  std::vector<bool> outlier;  // by value
};

// `values`: at least one, finite.
ValueSpread spread_of(const std::vector<double>& values);

}  // namespace viscera
