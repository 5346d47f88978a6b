// Smooth fields from masks, on the voxel grid: a Gaussian in mm, and the level whose interior has
// the volume of the voxels. Lengths in mm, volumes in mm3; the field is trilinear between voxel
// centres and lives in the voxel-mm frame (index times spacing).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "stages/image/label_image.hpp"

namespace viscera {

using Field = std::vector<float>;  // one value per voxel, 1 well inside and 0 well outside

// Gaussian of standard deviation `sigma` mm, cut off at 4 sigma; outside the volume there is 0.
Field smooth(const Frame& frame, const std::vector<std::uint8_t>& mask, double sigma);

// The same, after which what the interior of the level 1/2 lacks of the mask, or has beyond it, is
// added back twice under a wider Gaussian: a Gaussian alone takes from what is thin or bends
// outwards, and gives to what bends inwards. Steps of a voxel, which are as often too much as too
// little within the wider one, stay smoothed. To add the residual back is Tukey's twicing
// ("Exploratory Data Analysis", 1977, section 16D), of the interior in place of the field. Values
// leave [0, 1] by some tenths.
Field smooth_keeping_volume(const Frame& frame, const std::vector<std::uint8_t>& mask,
                            double sigma);
inline constexpr double reach_of_smoothing = 16.0;  // sigmas beyond the mask, where it ends at 0

// The sigma used where none is asked for: 0.8 of the largest spacing, which removes the staircase
// and little else.
double default_sigma(const Frame& frame);

// Trilinear value at `p` (voxel-mm); 0 outside the grid.
double sample(const Frame& frame, const Field& field, const std::array<double, 3>& p);

// Volume of {field > level}, from 27 samples in every cell that the level cuts.
double volume_above(const Frame& frame, const Field& field, double level);

// The level in (0, 1) at which volume_above equals `volume` to about 1e-4 of it.
double matched_level(const Frame& frame, const Field& field, double volume);

// The field less so much of `share` that what is above `level` has this volume: the surface moves
// in proportion to `share`, in [0, 1] and more than 0 somewhere.
Field matched_field(const Frame& frame, const Field& field, const Field& share, double level,
                    double volume);

}  // namespace viscera
