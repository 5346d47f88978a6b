// The forces of element effects at a state, in double, for what is known about a run without asking
// its solver.
#pragma once

#include <algorithm>
#include <optional>
#include <span>
#include <vector>

#include "sim/base/parallel.hpp"
#include "sim/model/state.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

using VertexField = std::vector<Vec3<double>>;

// One element at displacements u, and d over a substep; `history` is what an effect with a history
// keeps of it.
template <class Effect>
void evaluate_element(const typename Effect::template Rest<double>& rest, const double* history,
                      const Vec3<double> (&u)[Effect::arity],
                      const Vec3<double> (&d)[Effect::arity],
                      Evaluation<double, Effect::rows, Effect::arity>& out) {
  if constexpr (history_of < Effect >> 0) {
    Effect::evaluate(rest, history, u, d, out);
  } else {
    Effect::evaluate(rest, u, d, out);
  }
}

// History variables of the elements of all effects among `effects`.
template <class Slots>
std::size_t history_numbers(const Slots& effects) {
  std::size_t numbers = 0;
  for_each_slot<EffectKind::element>(effects, [&]<class Effect>(const auto& effect) {
    numbers += effect.vertices.size() * history_of<Effect>;
  });
  return numbers;
}

// Those of a state, effect after effect; none of a solver that keeps no history, as quasi-static
// ones do.
template <class Slots>
std::optional<std::span<const double>> history_of_elements(const Slots& effects,
                                                           const State& state) {
  if (state.history.size() != history_numbers(effects)) return std::nullopt;
  return std::span<const double>(state.history);
}

// The force of one element, N, with the material's full damping: an explicit solver may lower it.
template <class Effect>
void element_force(typename Effect::template Rest<double> rest, const double* history,
                   const Vec3<double> (&u)[Effect::arity], const Vec3<double> (&d)[Effect::arity],
                   Vec3<double> (&force)[Effect::arity]) {
  if constexpr (requires { rest.cautious; }) rest.cautious = 0.0;
  Evaluation<double, Effect::rows, Effect::arity> c;
  evaluate_element<Effect>(rest, history, u, d, c);
  if constexpr (is_constraint<Effect>) {
    const double mobility[Effect::arity] = {};  // of no concern to a force
    impulses_of<Arithmetic::force>(c, mobility, 1.0, 1.0, static_cast<double*>(nullptr), force);
  } else {
    std::copy(std::begin(c.preload), std::end(c.preload), force);
  }
}

// Adds the forces of all elements of an effect to their vertices, at the displacements u and, where
// it is not empty, the displacements d over a substep. Elements are evaluated side by
// side and added up in their order, so that the sums do not depend on the number of cores.
template <class Effect>
void add_forces(const Prepared<Effect, double>& effect, std::span<const double> history,
                const VertexField& u_all, const VertexField& d_all, VertexField& sum) {
  constexpr int arity = Effect::arity;
  constexpr std::size_t at_once = 1 << 16;
  struct Forces {
    Vec3<double> of[arity];
  };
  std::vector<Forces> forces(std::min(at_once, effect.vertices.size()));
  for (std::size_t first = 0; first < effect.vertices.size(); first += at_once) {
    const std::size_t count = std::min(at_once, effect.vertices.size() - first);
    parallel_ranges(count, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) {
        const std::size_t e = first + k;
        Vec3<double> u[arity], d[arity];
        for (int i = 0; i < arity; ++i) {
          const int v = effect.vertices[e][i];
          u[i] = u_all[v];
          d[i] = d_all.empty() ? Vec3<double>{} : d_all[v];
        }
        element_force<Effect>(effect.rest[e], history.data() + e * history_of<Effect>, u, d,
                              forces[k].of);
      }
    });
    for (std::size_t k = 0; k < count; ++k) {
      for (int i = 0; i < arity; ++i) sum[effect.vertices[first + k][i]] += forces[k].of[i];
    }
  }
}

}  // namespace viscera::sim
