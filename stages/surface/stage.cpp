// Per label: a Gaussian field of its mask, the level that encloses the volume of its voxels, the
// contour at that level, and the small shells that smoothing left dropped and counted. Surfaces of
// neighbouring labels are independent; where one shared interface is needed, viscera-tetmesh makes
// it from the labels.
#include "stages/surface/stage.hpp"

#include <fmt/format.h>
#include <vtkVersion.h>

#include <algorithm>
#include <cmath>

#include "pipeline/contract/error.hpp"
#include "pipeline/contract/log.hpp"
#include "stages/common/image_io.hpp"
#include "stages/common/surface_io.hpp"
#include "stages/surface/contour.hpp"

namespace viscera {
namespace {

std::vector<Param> params() {
  return {
      quantity("sigma", nullptr, "mm", 0.01, 20.0,
               "Gaussian that removes the staircase; unset: 0.8 of the largest voxel spacing"),
      quantity("min_shell", "0.02 ml", "ml", 0.0, 1000.0,
               "closed shells and cavities of less volume are dropped"),
      {.name = "body",
       .type = ParamType::boolean,
       .fallback = true,
       .doc = "with several labels, also the surface of the whole body under id 0"},
      quantity("max_volume_error", "1 %", "1", 0.0, 1.0,
               "gate: volume of each surface against its voxels"),
  };
}

struct Dropped {
  std::size_t shells = 0;
  double volume = 0.0;  // mm3
};

Dropped drop_small_shells(SurfaceMesh& surface, double min_volume) {
  Dropped dropped;
  SurfaceMesh kept{.points = surface.points, .label_names = surface.label_names};
  const int label = surface.labels.empty() ? 0 : surface.labels.front();
  for (const auto& shell : find_shells(surface)) {
    if (std::abs(shell.volume) < min_volume) {
      ++dropped.shells;
      dropped.volume += std::abs(shell.volume);
      log::warn("dropped a shell of {:.3g} ml near ({:.1f}, {:.1f}, {:.1f}) mm",
                shell.volume / 1000.0, shell.place[0], shell.place[1], shell.place[2]);
      continue;
    }
    for (const int t : shell.triangles) kept.triangles.push_back(surface.triangles[t]);
  }
  kept.labels.assign(kept.triangles.size(), label);
  if (dropped.shells > 0) surface = extract(kept, label);
  return dropped;
}

// The surface of one label (the whole body for id 0), with its metrics and gates.
SurfaceMesh make_surface(StageRun& run, const LabelImage& image, int label, const std::string& name,
                         double sigma) {
  const auto mask = mask_of(image, label);
  const double voxel_mm3 =
      static_cast<double>(std::count(mask.begin(), mask.end(), 1)) * image.frame.voxel_volume();
  const Field field = smooth(image.frame, mask, sigma);
  double level = matched_level(image.frame, field, voxel_mm3);
  SurfaceMesh surface = contour(image.frame, field, level, label);
  // Flat triangles cut the corners of the trilinear field: aim once more, past the target.
  level = matched_level(image.frame, field, voxel_mm3 * voxel_mm3 / check(surface).volume);
  surface = contour(image.frame, field, level, label);
  surface.label_names = {{label, name}};
  const Dropped dropped = drop_small_shells(surface, 1000.0 * run.param<double>("min_shell"));
  const SurfaceCheck found = check(surface);
  const Distance distance = distance_from_voxels(image.frame, mask, surface);
  const double error = found.volume / voxel_mm3 - 1.0;
  log::info("{}: {} triangles, {:.2f} ml ({:+.3f} %), rms {:.2f} mm, farthest voxel {:.1f} mm",
            name, surface.triangles.size(), found.volume / 1000.0, 100.0 * error, distance.rms,
            distance.max);
  run.metric(name, Json{{"id", label},
                        {"triangles", surface.triangles.size()},
                        {"shells", found.shells},
                        {"shells_dropped", dropped.shells},
                        {"dropped_ml", dropped.volume / 1000.0},
                        {"level", level},
                        {"ml", found.volume / 1000.0},
                        {"voxel_ml", voxel_mm3 / 1000.0},
                        {"volume_error", error},
                        {"area_mm2", found.area},
                        {"open_edges", found.open_edges},
                        {"non_manifold_edges", found.non_manifold_edges},
                        {"misoriented_edges", found.misoriented_edges},
                        {"degenerate_triangles", found.degenerate},
                        {"voxel_distance_rms_mm", distance.rms},
                        {"voxel_distance_max_mm", distance.max},
                        {"voxel_distance_max_at", distance.place}});
  run.gate(name + ".open_edges", static_cast<double>(found.open_edges), "<=", 0.0);
  run.gate(name + ".non_manifold_edges",
           static_cast<double>(found.non_manifold_edges + found.misoriented_edges), "<=", 0.0);
  run.gate(name + ".volume_error", std::abs(error), "<=", run.param<double>("max_volume_error"));
  return surface;
}

void run_surface(StageRun& run) {
  const LabelImage image = read_image(run.input("labels")).image;
  const double sigma =
      run.has_param("sigma") ? run.param<double>("sigma") : default_sigma(image.frame);
  std::map<int, std::string> names;
  for (const int id : image.voxels) {
    if (id == 0 || names.count(id)) continue;
    const auto known = image.names.find(id);
    names[id] = known == image.names.end() ? fmt::format("label_{}", id) : known->second;
  }
  if (names.empty()) {
    throw Error(ExitCode::bad_input, {.where = run.input("labels").string(),
                                      .field = "voxel values",
                                      .found = "all zero",
                                      .allowed = "at least one labelled voxel",
                                      .remedy = "give the labels.nrrd of viscera-labels"});
  }
  if (names.size() > 1 && run.param<bool>("body")) names[body_label] = "body";
  SurfaceMesh surface;
  std::size_t done = 0;
  for (const auto& [id, name] : names) {
    log::progress("surfaces", static_cast<double>(done++) / static_cast<double>(names.size()),
                  name);
    append(surface, make_surface(run, image, id, name, sigma));
  }
  log::progress("surfaces", 1.0);
  run.metric("sigma", sigma, "mm");
  run.metric("triangles", surface.triangles.size());
  write_vtp(run.out("surface.vtp"), surface);
}

}  // namespace

Stage surface_stage() {
  Stage stage;
  stage.info = {.name = "surface",
                .version = "1",
                .doc = "A label volume to one smooth closed surface per label.",
                .inputs = {{.role = "labels",
                            .doc = "labels.nrrd of viscera-labels (background around each label)"}},
                .outputs = {{"surface.vtp", "surface", "triangles with cell array label, LPS mm"}},
                .params = params(),
                .libraries = {{"VTK", vtkVersion::GetVTKVersion()}}};
  stage.run = run_surface;
  return stage;
}

}  // namespace viscera
