// The same problem as small as a cell and as large as a town, and far from the origin: a clamped
// bar that begins bent upwards and swings in its own weight for a quarter of its time. (PBD's knows
// no weight to speak of, and goes back to its shape.)
#include <fmt/format.h>

#include "tests/hard_cases/cases.hpp"

namespace viscera::sim {
namespace {

State bent(const Model& model, double scale) {
  State state = at_rest(model);
  for (std::size_t i = 0; i < state.u.size(); ++i) {
    const double share = model.rest[i].x / (0.6 * scale) + 0.5;  // of its length, from the left
    state.u[i].z = 0.1 * scale * share * share;
  }
  return state;
}

// E/(rho g L) and g T^2/L are the same at every scale.
State swing(const SolverOptions& options, double scale, Vec3<double> corner = {}) {
  Material material = soft_tissue;
  material.youngs_modulus *= 10.0 * scale;
  material.damping *= std::sqrt(scale);
  Model model = make_box({0.6 * scale, 0.2 * scale, 0.2 * scale}, {6, 2, 2}, material, corner);
  clamp_left(model);
  Scene scene = weighty_scene(options);
  scene.time.frame_s = std::sqrt(scale) / 60.0;
  Run run(model, scene, options);
  run.start_from(bent(model, scale));
  for (int frame = 0; frame < 20 && run.finite(); ++frame) run.advance();
  State state = run.state();
  for (auto& u : state.u) u *= 1.0 / scale;
  return state;
}

Outcome compare(const SolverOptions& options, const State& found, double bound) {
  const Model model = make_box({0.6, 0.2, 0.2}, {6, 2, 2}, soft_tissue);
  const State plain = swing(options, 1.0);
  return {{{"difference / L", rms_difference(model, found, plain), bound}},
          fmt::format("after a way of {:.2f} L", rms_difference(model, plain, bent(model, 1.0))),
          ""};
}

}  // namespace

void add_scale_cases(std::vector<Row>& rows) {
  for (const double scale : {1e-6, 1e-3, 1e3}) {
    add_case(rows, "11", fmt::format("size {:g} m against 1 m", scale),
             [scale](const SolverOptions& options) {
               return compare(options, swing(options, scale), 1e-4);
             });
  }
  for (const double far : {1e3, 1e6}) {
    add_case(rows, "12", fmt::format("{:g} m from the origin", far),
             [far](const SolverOptions& options) {
               return compare(options, swing(options, 1.0, {far, -far, 0.5 * far}), 1e-5);
             });
  }
}

}  // namespace viscera::sim
