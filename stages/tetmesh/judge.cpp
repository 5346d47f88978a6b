#include "stages/tetmesh/judge.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/base/log.hpp"
#include "stages/mesh/tet_topology.hpp"
#include "stages/mesh/vec.hpp"
#include "stages/tetmesh/gates.hpp"
#include "stages/tetmesh/quality/distance.hpp"

namespace viscera {
namespace {

// Between the samples of a boundary triangle, as a part of the mean edge of the boundary.
constexpr double sample_spacing = 0.35;

double count(std::size_t n) {
  return static_cast<double>(n);
}

struct LabelTotal {
  std::size_t tets = 0;
  double volume = 0.0;  // mm3
};

std::map<int, LabelTotal> totals(const TetMesh& mesh, const std::vector<TetQuality>& quality) {
  std::map<int, LabelTotal> sums;
  for (const auto& [label, name] : mesh.label_names) sums[label];
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    auto& sum = sums[mesh.labels[t]];
    ++sum.tets;
    sum.volume += quality[t][volume];
  }
  return sums;
}

// Of the worst tets by a measure those that are below the limit.
std::vector<Vec> places_below(const Json& measure, double limit) {
  std::vector<Vec> places;
  for (const auto& tet : measure["worst"])
    if (tet["value"].get<double>() < limit) places.push_back(tet["at"]);
  return places;
}

double note_volume(double found, double wanted, Json& entry) {
  const double error = found / wanted - 1.0;
  entry["input_ml"] = wanted / 1000.0;
  entry["volume_error"] = error;
  return std::abs(error);
}

Json judge_volumes(StageRun& run, const TetMesh& mesh, const std::vector<TetQuality>& quality,
                   const Wanted& wanted) {
  Json list = Json::array();
  double body = 0.0;
  for (const auto& [id, sum] : totals(mesh, quality)) {
    const std::string& name = mesh.label_names.at(id);
    Json entry{{"name", name}, {"id", id}, {"tets", sum.tets}, {"ml", sum.volume / 1000.0}};
    const auto known = wanted.label_volumes.find(id);
    if (known != wanted.label_volumes.end())
      run.gate(mesh_gates::label_volume_error, note_volume(sum.volume, known->second, entry),
               run.param<double>("max_label_error"), {.of = name});
    const double error = 100.0 * entry.value("volume_error", 0.0);
    log::info("{}: {} tets, {:.2f} ml{}", name, sum.tets, sum.volume / 1000.0,
              entry.contains("volume_error") ? fmt::format(" ({:+.2f} %)", error) : "");
    body += sum.volume;
    list.push_back(std::move(entry));
  }
  Json result{{"ml", body / 1000.0}};
  if (wanted.body_volume > 0.0)
    run.gate(mesh_gates::volume_error, note_volume(body, wanted.body_volume, result),
             run.param<double>("max_volume_error"));
  result["labels"] = std::move(list);
  return result;
}

// `volumes` as in the summary of measures.
Json judge_topology(StageRun& run, const TetMesh& mesh, const Wanted& wanted, const Json& volumes) {
  const Topology found = inspect(mesh);
  const auto none = [&run](const GateInfo& gate, std::size_t n, std::vector<Vec> at = {}) {
    run.gate(gate, count(n), 0.0, {.at = std::move(at)});
  };
  constexpr double smallest = std::numeric_limits<double>::min();
  none(mesh_gates::inverted, found.inverted, places_below(volumes, smallest));
  none(mesh_gates::duplicates, found.duplicate_tets + found.duplicate_points);
  none(mesh_gates::stray_points, found.stray_points);
  none(mesh_gates::non_manifold,
       found.non_manifold_edges + found.non_manifold_points + found.overfull_faces);
  if (wanted.bodies) {
    run.gate(mesh_gates::components, count(found.components), count(*wanted.bodies));
    if (found.components < *wanted.bodies) {
      run.caveat(fmt::format(
          "{} bodies that are apart in the input are {} in the mesh: where a gap is narrower than "
          "the cells, parts are grown together and cannot slide. Smaller cells keep them apart.",
          *wanted.bodies, found.components));
    }
  }
  return {{"inverted", found.inverted},
          {"duplicate_tets", found.duplicate_tets},
          {"duplicate_points", found.duplicate_points},
          {"stray_points", found.stray_points},
          {"overfull_faces", found.overfull_faces},
          {"boundary_triangles", found.boundary_triangles},
          {"non_manifold_edges", found.non_manifold_edges},
          {"non_manifold_points", found.non_manifold_points},
          {"components", found.components},
          {"component_tets", found.component_tets},
          {"busiest", {{"tets", found.busiest_tets}, {"at", mesh.points[found.busiest_point]}}}};
}

double mean_boundary_edge(const TetMesh& mesh) {
  double sum = 0.0;
  std::size_t edges = 0;
  for (const auto& t : boundary_triangles(mesh))
    for (int e = 0; e < 3; ++e, ++edges) {
      const auto &p = mesh.points[t[e]], &q = mesh.points[t[(e + 1) % 3]];
      sum += std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]);
    }
  return edges > 0 ? sum / count(edges) : 1.0;
}

