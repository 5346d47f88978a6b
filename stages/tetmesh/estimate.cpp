#include "stages/tetmesh/estimate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "stages/image/label_facts.hpp"
#include "stages/tetmesh/exchange/import.hpp"
#include "stages/tetmesh/mesher/mesh_job.hpp"
#include "stages/tetmesh/read_request.hpp"

namespace viscera {
namespace {

// Seconds on two cores of 2.5 GHz, fitted to the phantom and to two livers of LiTS
// (docs/performance.md) and brought to this machine by a trial mesh: what the fields of the labels
// take, a mesh from them in which the right size is looked for, the final one, and judging it.
constexpr double per_voxel_s = 0.25e-6;
constexpr double trial_per_tet_s = 33e-6, final_per_tet_s = 40e-6, judged_per_tet_s = 20e-6;
constexpr double trial_tets = 3000.0;
// Meshes until one has the tets asked for.
constexpr double fewest_tries = 2.0, most_tries = 4.0;
// How far a run was off, beside the number of tries.
constexpr double low = 0.8, high = 1.3;

// The meshes that are made before the final one.
struct Tries {
  double fewest = 0.0, most = 0.0;
};

double trial_s(double voxels, double tets) {
  return per_voxel_s * voxels + trial_per_tet_s * tets;
}

void set_time(Estimate& estimate, double voxels, const Tries& tries, double pace) {
  const double tets = estimate.expected.tets;
  const double once = 2.0 * per_voxel_s * voxels + (final_per_tet_s + judged_per_tet_s) * tets;
  estimate.wall_low_s = low * pace * (once + tries.fewest * trial_s(voxels, tets));
  estimate.wall_high_s = high * pace * (once + tries.most * trial_s(voxels, tets));
}

// How much slower than those two cores this machine makes a small mesh.
double pace_of(MeshJob& job, double voxels) {
  const double size = std::cbrt(job.expected_tets(1.0) / trial_tets);
  const auto begin = std::chrono::steady_clock::now();
  const auto tets = static_cast<double>(job.calibrate(size));
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  return took.count() / trial_s(voxels, tets);
}

// Which shares of the box around the body the regions take that lie at its sides. Where a region's
// own box lies in the body is not known.
void take_regions(Expected& expected, const std::vector<RegionRequest>& requests) {
  const Vec extent{expected.extent_mm[0], expected.extent_mm[1], expected.extent_mm[2]};
  for (const RegionRequest& request : requests) {
    if (request.box) continue;
    const Region region = make_regions({request}, {{}, extent}).front();
    const double depth = std::abs(dot(region.planes.front().normal, extent));
    expected.region_share[request.name] = std::min(1.0, request.within / depth);
  }
}

// Of a mesh made elsewhere: it is read, and little else is done.
Estimate estimate_import(const StageRun& run, Expected expected) {
  const TetMesh mesh = import_mesh(run.input("mesh")).mesh;
  expected.tets = static_cast<double>(mesh.tets.size());
  const double judging = judged_per_tet_s * expected.tets;
  return {.wall_low_s = judging, .wall_high_s = 4.0 * judging, .expected = expected};
}

}  // namespace

Estimate estimate_tetmesh(StageRun& run, const Expected& before) {
  if (run.has_input("mesh")) return estimate_import(run, before);
  Estimate estimate{.expected = before};
  Expected& expected = estimate.expected;
  const bool has_labels = run.has_input("labels");
  MeshRequest request = has_labels ? read_request(run) : request_of(run);
  if (!has_labels && expected.next_tets > 0.0) request.target_tets = expected.next_tets;
  const std::optional<std::size_t> target = request.target_tets;
  const bool by_surface = request.route == MeshRequest::Route::surface;
  if (has_labels && !by_surface) expected.take(find_facts(*request.labels));
  if (by_surface || expected.voxels <= 0.0) {
    estimate.words.push_back("only meshes of labels (route fields) have an estimate");
    return estimate;
  }
  take_regions(expected, request.regions);
  const double cell_size = run.param<double>("cell_size"), voxels = expected.voxels;
  double pace = 1.0;
  bool aims = expected.label_ml.size() > 1;
  if (has_labels) {
    MeshJob job(std::move(request));
    expected.tets = target ? static_cast<double>(*target) : job.expected_tets(cell_size);
    estimate.memory_mb = 1e-6 * job.estimate_memory(expected.tets);
    aims = job.needs_aim();
    pace = pace_of(job, voxels);
  } else {
    const double lattice = request.lattice * cell_size;
    expected.tets = target ? static_cast<double>(*target)
                           : estimate_tets(1e3 * expected.body_ml(), cell_size, lattice);
    const auto fields = static_cast<double>(expected.label_ml.size() + 1);
    estimate.memory_mb = 1e-6 * mesh_memory(expected.tets, fields * voxels);
  }
  const double passes = aims ? run.param<int>("volume_passes") : 0.0;
  set_time(estimate, voxels, target ? Tries{fewest_tries, most_tries} : Tries{passes, passes},
           pace);
  estimate.words.push_back(fmt::format("about {:.0f} tets", expected.tets));
  return estimate;
}

}  // namespace viscera
