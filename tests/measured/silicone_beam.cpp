#include <fmt/format.h>

#include "tests/measured/beam.hpp"
#include "tests/measured/page.hpp"
#include "tests/measured/ways.hpp"
#include "tests/results/run.hpp"

namespace viscera::sim {
namespace {

// The drops of the markers as bars: measured, with what repeats differ by, and computed.
std::string picture(const std::vector<std::pair<std::string, std::array<double, 3>>>& computed) {
  const char* const colours[] = {"#1b6ca8", "#d1495b", "#8d99ae", "#66a182"};
  Drawing drawing({-6.0, -8.0}, {64.0, 22.0}, 9.0);
  for (int m = 0; m < 3; ++m) {
    const double at = 17.0 * m, measured = Beam::loaded_mm[m];
    drawing.line({{at, 0.0}, {at, measured}}, "#222", 20.0);
    drawing.line({{at, measured - 1.0}, {at, measured + 1.0}}, "#f2b134", 3.0);
    for (std::size_t k = 0; k < computed.size(); ++k) {
      const double x = at + 2.5 * (1.0 + static_cast<double>(k));
      drawing.line({{x, 0.0}, {x, computed[k].second[m]}}, colours[k % 4], 16.0);
    }
    drawing.text({at, -2.0}, fmt::format("marker {}", m));
  }
  for (std::size_t k = 0; k < computed.size(); ++k) {
    drawing.text({16.0 * static_cast<double>(k), -5.0}, computed[k].first, colours[k % 4]);
  }
  drawing.text({-5.0, 20.5}, "drop, mm, under the load; black: measured, repeats within the mark");
  return drawing.svg();
}

}  // namespace

MeasuredBody silicone_beam() {
  MeasuredBody body{
      .name = "Silicone beam",
      .about =
          "10 x 3 x 3 cm, clamped at one end; three markers on the face of its tip (Dubied et al., "
          "RA-L 2022, arXiv 2201.12560). nu .499 and 1,070 kg/m3 are the authors'. E is fitted to "
          "the drops under its own weight, by quadratic tets alone; what the beam does with .51 N "
          "on the top edge of its tip is predicted. Repeats differ by up to 1 mm. 8,000 tets. The "
          "error is that of the worst marker."};
  Beam beam({20, 8, 10});
  const State rest = at_rest(beam.model);
  beam.fit_to_own_weight([&](const Model& model, const Scene& scene) {
    return ways().front().settle(model, scene, rest).state;
  });
  std::vector<std::pair<std::string, std::array<double, 3>>> computed;
  for (const Way& way : ways()) {
    for (const bool loaded : {false, true}) {
      const auto [state, seconds] = way.settle(beam.model, Beam::scene(loaded), rest);
      const auto drops = beam.drops_mm(state);
      const auto& measured = loaded ? Beam::loaded_mm : Beam::weight_mm;
      int worst = 0;
      for (int m = 1; m < 3; ++m) {
        if (std::abs(drops[m] - measured[m]) > std::abs(drops[worst] - measured[worst])) worst = m;
      }
      const bool fitted = !loaded && way.name == ways().front().name;
      body.rows.push_back(
          {loaded ? "loaded" : "own weight", "drop of a marker", way.name,
           std::abs(drops[worst] - measured[worst]),
           std::max(Beam::allowed_mm, Beam::allowed_share * measured[worst]), Beam::allowed_mm,
           "mm",
           fmt::format(
               "{}drops {:.2f} / {:.2f} / {:.2f}, measured {:.2f} / {:.2f} / {:.2f}",
               fitted ? fmt::format("fitted: E {:.1f} kPa; ", 1e-3 * beam.youngs_modulus()) : "",
               drops[0], drops[1], drops[2], measured[0], measured[1], measured[2]),
           seconds});
      if (loaded) computed.emplace_back(way.name, drops);
    }
  }
  body.pictures.push_back(
      {"silicone_beam.svg", "Drops of the markers under the load.", picture(computed)});
  return body;
}

}  // namespace viscera::sim