Json to_json(const Deviation& deviation) {
  return {{"rms_mm", deviation.rms}, {"max_mm", deviation.max}, {"max_at", deviation.place}};
}

constexpr std::size_t warned = 5;  // of the lost parts; quality.json names them all

// Cells of at most this many times the narrowest place keep a part. Found with strands 4 and 6 mm
// wide in voxels of 1 mm (3 and 5 mm at their narrowest, as balls go from voxel to voxel): cells of
// 6 and 8 mm keep them, of 8 and 12 mm do not; sheets of 4 mm are kept by 12 mm.
constexpr double keeping_ratio = 1.5;
// A Gaussian leaves a strand of d mm more than half of its value in the middle where sigma is less
// than d / (2 sqrt(2 ln 2)).
const double keeping_sigma = 0.5 / std::sqrt(2.0 * std::log(2.0));

// What would keep a part, or several. Of a shell that smoothing cut off nobody knows how thin the
// neck was.
struct Keeping {
  std::optional<double> cell_size, sigma;  // mm; sigma only where the default takes it

  void add(const LostPart& part) {
    if (part.detached_volume > 0.0) return;
    cell_size = std::min(cell_size.value_or(HUGE_VAL), keeping_ratio * part.thickness);
    if (!part.smoothed_away) return;
    sigma = std::min(sigma.value_or(HUGE_VAL), keeping_sigma * part.thickness);
  }
  std::string text() const {
    return fmt::format("cell_size: {:.2g} mm{}", *cell_size,
                       sigma ? fmt::format(" and sigma: {:.2g} mm", *sigma) : "");
  }
  void write(Json& entry) const {
    entry["cell_size_mm"] = cell_size ? Json(*cell_size) : Json();
    entry["sigma_mm"] = sigma ? Json(*sigma) : Json();
  }
};

Keeping keeping(const LostPart& part) {
  Keeping one;
  one.add(part);
  return one;
}

Json to_json(const LostPart& part) {
  Json entry{{"at", part.place},
             {"depth_mm", part.depth},
             {"thickness_mm", part.thickness},
             {"ml", part.volume / 1000.0},
             {"detached_ml", part.detached_volume / 1000.0}};
  keeping(part).write(entry);
  return entry;
}

Json to_json(const std::vector<LostPart>& parts) {
  Json list = Json::array();
  for (const LostPart& part : parts) list.push_back(to_json(part));
  return list;
}

std::string why_lost(const LostPart& part) {
  if (part.detached_volume > 0.0) return "cut off the body by smoothing";
  return fmt::format("{:.1f} mm at its narrowest{} (kept by {})", part.thickness,
                     part.smoothed_away ? ", which smoothing removes" : "", keeping(part).text());
}

bool has_label_near(const LabelImage& image, const Vec& place) {
  const Vec p = image.frame.from_lps(place);
  std::array<int, 3> lo{}, hi{};
  for (int a = 0; a < 3; ++a) {
    const double at = p[a] / image.frame.spacing[a];
    lo[a] = std::max(0, static_cast<int>(std::floor(at)));
    hi[a] = std::min(image.frame.size[a] - 1, static_cast<int>(std::ceil(at)));
  }
  for (int k = lo[2]; k <= hi[2]; ++k)
    for (int j = lo[1]; j <= hi[1]; ++j)
      for (int i = lo[0]; i <= hi[0]; ++i)
        if (image.voxels[image.frame.index(i, j, k)] != 0) return true;
  return false;
}

// What was asked for and is not in the mesh: of the labels, where they are given, and of the
// surface what they do not have.
struct Loss {
  double farthest = 0.0;  // mm
  Vec place{};
  std::vector<LostPart> parts;  // the farthest first
};

