#include "pipeline/python/preparation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "pipeline/base/error.hpp"
#include "stages/image/frame_repair.hpp"
#include "stages/image/header_checks.hpp"
#include "stages/image/image_io.hpp"
#include "stages/labels/stage.hpp"
#include "stages/surface/stage.hpp"
#include "stages/tetmesh/stage.hpp"

namespace viscera::python {
namespace fs = std::filesystem;
namespace {

// Errors call what is in memory by these names.
constexpr const char *array = "array", *labels_in_memory = "labels", *given_params = "params";

StageRun run_of(const Stage& stage, std::multimap<std::string, fs::path> inputs,
                const Json& params) {
  StageRun run = make_run(stage.info, std::move(inputs), params, given_params);
  if (stage.check) stage.check(run);
  return run;
}

// With the frame that the next stage's program reads, so that what follows has its bits.
Labels cleaned(StageRun& run, const Segmentation& segmentation) {
  Labels labels{.image = clean_labels(run, segmentation).image, .said = {}};
  labels.image.frame = as_read_back(labels.image.frame);
  labels.said = said_by(labels_stage().info, run);
  return labels;
}

void check_frame(Frame& frame) {
  const HeaderChecks checks(array);
  checks.size("shape", {frame.size.begin(), frame.size.end()}, 1);
  checks.finite("spacing", {frame.spacing.begin(), frame.spacing.end()});
  checks.finite("origin", {frame.origin.begin(), frame.origin.end()});
  for (const double spacing : frame.spacing) {
    if (!(spacing > 0.0))
      checks.refuse("spacing", fmt::format("{}", spacing), "mm between voxels, above 0");
  }
  checks.spans_volume("direction", frame.direction);
  orthonormalise(array, frame);
}

}  // namespace

Labels read_labels(const std::vector<fs::path>& sources, const Json& params) {
  std::multimap<std::string, fs::path> inputs;
  for (const auto& source : sources) inputs.emplace("volume", source);
  StageRun run = run_of(labels_stage(), std::move(inputs), params);
  return cleaned(run, read_segmentation(sources));
}

Labels labels_of(LabelImage volume, const Json& params) {
  check_frame(volume.frame);
  StageRun run = run_of(labels_stage(), {{"volume", array}}, params);
  return cleaned(run, segmentation_of(volume, array));
}

Surface surface_of(const Labels& labels, const Json& params) {
  StageRun run = run_of(surface_stage(), {{"labels", labels_in_memory}}, params);
  Surface surface{.mesh = make_surfaces(run, labels.image), .said = {}};
  surface.said = said_by(surface_stage().info, run);
  return surface;
}

NamedMesh mesh_of(const Labels* labels, const Surface* surface, const NamedMesh* size_field,
                  const Json& params) {
  for (const char* name : {"formats", "time_limit"}) {
    if (!params.contains(name)) continue;
    throw Error(ExitCode::bad_config, {.where = given_params,
                                       .field = name,
                                       .found = "a value",
                                       .allowed = "nothing: no file is written, and the process is "
                                                  "not this mesh's own"});
  }
  StageRun run = run_of(tetmesh_stage(), {}, params);
  NamedMesh named;
  named.mesh = make_tets(run, {.labels = labels ? &labels->image : nullptr,
                               .surface = surface ? &surface->mesh : nullptr,
                               .size_field = size_field ? &size_field->mesh : nullptr});
  named.said = said_by(tetmesh_stage().info, run);
  return named;
}

void check_surface(const SurfaceMesh& surface) {
  const auto refuse = [](const char* field, std::string found, std::string allowed) {
    throw Error(ExitCode::bad_input, {.where = "surface",
                                      .field = field,
                                      .found = std::move(found),
                                      .allowed = std::move(allowed)});
  };
  for (std::size_t i = 0; i < surface.points.size(); ++i) {
    if (!std::ranges::all_of(surface.points[i], [](double x) { return std::isfinite(x); }))
      refuse("points", fmt::format("point {} is not finite", i), "finite mm");
  }
  const auto count = static_cast<int>(surface.points.size());
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    for (const int v : surface.triangles[t]) {
      if (v >= 0 && v < count) continue;
      refuse("triangles", fmt::format("triangle {} names point {}", t, v),
             fmt::format("0 to {}", count - 1));
    }
  }
}

}  // namespace viscera::python
