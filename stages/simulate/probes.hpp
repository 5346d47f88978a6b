// Points and centroids that a run is to follow, as its parameter `probes` names them.
#pragma once

#include <vector>

#include "sim/model/probe.hpp"
#include "stages/program/stage_main.hpp"

namespace viscera {

// The parameter: {tip: {point: [10 mm, -4 mm, 870 mm]}, lump: {centroid: tumour}}.
Param probes_param();

// Throws Error(bad_config) for what names no probe, whatever the body.
void check_probes(const StageRun& run);

// The probes of a body. Throws Error(bad_config) for a label that it does not have, and
// sim::Refusal for a point outside of it.
std::vector<sim::Probe> read_probes(const StageRun& run, const sim::Model& model);

// Where a probe is that has moved by u, m: LPS mm.
sim::Vec3<double> place_mm(const sim::Model& model, const sim::Probe& probe,
                           const sim::Vec3<double>& u);

}  // namespace viscera
