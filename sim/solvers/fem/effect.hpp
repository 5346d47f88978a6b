// Any element effect of the registry as a term of the finite elements: its force as explicit
// dynamics takes it (arithmetic.hpp), its tangent by automatic differentiation of that force.
#pragma once

#include <cstring>

#include "sim/solvers/fem/dual.hpp"
#include "sim/solvers/fem/term.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

// The force of one element at u + d, N, and the potential of its constraints, J.
template <class Effect, class T>
T element_force(const typename Effect::template Rest<T>& rest, const T* history,
                const Vec3<T> (&u)[Effect::arity], const Vec3<T> (&d)[Effect::arity],
                Vec3<T> (&force)[Effect::arity]) {
  Evaluation<T, Effect::rows, Effect::arity> c;
  if constexpr (history_of < Effect >> 0) {
    Effect::evaluate(rest, history, u, d, c);
  } else {
    Effect::evaluate(rest, u, d, c);
  }
  T energy(0);
  if constexpr (Effect::rows > 0) {
    const T mobility[Effect::arity] = {};  // of no concern to a force
    impulses_of<Arithmetic::force>(c, mobility, T(1), T(1), static_cast<T*>(nullptr), force);
    for (int row = 0; row < Effect::rows; ++row) {
      energy += T(0.5) * c.stiffness[row] * c.value[row] * c.value[row];
    }
  } else {
    std::copy(std::begin(c.preload), std::end(c.preload), force);
  }
  return energy;
}

// A struct of doubles as one of numbers of another type.
template <class To, class D, class From>
To as_constants(const From& constants) {
  constexpr std::size_t numbers = sizeof(From) / sizeof(double);
  To out;
  static_assert(sizeof(out) == numbers * sizeof(D));
  std::array<double, numbers> from;
  std::array<D, numbers> to;
  std::memcpy(from.data(), &constants, sizeof(constants));
  for (std::size_t k = 0; k < numbers; ++k) to[k] = D(from[k]);
  std::memcpy(static_cast<void*>(&out), to.data(), sizeof(out));
  return out;
}

template <class Effect>
constexpr bool is_linear_in_motion = [] {
  if constexpr (requires { Effect::linear_in_motion; }) return Effect::linear_in_motion;
  return false;
}();

template <class Effect>
class EffectTerm final : public FemTerm {
 public:
  static constexpr int arity = Effect::arity, size = 3 * arity;
  using Rest = typename Effect::template Rest<double>;
  using Matrix = Eigen::Matrix<double, size, size>;

  // Refers to the effect, which was prepared for a time of `prepared_s`.
  EffectTerm(const Prepared<Effect, double>& effect, double prepared_s)
      : vertices_(effect.vertices),
        rest_(effect.rest),
        prepared_s_(prepared_s),
        history_(effect.vertices.size() * history_of<Effect>) {}

  void connect(FemSystem& system) override {
    for (const auto& nodes : vertices_) system.connect(nodes);
  }
  void take_places(const FemSystem& system) override {
    for (const auto& nodes : vertices_) places_.push_back(system.places_of<arity>(nodes));
  }
  void begin_step(const FemFields& fields) override {
    if constexpr (history_of < Effect >> 0) {
      history_before_ = history_;
      for (std::size_t e = 0; e < vertices_.size(); ++e) {
        Vec3<double> u[arity];
        for (int i = 0; i < arity; ++i) u[i] = fields.start[vertices_[e][i]];
        Effect::update_history(rest(e, fields), u, &history_[e * history_of<Effect>]);
      }
    }
  }
  void undo_step() override {
    if constexpr (history_of < Effect >> 0) history_ = history_before_;
  }

  void add_forces(const FemFields& fields, FemForces& forces) const override {
    for (std::size_t e = 0; e < vertices_.size(); ++e) {
      Vec3<double> u[arity], d[arity], force[arity];
      for (int i = 0; i < arity; ++i) {
        u[i] = fields.u[vertices_[e][i]], d[i] = fields.d[vertices_[e][i]];
      }
      forces.add_energy(element_force<Effect>(rest(e, fields), history_of_element(e), u, d, force));
      for (int i = 0; i < arity; ++i) {
        if constexpr (is_constraint<Effect>) {
          forces.add(vertices_[e][i], force[i]);
        } else {
          forces.add_loose(vertices_[e][i], share(fields) * force[i]);
        }
      }
    }
  }

