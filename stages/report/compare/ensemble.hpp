// How sure a result is: runs of one mesh under different assumptions, at their ends. Every run
// counts alike: the spread is that of the assumptions which the spec lists, no more.
#pragma once

#include "stages/report/compare/figures.hpp"

namespace viscera {

struct Ensemble {
  // { runs, left_out: [names], largest_spread_mm, labels: [{name, moved_mm: {mean, least, most},
  //   centre_mm: [x, y, z], spread_mm: [x, y, z], radius_mm}] }
  // moved: of the label's centre from its place in the scan; spread: standard deviations along the
  // axes; radius: the least that holds 95 % of the runs' centres around the mean one.
  Json json;
  std::vector<float> mean_xyz;    // mm, per point
  std::vector<double> spread_mm;  // per point: root of the variances' sum
};

// Runs that diverged are left out. Throws Error(bad_config) for runs of different meshes and for
// less than two that count.
Ensemble ensemble_of(const RunList& runs);

// The mean shape, coloured by spread from 0 (dark) to the largest (bright).
Figure ensemble_figure(const ComparedRun& run, const Ensemble& ensemble);

}  // namespace viscera
