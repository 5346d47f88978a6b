// A vertex's three numbers and a fourth, aligned so that one instruction loads them.
#pragma once

#include "sim/base/math.hpp"

namespace viscera::sim {

template <class T>
struct alignas(4 * sizeof(T)) Row {
  Vec3<T> v;
  T w{};
};

}  // namespace viscera::sim
