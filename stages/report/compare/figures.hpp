// The source paper's figures, of runs of ours. Each returns where its pictures stand, for captions.
#pragma once

#include "stages/report/compare/raster.hpp"
#include "stages/report/compare/runs.hpp"

namespace viscera {

using RunList = std::vector<const ComparedRun*>;

// One a run. By solver: pbd yellow, xpbd red, fem blue, tled green; runs of a solver that an
// earlier one has take others.
std::vector<Colour> colours_of(const RunList& runs);

struct Figure {
  Image image;
  Json caption;  // what stands where
};

// Figure 2: a row for each run, columns at equal times from before first contact to rest.
Figure grid_figure(const RunList& rows, int columns);

// Figure 3: each run in its colour, side by side, at its own greatest deformation.
Figure side_by_side_figure(const RunList& runs);

// Figure 4: the second over each of the others, outlined, all at the time of its greatest
// deformation.
Figure overlay_figure(const RunList& runs);

// The run's body with its points (mm) in other places and colours, from two sides.
Figure shape_figure(const ComparedRun& run, const std::vector<float>& xyz,
                    const std::vector<Colour>& colours);

}  // namespace viscera