Loss all_lost(const Wanted& wanted, const std::optional<SurfaceDistance>& distance) {
  Loss loss{wanted.loss.farthest, wanted.loss.place, wanted.loss.parts};
  if (!distance) return loss;
  if (!wanted.labels) {
    loss.farthest = distance->to_mesh.max;
    loss.place = distance->to_mesh.place;
  }
  for (const LostPart& part : distance->lost)
    if (!wanted.labels || !has_label_near(*wanted.labels, part.place)) loss.parts.push_back(part);
  std::stable_sort(loss.parts.begin(), loss.parts.end(),
                   [](const auto& a, const auto& b) { return a.depth > b.depth; });
  return loss;
}

void warn_of(const Loss& loss, double lost_volume, double share, double cell_size,
             const Keeping& keeping) {
  for (std::size_t n = 0; n < std::min(warned, loss.parts.size()); ++n) {
    const LostPart& part = loss.parts[n];
    const auto& [x, y, z] = part.place;
    log::warn(
        "a part near ({:.1f}, {:.1f}, {:.1f}) mm is not in the mesh: {:.3g} ml, {:.1f} mm "
        "away, {}",
        x, y, z, part.volume / 1000.0, part.depth, why_lost(part));
  }
  if (loss.parts.size() > warned)
    log::warn("and {} more lost parts: quality.json names them all", loss.parts.size() - warned);
  if (loss.parts.empty()) return;
  log::warn("{} lost parts, {:.3g} ml ({:.2g} %) in all, up to {:.1f} mm ({:.1f} cells) away{}",
            loss.parts.size(), lost_volume / 1000.0, 100.0 * share, loss.farthest,
            loss.farthest / cell_size,
            keeping.cell_size ? fmt::format("; {} would keep them", keeping.text()) : "");
}

// Of a mesh made elsewhere only the surface says.
double asked_volume(const Wanted& wanted) {
  if (wanted.body_volume > 0.0) return wanted.body_volume;
  double sum = 0.0;
  for (const auto& shell : find_shells(*wanted.surface)) sum += std::abs(shell.volume);
  return sum;
}

// Parts of labels that the mesh makes of other labels, where they are too large to leave unsaid: a
// label's volume is met by aiming it higher elsewhere.
Json report_misplaced(StageRun& run, const TetMesh& mesh, const Wanted& wanted, double cell_size) {
  constexpr double worth_a_word = 0.02;  // of the label's volume
  Json all = Json::object();
  for (const auto& [label, loss] : wanted.misplaced) {
    double volume = 0.0;
    for (const LostPart& part : loss.parts) volume += part.volume;
    const double share = volume / wanted.label_volumes.at(label);
    const std::string& name = mesh.label_names.at(label);
    all[name] = {{"share", share}, {"farthest_mm", loss.farthest}, {"parts", to_json(loss.parts)}};
    if (share < worth_a_word) continue;
    run.caveat(fmt::format(
        "{:.2g} % of {} are parts up to {:.0f} mm from its tets, and of another material in the "
        "mesh: cells of {:.2g} mm are too large for them. Its volume is met elsewhere; smaller "
        "cells (sizes: {{{}: …}}) keep these parts.",
        100.0 * share, name, loss.farthest, cell_size, name));
  }
  return all;
}

Json judge_lost(StageRun& run, const Wanted& wanted, double cell_size,
                const std::optional<SurfaceDistance>& distance) {
  const Loss loss = all_lost(wanted, distance);
  double lost_volume = 0.0;
  Keeping all;
  for (const LostPart& part : loss.parts) {
    lost_volume += part.volume;
    all.add(part);
  }
  const double share = lost_volume / asked_volume(wanted);
  warn_of(loss, lost_volume, share, cell_size, all);
  // Cells that fine may be too many to mesh: whether the parts matter is the reader's to say.
  const auto remedy = [&all](const char* limit) {
    if (!all.cell_size) return std::string();
    return fmt::format("set {}, which keeps the parts, or raise {} where they do not matter",
                       all.text(), limit);
  };
  std::vector<Vec> places;
  for (const LostPart& part : loss.parts) places.push_back(part.place);
  run.gate(mesh_gates::lost_volume, share, run.param<double>("max_lost_volume"),
           {.at = places, .remedy = remedy("max_lost_volume")});
  run.gate(mesh_gates::lost_distance, loss.farthest / cell_size,
           run.param<double>("max_lost_distance"),
           {.at = {loss.place}, .remedy = remedy("max_lost_distance")});
  Json report{{"beyond_mm", lost_beyond * cell_size},
              {"ml", lost_volume / 1000.0},
              {"share", share},
              {"farthest_mm", loss.farthest},
              {"farthest_at", loss.place},
              {"parts", to_json(loss.parts)}};
  all.write(report);
  return report;
}

