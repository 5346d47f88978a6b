#include "sim/model/locking.hpp"

#include <algorithm>
#include <cmath>

#include "sim/model/surface.hpp"
#include "sim/model/tet_groups.hpp"

namespace viscera::sim {

double locking_loss(double cell_over_thickness, double poisson_ratio, Element element) {
  if (element == Element::quadratic) return 0.0;
  const double lambda_over_mu = 2.0 * poisson_ratio / (1.0 - 2.0 * poisson_ratio);
  const double squared = cell_over_thickness * cell_over_thickness;
  if (element == Element::smoothed) {
    // Of what edges keep beside groups (tet_groups.hpp), less what groups give way themselves.
    const double kept = lambda_of_edges({lambda_over_mu, 1.0});
    const double of_edges = 0.172 * std::pow(kept, 0.69);
    const double given = kept < lambda_over_mu ? 0.127 * (9.0 - kept) / 7.5 : 0.0;
    return 1.0 - 1.0 / (1.0 + squared * (of_edges - given));
  }
  const double x = squared * (2.0 + 0.6 * lambda_over_mu);
  return 1.0 - 1.0 / (1.0 + x / (1.0 + x / 7.0));
}

Locking assess_locking(const Model& model, Element element) {
  Locking locking;
  double volume = 0.0, surface = 0.0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    volume += model.volume[t];
  }
  locking.poisson_ratio = model.largest_poisson_ratio();
  for (const Triangle& face : boundary_faces(model)) surface += norm(area_vector(model, face));
  locking.cell = std::cbrt(6.0 * volume / static_cast<double>(model.tet_count()));
  locking.thickness = 4.0 * volume / surface;
  locking.loss = locking_loss(locking.cell / locking.thickness, locking.poisson_ratio, element);
  return locking;
}

}  // namespace viscera::sim
