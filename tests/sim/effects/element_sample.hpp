// One element of an effect, for the tests of all of them and of single laws.
#pragma once

#include "tests/sim/shapes.hpp"

namespace viscera::sim {

// Displaced at random, with a history.
template <class Effect>
struct Sample {
  Model model = make_cube(1);
  typename Effect::Params params = sample_params<Effect>();
  std::array<int, Effect::arity> vertices;
  typename Effect::template Rest<double> rest;
  Vec3<double> u[Effect::arity], d[Effect::arity];
  double history[history_of<Effect> + 1];

  explicit Sample(unsigned seed) {
    const auto& elements = Effect::elements(model, params);
    vertices = elements[0];
    rest = Effect::template rest<double>(model, elements, 0, params, 1e-3);
    std::mt19937 generator(seed);
    for (auto& a : u) a = random_vector(generator, 0.01);
    for (auto& a : d) a = random_vector(generator, 1e-5);
    for (auto& number : history) number = random_in(generator, -0.1, 0.1);
  }
  auto evaluate() const {
    Evaluation<double, Effect::rows, Effect::arity> out{};
    if constexpr (history_of < Effect >> 0) {
      Effect::evaluate(rest, history, u, d, out);
    } else {
      Effect::evaluate(rest, u, d, out);
    }
    return out;
  }
  double energy() const {
    const auto out = evaluate();
    double sum = 0.0;
    for (int row = 0; row < Effect::rows; ++row) {
      sum += 0.5 * out.stiffness[row] * out.value[row] * out.value[row];
    }
    return sum;
  }
};

}  // namespace viscera::sim
