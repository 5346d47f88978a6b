// W numbers side by side: an arithmetic type for the effects' templates, so that one instruction
// works on W elements of a colour. Every lane gives the bits that the plain type gives. `Isa` only
// keeps the instances of translation units with different instruction sets apart.
#pragma once

#include <cmath>
#include <type_traits>

namespace viscera::sim {

template <class T>
struct VectorOf;
template <>
struct VectorOf<float> {
  typedef float type __attribute__((vector_size(32)));
};
template <>
struct VectorOf<double> {
  typedef double type __attribute__((vector_size(32)));
};

template <class T, int Isa>
struct Pack {
  using Vector = typename VectorOf<T>::type;
  using Mask = decltype(Vector{} > Vector{});
  static constexpr int width = 32 / sizeof(T);
  Vector lanes;

  Pack() : lanes{} {}
  Pack(Vector v) : lanes(v) {}
  template <class Number>
  requires std::is_arithmetic_v<Number>
  explicit Pack(Number value) : lanes(static_cast<T>(value) - Vector{}) {}

  Pack& operator+=(Pack b) { return lanes += b.lanes, *this; }
  Pack& operator-=(Pack b) { return lanes -= b.lanes, *this; }
  Pack& operator*=(Pack b) { return lanes *= b.lanes, *this; }
  friend Pack operator+(Pack a, Pack b) { return a.lanes + b.lanes; }
  friend Pack operator-(Pack a, Pack b) { return a.lanes - b.lanes; }
  friend Pack operator*(Pack a, Pack b) { return a.lanes * b.lanes; }
  friend Pack operator/(Pack a, Pack b) { return a.lanes / b.lanes; }
  friend Pack operator-(Pack a) { return -a.lanes; }
  friend Mask operator>(Pack a, Pack b) { return a.lanes > b.lanes; }
  friend Pack select(Mask which, Pack yes, Pack no) { return which ? yes.lanes : no.lanes; }
  friend Pack square_root(Pack a) {
    for (int i = 0; i < width; ++i) a.lanes[i] = std::sqrt(a.lanes[i]);
    return a;
  }
};

}  // namespace viscera::sim
