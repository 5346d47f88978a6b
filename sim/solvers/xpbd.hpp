// Extended position based dynamics with small steps: one Gauss-Seidel sweep over the constraints a
// substep, colour by colour (Macklin et al., "XPBD", MIG 2016; "Small Steps in Physics Simulation",
// SCA 2019). This file holds the arithmetic of one vertex and of one element, which both backends
// call, and the data that they run on.
//
// A substep, with d the displacement over it:
//   begin_vertex      d = dt v
//   force effects     d += dt^2 a
//   contact effects   push: d leads out of the obstacle
//   element effects   d += dt^2 M^-1 f(C), one element after the other by colour
//   contact effects   rub: d loses what friction takes
//   end_vertex        u += d, v = d / dt
// The velocity is d / dt and never a difference of two positions, so single precision keeps gravity
// at any substep. One sweep starts from zero multipliers, so none is stored.
#pragma once

#include "sim/coloring.hpp"
#include "sim/model.hpp"
#include "sim/scene.hpp"

namespace viscera::sim {

// (I + A S) y = -C for one or two rows, with A_ab = sum_i w_i g_a . g_b and S = diag(k dt^2):
// XPBD's (A + diag(alpha/dt^2)) dlambda = -C divided by the compliance, dlambda = S y. Every term
// has no dimension, so neither tiny nor huge bodies over- or underflow, and no epsilon is needed.
template <class T>
SIM_HD void solve_rows(const T (&a)[1][1], const T (&c)[1], T (&y)[1]) {
  y[0] = -c[0] / (T(1) + a[0][0]);
}
template <class T>
SIM_HD void solve_rows(const T (&a)[2][2], const T (&c)[2], T (&y)[2]) {
  // A is positive semi-definite, so its scaled determinant is not negative but for rounding.
  const T product = a[0][0] * a[1][1] - a[0][1] * a[1][0];
  const T determinant = T(1) + a[0][0] + a[1][1] + select(product > T(0), product, T(0));
  const T scale = T(-1) / determinant;
  y[0] = scale * ((T(1) + a[1][1]) * c[0] - a[0][1] * c[1]);
  y[1] = scale * ((T(1) + a[0][0]) * c[1] - a[1][0] * c[0]);
}

// Adds to the preload the force of the multipliers that the preload leaves to be found. `mobility`
// is dt^2 / m by vertex.
template <class T, int rows, int arity>
SIM_HD void add_multipliers(Evaluation<T, rows, arity>& c, const T (&mobility)[arity]) {
  T a[rows][rows], residual[rows], y[rows];
  for (int p = 0; p < rows; ++p) {
    residual[p] = c.remainder[p];
    for (int i = 0; i < arity; ++i) {
      residual[p] += mobility[i] * dot(c.gradient[p][i], c.preload[i]);
    }
    for (int q = 0; q < rows; ++q) {
      T sum = T(0);
      for (int i = 0; i < arity; ++i) sum += mobility[i] * dot(c.gradient[p][i], c.gradient[q][i]);
      a[p][q] = sum * c.stiffness[q];
    }
  }
  solve_rows(a, residual, y);
  for (int p = 0; p < rows; ++p) {
    for (int i = 0; i < arity; ++i) c.preload[i] += (c.stiffness[p] * y[p]) * c.gradient[p][i];
  }
}

// The correction of one element to d, the displacements of its vertices over the substep.
template <class Effect, class T, int arity = Effect::arity>
SIM_HD void correct_element(const typename Effect::template Rest<T>& rest,
                            const T (&mobility)[arity], const Vec3<T> (&u)[arity],
                            Vec3<T> (&d)[arity]) {
  Evaluation<T, Effect::rows, arity> c;
  Effect::evaluate(rest, u, d, c);
  if constexpr (Effect::rows > 0) add_multipliers(c, mobility);
  for (int i = 0; i < arity; ++i) d[i] += mobility[i] * c.preload[i];
}

// A fixed vertex has inverse mass 0 and stays where it is.
template <class T>
SIM_HD Vec3<T> begin_vertex(T w, const Vec3<T>& v, T dt) {
  return w > T(0) ? dt * v : Vec3<T>{};
}
template <class T>
SIM_HD void end_vertex(const Vec3<T>& d, T dt, Vec3<T>& u, Vec3<T>& v) {
  u += d;
  v = (T(1) / dt) * d;
}

// What one effect needs on a device, made only when the scene names it.
template <class Effect, class T, EffectKind kind = Effect::kind>
struct Prepared {  // force and contact effects
  typename Effect::template Device<T> device;

  Prepared(const Model& model, const typename Effect::Params& params, double)
      : device(Effect::template device<T>(model, params)) {}
};

template <class Effect, class T>
struct Prepared<Effect, T, EffectKind::element> {
  using Vertices = std::array<int, Effect::arity>;
  std::vector<Vertices> vertices;                       // in order of colour
  std::vector<typename Effect::template Rest<T>> rest;  // likewise
  std::vector<int> color_begin;                         // [colours + 1]

  Prepared(const Model& model, const typename Effect::Params& params, double dt) {
    const auto& elements = Effect::elements(model, params);
    const Coloring coloring =
        color_elements<Effect::arity>(std::span<const Vertices>(elements), model.vertex_count());
    color_begin = coloring.color_begin;
    vertices.reserve(elements.size());
    rest.reserve(elements.size());
    for (const int e : coloring.order) {
      vertices.push_back(elements[e]);
      rest.push_back(Effect::template rest<T>(model, e, params, dt));
    }
  }
};

// function.template operator()<Effect>(slot) for every filled slot of one kind of effect, in the
// registry's order.
template <EffectKind kind, class Slots, class Function>
void for_each_slot(const Slots& slots, Function&& function) {
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (Effect::kind == kind) {
      if (const auto& slot = std::get<i>(slots)) function.template operator()<Effect>(*slot);
    }
  });
}

// Everything constant that a run of the XPBD solver needs, on the host.
template <class T>
struct XpbdProgram {
  template <class Effect>
  using Slot = Prepared<Effect, T>;

  std::vector<Vec3<T>> rest;    // [n] m
  std::vector<T> inverse_mass;  // [n] 1/kg, 0 for fixed vertices
  Effects::Slots<Slot> effects;
  T dt;
  int substeps;

  XpbdProgram(const Model& model, const Scene& scene)
      : dt(static_cast<T>(scene.time.substep_s())), substeps(scene.time.substeps) {
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      rest.push_back(cast<T>(model.rest[i]));
      inverse_mass.push_back(model.fixed[i] ? T(0) : static_cast<T>(1.0 / model.mass[i]));
    }
    Effects::for_each([&]<class Effect, std::size_t i>() {
      const auto& params = std::get<i>(scene.effects);
      if (params) std::get<i>(effects).emplace(model, *params, scene.time.substep_s());
    });
  }

  template <EffectKind kind, class Function>
  void for_each_active(Function&& function) const {
    for_each_slot<kind>(effects, function);
  }
};

}  // namespace viscera::sim
