#include "tests/verification/problems.hpp"

namespace viscera::sim {

Model judged_bar(std::array<int, 3> cells, double youngs_modulus, double poisson_ratio) {
  const Material material = {.youngs_modulus = youngs_modulus,
                             .poisson_ratio = poisson_ratio,
                             .density = 1060.0,
                             .damping = 0.01};
  Model model = make_five_tet_box({0.1, 0.03, 0.03}, cells, material);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = model.rest[i].x + model.origin.x < 1e-9;
  }
  return model;
}

double tip_mm(const Model& model, const State& state) {
  double sum = 0.0, count = 0.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    if (model.rest[i].x + model.origin.x < 0.1 - 1e-9) continue;
    sum += 1e3 * state.u[i].z;
    count += 1.0;
  }
  return sum / count;
}

double relative_error(const Model& model, const State& found, const State& reference) {
  return rms_difference(model, found, reference) / rms_difference(model, reference, at_rest(model));
}

Scene own_weight(const Model& model, Element element) {
  Scene scene = own_weight();
  set_element(scene.effects, element, model.largest_poisson_ratio());
  return scene;
}

Scene own_weight() {
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  scene.params<Gravity>().emplace_back();
  return scene;
}

const char* name_of(Precision precision) {
  return precision == Precision::fp32 ? "fp32" : "fp64";
}

SolverOptions xpbd(Scheme scheme, Precision precision, int iterations) {
  return {.scheme = scheme, .precision = precision, .iterations = iterations, .threads = 1};
}

}  // namespace viscera::sim