  void add_tangent(const FemFields& fields, Tangent kind, FemSystem& system) const override {
    for (std::size_t e = 0; e < vertices_.size(); ++e) {
      Matrix k = share(fields) * tangent(e, fields);
      if (kind == Tangent::definite) make_definite<size>(k);
      system.add<arity>(vertices_[e], places_[e], k);
    }
  }

  void save_history(std::vector<double>& history) const override {
    history.insert(history.end(), history_.begin(), history_.end());
  }
  void load_history(std::span<const double>& history) override {
    if (history.size() < history_.size()) {  // the state of another solver
      std::ranges::fill(history_, 0.0);
    } else {
      std::copy_n(history.begin(), history_.size(), history_.begin());
      history = history.subspan(history_.size());
    }
  }

 private:
  // What has a history goes through all of the step, and a rate acts over the time that forces do.
  Rest rest(std::size_t e, const FemFields& fields) const {
    Rest own = rest_[e];
    if constexpr (requires { Effect::stretch(own, 1.0); }) {
      Effect::stretch(own, (is_rate_force<Effect> ? fields.step.dt : fields.whole_s) / prepared_s_);
    }
    // An implicit step is stable whatever the viscosity.
    if constexpr (requires { own.cautious; }) own.cautious = 0.0;
    return own;
  }
  const double* history_of_element(std::size_t e) const {
    return history_.data() + e * history_of<Effect>;
  }

  // Forces without a constraint are loads.
  static double share(const FemFields& fields) { return is_constraint<Effect> ? 1.0 : fields.load; }

  // -d force / d x, its symmetric part.
  Matrix tangent(std::size_t e, const FemFields& fields) const {
    const Matrix k = [&] {
      if constexpr (is_linear_in_motion<Effect>)
        return tangent_by_unit_moves(e, fields);
      else
        return tangent_by_differentiation(e, fields);
    }();
    return 0.5 * (k + k.transpose());
  }

  // A linear force needs no derivatives: its slope is what unit moves call forth.
  Matrix tangent_by_unit_moves(std::size_t e, const FemFields& fields) const {
    const Rest own = rest(e, fields);
    Vec3<double> u[arity], force[arity];
    for (int i = 0; i < arity; ++i) u[i] = fields.u[vertices_[e][i]];
    Matrix k;
    for (int j = 0; j < size; ++j) {
      Vec3<double> d[arity] = {};
      component(d[j / 3], j % 3) = 1.0;
      element_force<Effect>(own, history_of_element(e), u, d, force);
      for (int i = 0; i < size; ++i) k(i, j) = -component(force[i / 3], i % 3);
    }
    return k;
  }

  Matrix tangent_by_differentiation(std::size_t e, const FemFields& fields) const {
    using D = Dual<size>;
    Vec3<D> u[arity], d[arity], force[arity];
    for (int i = 0; i < arity; ++i) {
      const Vec3<double>& own = fields.d[vertices_[e][i]];
      u[i] = cast<D>(fields.u[vertices_[e][i]]);
      d[i] = {D::variable(own.x, 3 * i), D::variable(own.y, 3 * i + 1),
              D::variable(own.z, 3 * i + 2)};
    }
    D history[history_of<Effect> + 1];
    for (int k = 0; k < history_of<Effect>; ++k) history[k] = D(history_of_element(e)[k]);
    element_force<Effect>(as_constants<typename Effect::template Rest<D>, D>(rest(e, fields)),
                          history, u, d, force);
    Matrix k;
    for (int i = 0; i < size; ++i) {
      for (int j = 0; j < size; ++j) k(i, j) = -component(force[i / 3], i % 3).slope[j];
    }
    return k;
  }

  template <class T>
  static T& component(Vec3<T>& v, int axis) {
    return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
  }

  const std::vector<std::array<int, arity>>& vertices_;
  const std::vector<Rest>& rest_;
  double prepared_s_;  // s
  std::vector<double> history_, history_before_;
  std::vector<FemSystem::Places<arity>> places_;
};

}  // namespace viscera::sim
