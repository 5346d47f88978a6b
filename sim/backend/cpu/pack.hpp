// W numbers side by side: an arithmetic type for the effects' templates, so that one instruction
// works on W elements of a colour. Every lane gives the bits that the plain type gives. `Isa` only
// keeps the instances of translation units with different instruction sets apart.
#pragma once

#include <cmath>
#include <type_traits>

#include "sim/base/row.hpp"

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
  // (1 + a)^p - 1, of the law `ogden`
  friend Pack power_minus_one(Pack a, Pack p) {
    for (int i = 0; i < width; ++i) a.lanes[i] = std::expm1(p.lanes[i] * std::log1p(a.lanes[i]));
    return a;
  }
};

// Four packs from the rows of W vertices, and back: lane i of (x, y, z, w) is row vertices[i].
// Whole rows are loaded and turned in registers, which takes a third of the time of 4 W single
// loads.
template <int Isa>
struct Turn {
  using F = typename VectorOf<float>::type;
  using D = typename VectorOf<double>::type;

  static void load(const Row<float>* rows, const int (&vertices)[8], F (&lanes)[4]) {
    F a[4];  // a[i] holds rows i and i + 4
    for (int i = 0; i < 4; ++i) {
      const RowF low = as<const RowF>(rows[vertices[i]]),
                 high = as<const RowF>(rows[vertices[i + 4]]);
      a[i] = __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
    }
    turn(a, lanes);
  }
  static void store(const F (&lanes)[4], const int (&vertices)[8], Row<float>* rows) {
    F a[4];
    turn(lanes, a);
    for (int i = 0; i < 4; ++i) {
      as<RowF>(rows[vertices[i]]) = __builtin_shufflevector(a[i], a[i], 0, 1, 2, 3);
      as<RowF>(rows[vertices[i + 4]]) = __builtin_shufflevector(a[i], a[i], 4, 5, 6, 7);
    }
  }
  static void load(const Row<double>* rows, const int (&vertices)[4], D (&lanes)[4]) {
    D a[4];
    for (int i = 0; i < 4; ++i) a[i] = as<const RowD>(rows[vertices[i]]);
    turn(a, lanes);
  }
  static void store(const D (&lanes)[4], const int (&vertices)[4], Row<double>* rows) {
    D a[4];
    turn(lanes, a);
    for (int i = 0; i < 4; ++i) as<RowD>(rows[vertices[i]]) = a[i];
  }

 private:
  // One register each: memcpy would go through the stack in halves.
  typedef float RowF __attribute__((vector_size(16), may_alias));
  typedef double RowD __attribute__((vector_size(32), may_alias));
  template <class V, class R>
  static V& as(R& row) {
    return reinterpret_cast<V&>(row);
  }

  // The transpose of each half of four rows of eight, and of four rows of four: its own inverse.
  static void turn(const F (&a)[4], F (&b)[4]) {
    const F p = __builtin_shufflevector(a[0], a[1], 0, 8, 1, 9, 4, 12, 5, 13);
    const F q = __builtin_shufflevector(a[0], a[1], 2, 10, 3, 11, 6, 14, 7, 15);
    const F r = __builtin_shufflevector(a[2], a[3], 0, 8, 1, 9, 4, 12, 5, 13);
    const F s = __builtin_shufflevector(a[2], a[3], 2, 10, 3, 11, 6, 14, 7, 15);
    b[0] = __builtin_shufflevector(p, r, 0, 1, 8, 9, 4, 5, 12, 13);
    b[1] = __builtin_shufflevector(p, r, 2, 3, 10, 11, 6, 7, 14, 15);
    b[2] = __builtin_shufflevector(q, s, 0, 1, 8, 9, 4, 5, 12, 13);
    b[3] = __builtin_shufflevector(q, s, 2, 3, 10, 11, 6, 7, 14, 15);
  }
  static void turn(const D (&a)[4], D (&b)[4]) {
    const D p = __builtin_shufflevector(a[0], a[1], 0, 4, 2, 6);
    const D q = __builtin_shufflevector(a[0], a[1], 1, 5, 3, 7);
    const D r = __builtin_shufflevector(a[2], a[3], 0, 4, 2, 6);
    const D s = __builtin_shufflevector(a[2], a[3], 1, 5, 3, 7);
    b[0] = __builtin_shufflevector(p, r, 0, 1, 4, 5);
    b[1] = __builtin_shufflevector(q, s, 0, 1, 4, 5);
    b[2] = __builtin_shufflevector(p, r, 2, 3, 6, 7);
    b[3] = __builtin_shufflevector(q, s, 2, 3, 6, 7);
  }
};

}  // namespace viscera::sim
