// The beam of tests/measured/beam.hpp: E is fitted on its own weight, on each mesh its own, which
// takes up what the mesh locks; what the beam does under a load at its tip, and how fast it swings,
// is predicted.
#include <fmt/format.h>

#include "tests/measured/beam.hpp"
#include "tests/verification/problems.hpp"

namespace viscera::sim {
namespace {

// The end state of a beam under a scene.
using Settle = std::function<State(const Model&, const Scene&)>;

// From the lowest points of the tip after the beam, held straight, is let go. Without damping,
// which at the measured ratio of .06 changes the frequency by .2 %.
double frequency_hz(const Beam& beam) {
  Scene scene = Beam::scene(false);
  scene.time = {.frame_s = 1.0 / 480.0, .substeps = 16, .end_s = 1.0};
  Run run(beam.model, scene, xpbd(Scheme::gauss_seidel, Precision::fp64));
  std::vector<double> lowest;
  double before = 0.0, now = 0.0;
  while (lowest.size() < 3 && run.time() < 1.0) {
    run.advance();
    const double next = Beam::mean(beam.drops_mm(run.state()));
    if (now > before && now >= next) {
      const double peak = 0.5 * (before - next) / (before - 2.0 * now + next);
      lowest.push_back(run.time() + (peak - 1.0) * run.scene().time.frame_s);
    }
    before = now, now = next;
  }
  return lowest.size() < 3 ? 0.0 : 2.0 / (lowest[2] - lowest[0]);
}

std::string listed(const std::array<double, 3>& drops) {
  return fmt::format("{:.2f}/{:.2f}/{:.2f} mm", drops[0], drops[1], drops[2]);
}

Outcome measured_beam(std::array<int, 3> cells, const Settle& settle, bool swings) {
  Beam beam(cells);
  beam.fit_to_own_weight(settle);
  const auto weight = beam.drops_mm(settle(beam.model, Beam::scene(false)));
  const auto loaded = beam.drops_mm(settle(beam.model, Beam::scene(true)));
  Outcome outcome = {
      {{"own weight (fitted), over 1 mm or 5 %", Beam::worst_miss(weight, Beam::weight_mm), 1.0},
       {"loaded, over 1 mm or 5 %", Beam::worst_miss(loaded, Beam::loaded_mm), 1.0}},
      fmt::format("E {:.1f} kPa, own weight {}, loaded {} (measured {})",
                  1e-3 * beam.youngs_modulus(), listed(weight), listed(loaded),
                  listed(Beam::loaded_mm)),
      ""};
  if (!swings) return outcome;
  const double hz = frequency_hz(beam);
  outcome.measures.push_back({"frequency off by", std::abs(hz / Beam::own_weight_hz - 1.0), 0.05});
  outcome.note += fmt::format(", {:.2f} Hz (measured {:.2f})", hz, Beam::own_weight_hz);
  return outcome;
}

Settle newton(int order) {
  return [order](const Model& model, const Scene& scene) {
    return equilibrium_from(at_rest(model), model, scene, order);
  };
}

State settled_by_xpbd(const Model& model, const Scene& scene) {
  Run run(model, scene, xpbd(Scheme::gauss_seidel, Precision::fp64));
  run.settle(1e-6, 2.5, 0.6);
  return run.state();
}

}  // namespace

void add_measured_problems(std::vector<Row>& rows) {
  const auto add = [&rows](const char* solver, std::array<int, 3> cells, const Settle& settle,
                           bool swings) {
    rows.push_back({"measured",
                    fmt::format("silicone beam, {} tets", 5 * cells[0] * cells[1] * cells[2]),
                    solver, "fp64", [=] { return measured_beam(cells, settle, swings); }});
  };
  add("fem, quadratic", {10, 4, 5}, newton(2), false);
  add("fem", {20, 4, 5}, newton(1), false);
  add("xpbd gauss_seidel, 64 × 1", {20, 4, 5}, settled_by_xpbd, true);
}

}  // namespace viscera::sim
