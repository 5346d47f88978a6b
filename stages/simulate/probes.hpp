// Points, centroids and gaps that a run is to follow, as its parameter `probes` names them, and
// landmarks of its input of that role (stages/mesh/landmark_io.hpp).
#pragma once

#include <optional>
#include <vector>

#include "sim/measures/gap.hpp"
#include "sim/model/probe.hpp"
#include "stages/image/label_image.hpp"
#include "stages/program/stage_main.hpp"

namespace viscera {

// The parameter: {tip: {point: [10 mm, -4 mm, 870 mm]}, lump: {centroid: tumour},
// gap: {between: [liver, ground]}}.
Param probes_param();

// Throws Error(bad_config) for what names no probe, whatever the body.
void check_probes(const StageRun& run);

// Of the image in whose voxels ITK-SNAP tells places, where the run has one. Throws
// Error(bad_input) for one that cannot be read.
std::optional<Frame> landmarks_frame(const StageRun& run);

// The probes of a body, then the landmarks. Throws Error(bad_config) for a label that it does not
// have, sim::Refusal for a point outside of it, and Error(bad_input) for a landmark outside.
std::vector<sim::Probe> read_probes(const StageRun& run, const sim::Model& model,
                                    const std::optional<Frame>& image);

// Those of gaps. Throws Error(bad_config) for a label that the body does not have and for an
// obstacle that is not in the scene.
std::vector<sim::GapProbe> read_gaps(const StageRun& run, const sim::Model& model,
                                     const sim::Scene& scene);

// Where a probe is that has moved by u, m: LPS mm.
sim::Vec3<double> place_mm(const sim::Model& model, const sim::Probe& probe,
                           const sim::Vec3<double>& u);

// Where the landmarks, the last of `probes`, are at the end: landmarks.csv and landmarks.mrk.json,
// with an image landmarks.annot. [probes] u is how far each has moved. Nothing without landmarks.
void write_landmarks(const StageRun& run, const sim::Model& model,
                     const std::vector<sim::Probe>& probes, const std::vector<sim::Vec3<double>>& u,
                     const std::optional<Frame>& image);

}  // namespace viscera