SurfaceDistance judge_distance(StageRun& run, const TetMesh& mesh, const Wanted& wanted,
                               Json& report) {
  const double edge = mean_boundary_edge(mesh);
  auto found = surface_distance(mesh, *wanted.surface,
                                {.spacing = sample_spacing * edge,
                                 .cell_size = wanted.cell_size.value_or(edge),
                                 .bodies = wanted.bodies});
  log::info(
      "mesh to surface: rms {:.3f}, max {:.2f} mm; surface to mesh: rms {:.3f}, max {:.2f} mm",
      found.to_surface.rms, found.to_surface.max, found.to_mesh.rms, found.to_mesh.max);
  if (run.has_param("max_distance")) {
    const auto& worse = found.to_surface.max > found.to_mesh.max ? found.to_surface : found.to_mesh;
    run.gate(mesh_gates::max_distance, worse.max, run.param<double>("max_distance"),
             {.at = {worse.place}});
  }
  report["distance"] = {{"to_surface", to_json(found.to_surface)},
                        {"to_mesh", to_json(found.to_mesh)},
                        {"to_mesh_kept", to_json(found.to_mesh_kept)},
                        {"lost", to_json(found.lost)}};
  return found;
}

Json judge_time_step(StageRun& run, const TetMesh& mesh, const std::vector<TetQuality>& quality,
                     const TimeGoal& goal) {
  const TimeStep found = assess_time_step(mesh, quality, goal);
  Json result{{"substeps_needed", found.substeps_needed}, {"labels", Json::array()}};
  log::info("stable from {:.0f} substeps a frame on (Cs <= 0.6)", found.substeps_needed);
  for (const auto& [label, least] : min_altitudes(goal)) {
    const auto altitude = found.altitude.find(label);
    if (altitude == found.altitude.end()) continue;
    const std::string& name = mesh.label_names.at(label);
    run.gate(mesh_gates::altitude_min, altitude->second, least, {.of = name});
    result["labels"].push_back(
        {{"name", name}, {"altitude_min_mm", altitude->second}, {"needed_mm", least}});
  }
  return result;
}

}  // namespace

Json judge(StageRun& run, const TetMesh& mesh, const std::vector<TetQuality>& quality,
           const Wanted& wanted) {
  const Json summary = summarise(mesh, quality);
  const double smallest = summary["dihedral_min"]["min"], mean = summary["dihedral_min"]["mean"];
  log::info("{} tets, {} points, dihedral min {:.2f} deg, mean {:.1f} deg", mesh.tets.size(),
            mesh.points.size(), smallest, mean);
  Json report{{"tets", mesh.tets.size()}, {"points", mesh.points.size()}};
  report["volume"] = judge_volumes(run, mesh, quality, wanted);
  const auto min_angle = run.param<double>("min_dihedral");
  run.gate(mesh_gates::min_dihedral, smallest, min_angle,
           {.at = places_below(summary["dihedral_min"], min_angle)});
  report["topology"] = judge_topology(run, mesh, wanted, summary["volume"]);
  std::optional<SurfaceDistance> distance;
  if (wanted.surface) distance = judge_distance(run, mesh, wanted, report);
  if (wanted.labels || wanted.surface) {
    const double cell_size = wanted.cell_size.value_or(mean_boundary_edge(mesh));
    report["lost"] = judge_lost(run, wanted, cell_size, distance);
    if (!wanted.misplaced.empty())
      report["misplaced"] = report_misplaced(run, mesh, wanted, cell_size);
  }
  if (!wanted.time.materials.empty())
    report["time_step"] = judge_time_step(run, mesh, quality, wanted.time);
  if (wanted.tets)
    run.gate(mesh_gates::target_tets, std::abs(count(mesh.tets.size()) / *wanted.tets - 1.0),
             allowed_off_target);
  report["smoothness"] = volume_smoothness(mesh, quality);
  report["measures"] = summary;
  for (const auto& [name, value] : report.items())
    if (name != "measures") run.metric(name, value);
  for (const auto& [name, values] : summary.items()) {
    run.metric(name, Json{{"min", values["min"]}, {"mean", values["mean"]}, {"max", values["max"]}},
               values["unit"]);
  }
  return report;
}

}  // namespace viscera
