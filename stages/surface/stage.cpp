// Per label: a Gaussian field of its mask, the contour at the level that encloses the volume of its
// voxels, small shells dropped and counted, and what thin parts that lost, with places. Surfaces of
// neighbouring labels are independent; where one shared interface is needed, viscera-tetmesh makes
// it from the labels.
#include "stages/surface/stage.hpp"

#include <fmt/format.h>
#include <vtkVersion.h>

#include <algorithm>
#include <cmath>
#include <future>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "stages/image/image_io.hpp"
#include "stages/image/label_facts.hpp"
#include "stages/mesh/surface_io.hpp"
#include "stages/surface/contour.hpp"
#include "stages/surface/defects.hpp"
#include "stages/surface/distance.hpp"
#include "stages/surface/remesh.hpp"
#include "stages/surface/thin_parts.hpp"

namespace viscera {
namespace {

std::vector<Param> params() {
  return {
      quantity("sigma", nullptr, "mm", 0.01, 20.0,
               "Gaussian that removes the staircase; unset: 0.8 of the largest voxel spacing"),
      {.name = "keep_thin",
       .type = ParamType::boolean,
       .fallback = true,
       .doc = "a Gaussian of half the width around sheets and strands that sigma would swallow"},
      quantity("min_shell", "0.02 ml", "ml", 0.0, 1000.0,
               "closed shells and cavities of less volume are dropped"),
      {.name = "body",
       .type = ParamType::boolean,
       .fallback = true,
       .doc = "with several labels, also the surface of the whole body under id 0"},
      {.name = "method",
       .type = ParamType::text,
       .fallback = "smooth",
       .choices = {"smooth", "discrete"},
       .doc = "the smoothed label's contour that keeps its volume, or discrete marching cubes (the "
              "staircase), for comparison"},
      quantity(
          "lost_beyond", nullptr, "mm", 0.0, 1000.0,
          "voxels whose faces lie farther from the surface are listed as lost; unset: two of the "
          "largest voxel spacing"),
      quantity("max_lost", nullptr, "mm", 0.0, 1000.0,
               "gate: the farthest voxel face from its surface; unset: none"),
      quantity("edge", nullptr, "mm", 0.01, 1000.0,
               "collapse shorter edges than this; unset: the triangles of the contour"),
      quantity(
          "edge_distance", nullptr, "mm", 0.001, 1000.0,
          "bound on the Hausdorff distance between contour and remeshed surface, for which points "
          "are kept and edges shortened; unset: half of the largest voxel spacing"),
      quantity("max_volume_error", "0.2 %", "1", 0.0, 1.0,
               "gate: volume of each surface against its voxels"),
  };
}

// Of every label's surface.
namespace gates {

const GateInfo open_edges("open_edges", "<=", "1",
                          "The surface has holes: it encloses no volume, and no mesh can fill it.",
                          "raise sigma, or set method: smooth");
const GateInfo non_manifold_edges(
    "non_manifold_edges", "<=", "1",
    "More than two triangles, or triangles of opposite orientation, meet at an edge: inside and "
    "outside are not defined there.",
    "raise sigma, or leave edge unset");
const GateInfo degenerate_triangles(
    "degenerate_triangles", "<=", "1",
    "Triangles without area have no normal, and tools that need one fail on them.",
    "leave edge unset, or raise edge_distance");
const GateInfo self_intersections(
    "self_intersections", "<=", "1",
    "The surface passes through itself: what it encloses there is counted twice or not at all.",
    "raise sigma, or lower edge_distance or leave edge unset where the surface is remeshed");
const GateInfo volume_error(
    "volume_error", "<=", "1",
    "The surface does not enclose the volume of its voxels: mass and forces change by that share.",
    "lower min_shell where small shells were dropped, lower edge_distance where the surface is "
    "remeshed, or raise max_volume_error");
const GateInfo lost("lost", "<=", "mm",
                    "Smoothing took parts of the label away: the surface does not reach them.",
                    "lower sigma, keep keep_thin on, or raise max_lost");

}  // namespace gates

struct Settings {
  double sigma = 0.0, lost_beyond = 0.0;   // mm
  double min_shell = 0.0;                  // mm3
  double edge = 0.0, edge_distance = 0.0;  // mm; no edge: no remeshing
  bool keep_thin = true, discrete = false;
};

Json deviation_json(const Deviation& deviation) {
  return {{"rms_mm", deviation.rms}, {"max_mm", deviation.max}, {"max_at", deviation.place}};
}

// The thin parts that smoothing swallowed, the farthest first: all of them.
Json lost_json(const std::vector<FarPart>& lost, double voxel_volume) {
  Json list = Json::array();
  for (const FarPart& part : lost) {
    list.push_back({{"distance_mm", part.distance},
                    {"voxels", part.voxels},
                    {"ml", static_cast<double>(part.voxels) * voxel_volume / 1000.0},
                    {"place_mm", part.place}});
  }
  return {{"parts", lost.size()}, {"farthest", list}};
}

void report_lost(const std::string& name, const MatchedSurface& made,
                 const std::vector<FarPart>& lost, double beyond) {
  if (made.dropped > 0) {
    const auto& p = made.dropped_at.front();
    log::warn(
        "{}: {} shells of {:.3g} ml in all were dropped, the first near ({:.1f}, {:.1f}, "
        "{:.1f}) mm",
        name, made.dropped, made.dropped_volume / 1000.0, p[0], p[1], p[2]);
  }
  if (lost.empty()) return;
  const auto& p = lost.front().place;
  log::warn(
      "{}: {} thin parts are lost, more than {:.3g} mm from the surface; the farthest, {:.1f} "
      "mm, near ({:.1f}, {:.1f}, {:.1f}) mm",
      name, lost.size(), beyond, lost.front().distance, p[0], p[1], p[2]);
}

// The field lives here only: it is as large as all the rest.
MatchedSurface surface_of(const Mask& mask, int label, const Settings& settings,
                          std::size_t& thin_voxels) {
  if (settings.discrete) return discrete(mask, label, settings.min_shell);
  KeptThin kept;
  if (settings.keep_thin) {
    kept = smooth_keeping_thin(mask, settings.sigma);
  } else {
    kept.field = smooth_keeping_volume(mask.frame, mask.inside, settings.sigma);
  }
  thin_voxels = kept.voxels;
  return match_volume(mask, kept.field, label, settings.min_shell);
}

// Fewer triangles, where asked for; returns what is to be reported of it.
Json coarsen(MatchedSurface& made, const std::string& name, const Settings& settings) {
  if (settings.edge == 0.0) return nullptr;
  Remeshed remeshed = remesh(made.surface, settings.edge, settings.edge_distance);
  if (remeshed.edge < settings.edge) {
    log::warn("{}: triangles of {:.3g} mm are too coarse to stay within {:.3g} mm: {}", name,
              settings.edge, settings.edge_distance,
              remeshed.edge > 0.0 ? fmt::format("{:.3g} mm", remeshed.edge) : "left as they are");
  }
  made.surface = std::move(remeshed.surface);
  return {{"edge_mm", remeshed.edge},
          {"distance_mm", remeshed.distance},
          {"points_kept", remeshed.kept}};
}

using Crossings = std::vector<std::array<int, 2>>;  // pairs of triangles

std::vector<std::array<double, 3>> places_of(const Crossings& crossings,
                                             const SurfaceMesh& surface) {
  std::vector<std::array<double, 3>> places;
  for (const auto& pair : crossings)
    places.push_back(surface.points[surface.triangles[pair[0]][0]]);
  return places;
}

void judge(StageRun& run, const std::string& name, const SurfaceMesh& surface,
           const SurfaceCheck& found, const Crossings& crossings, double error,
           const Deviation& to_surface) {
  const auto none = [&](const GateInfo& gate, std::size_t count, GateDetails details = {}) {
    details.of = name;
    run.gate(gate, static_cast<double>(count), 0.0, std::move(details));
  };
  none(gates::open_edges, found.open_edges);
  none(gates::non_manifold_edges, found.non_manifold_edges + found.misoriented_edges);
  none(gates::degenerate_triangles, found.degenerate);
  none(gates::self_intersections, crossings.size(), {.at = places_of(crossings, surface)});
  run.gate(gates::volume_error, std::abs(error), run.param<double>("max_volume_error"),
           {.of = name});
  if (!run.has_param("max_lost")) return;
  run.gate(gates::lost, to_surface.max, run.param<double>("max_lost"),
           {.of = name, .at = {to_surface.place}});
}

// The surface of one label (the whole body for id 0), with its metrics and gates.
SurfaceMesh make_surface(StageRun& run, const LabelImage& image, int label, const std::string& name,
                         const Settings& settings) {
  const Mask mask = mask_around(image, label, 4.0 * settings.sigma);
  std::size_t thin_voxels = 0;
  MatchedSurface made = surface_of(mask, label, settings, thin_voxels);
  SurfaceMesh& surface = made.surface;
  surface.label_names = {{label, name}};
  const Json remeshed = coarsen(made, name, settings);
  auto crossing =
      std::async(std::launch::async, [&surface] { return self_intersections(surface); });
  const SurfaceCheck found = check(surface);
  const auto distance = boundary_distance(mask, surface, settings.lost_beyond);
  const Crossings crossings = crossing.get();
  const double error = found.volume / mask.volume() - 1.0;
  log::info("{}: {} triangles, {:.2f} ml ({:+.3f} %), rms {:.2f} mm, farthest voxel {:.1f} mm",
            name, surface.triangles.size(), found.volume / 1000.0, 100.0 * error,
            distance.to_surface.rms, distance.to_surface.max);
  report_lost(name, made, distance.lost, settings.lost_beyond);
  run.metric(name, Json{{"id", label},
                        {"triangles", surface.triangles.size()},
                        {"shells", found.shells},
                        {"shells_dropped", made.dropped},
                        {"dropped_ml", made.dropped_volume / 1000.0},
                        {"level", made.level},
                        {"ml", found.volume / 1000.0},
                        {"voxel_ml", mask.volume() / 1000.0},
                        {"volume_error", error},
                        {"area_mm2", found.area},
                        {"open_edges", found.open_edges},
                        {"non_manifold_edges", found.non_manifold_edges},
                        {"misoriented_edges", found.misoriented_edges},
                        {"degenerate_triangles", found.degenerate},
                        {"self_intersections", crossings.size()},
                        {"voxels_to_surface", deviation_json(distance.to_surface)},
                        {"surface_to_voxels", deviation_json(distance.to_voxels)},
                        {"remeshed", remeshed},
                        {"thin_voxels", thin_voxels},
                        {"lost", lost_json(distance.lost, mask.frame.voxel_volume())}});
  judge(run, name, surface, found, crossings, error, distance.to_surface);
  return std::move(made.surface);
}

void run_surface(StageRun& run) {
  write_vtp(run.out("surface.vtp"), make_surfaces(run, read_image(run.input("labels")).image));
}

// On two cores of 2.5 GHz (docs/performance.md), by the faces of voxels between labels.
Estimate estimate_surface(StageRun& run, const Expected& before) {
  constexpr double start_s = 0.05, per_face_s = 10.5e-6;
  constexpr double program_mb = 25.0, per_face_mb = 1e-3;
  Estimate estimate{.expected = before};
  if (run.has_input("labels"))
    estimate.expected.take(find_facts(read_image(run.input("labels")).image));
  if (estimate.expected.voxels <= 0.0) return estimate;
  const double took = start_s + per_face_s * estimate.expected.voxel_faces;
  estimate.wall_low_s = 0.7 * took;
  estimate.wall_high_s = 1.4 * took;
  estimate.memory_mb = program_mb + per_face_mb * estimate.expected.voxel_faces;
  return estimate;
}

}  // namespace

SurfaceMesh make_surfaces(StageRun& run, const LabelImage& image) {
  const double voxel = *std::max_element(image.frame.spacing.begin(), image.frame.spacing.end());
  const Settings settings{
      .sigma = run.has_param("sigma") ? run.param<double>("sigma") : default_sigma(image.frame),
      .lost_beyond = run.has_param("lost_beyond") ? run.param<double>("lost_beyond") : 2.0 * voxel,
      .min_shell = 1000.0 * run.param<double>("min_shell"),
      .edge = run.has_param("edge") ? run.param<double>("edge") : 0.0,
      .edge_distance =
          run.has_param("edge_distance") ? run.param<double>("edge_distance") : 0.5 * voxel,
      .keep_thin = run.param<bool>("keep_thin"),
      .discrete = run.param<std::string>("method") == "discrete"};
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
    append(surface, make_surface(run, image, id, name, settings));
  }
  log::progress("surfaces", 1.0);
  run.metric("sigma", settings.sigma, "mm");
  run.metric("triangles", surface.triangles.size());
  return surface;
}

Stage surface_stage() {
  Stage stage;
  stage.info = {.name = "surface",
                .version = "4",
                .doc = "A label volume to one smooth closed surface per label.",
                .inputs = {{.role = "labels",
                            .doc = "labels.nrrd of viscera-labels (background around each label)"}},
                .outputs = {{"surface.vtp", "surface", "triangles with cell array label, LPS mm"}},
                .params = params(),
                .gates = {gates::open_edges, gates::non_manifold_edges, gates::degenerate_triangles,
                          gates::self_intersections, gates::volume_error, gates::lost},
                .libraries = {{"VTK", vtkVersion::GetVTKVersion()}}};
  stage.run = run_surface;
  stage.estimate = estimate_surface;
  return stage;
}

}  // namespace viscera
