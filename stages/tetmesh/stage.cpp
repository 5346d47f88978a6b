// Mesh, mend, measure, write. The quality gates are judged on the mesh as written.
#include "stages/tetmesh/stage.hpp"

#include <CGAL/version.h>
#include <fmt/format.h>

#include <cmath>

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/error.hpp"
#include "pipeline/contract/log.hpp"
#include "stages/common/tet_io.hpp"
#include "stages/tetmesh/job.hpp"
#include "stages/tetmesh/measure.hpp"
#include "stages/tetmesh/topology.hpp"

namespace viscera {
namespace {

std::vector<Param> params() {
  return {
      {.name = "route",
       .type = ParamType::text,
       .fallback = "auto",
       .choices = {"auto", "fields", "surface"},
       .doc =
           "fields: all materials from the labels, sharing their interfaces; surface: inside the "
           "given surface; auto: fields when labels are given"},
      quantity("cell_size", "8 mm", "mm", 0.05, 500.0, "bound on the circumradius of a tet"),
      {.name = "target_tets",
       .type = ParamType::integer,
       .fallback = nullptr,
       .lo = 100.0,
       .hi = 20e6,
       .doc = "when set, the cell size is found that gives this many tets within 10 %"},
      quantity("facet_size", 1.0, "1", 0.05, 10.0,
               "surface facets, as a multiple of the cell size"),
      quantity("facet_distance", 0.1, "1", 0.001, 1.0,
               "largest distance of a facet from the surface, as a multiple of the cell size"),
      quantity("facet_angle", "25 deg", "deg", 0.0, 30.0, "smallest angle of a surface facet"),
      quantity("radius_edge", 3.0, "1", 2.0, 10.0, "bound on circumradius over shortest edge"),
      quantity(
          "lattice", 1.4, "1", 0.0, 1.75,
          "constant of the body-centred cubic lattice that fills the inside (route fields), as "
          "a multiple of the cell size; 0: none"),
      quantity("sigma", nullptr, "mm", 0.01, 20.0,
               "Gaussian on the labels (route fields); unset: 0.8 of the largest voxel spacing"),
      {.name = "volume_passes",
       .type = ParamType::integer,
       .fallback = 2,
       .lo = 0.0,
       .hi = 10.0,
       .doc = "trial meshes from which the materials' volumes are calibrated (route fields)"},
      {.name = "improve",
       .type = ParamType::text,
       .fallback = "own",
       .choices = {"own", "cgal", "none"},
       .doc = "own: edge removal, flips, smoothing and collapse, worst tets first; cgal: Mesh_3's "
              "perturbation and exudation of slivers; none: as refined"},
      quantity("sliver_angle", "10 deg", "deg", 0.0, 70.0,
               "dihedral angle below which improve: cgal works on a tet"),
      quantity("min_dihedral", "10 deg", "deg", 0.0, 70.0, "gate: smallest dihedral angle"),
      quantity("max_volume_error", "2 %", "1", 0.0, 1.0,
               "gate: volume of the body against its input"),
      quantity("max_label_error", "10 %", "1", 0.0, 1.0,
               "gate: volume of each label against its own"),
  };
}

struct LabelTotal {
  std::size_t tets = 0;
  double volume = 0.0;  // mm3
};

std::map<int, LabelTotal> totals(const TetMesh& mesh, const std::vector<TetQuality>& quality) {
  std::map<int, LabelTotal> sums;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    auto& sum = sums[mesh.labels[t]];
    ++sum.tets;
    sum.volume += quality[t][volume];
  }
  return sums;
}

Json volumes(StageRun& run, const MeshJob& job, const std::map<int, LabelTotal>& sums) {
  Json list = Json::array();
  double body = 0.0;
  for (const auto& [id, wanted] : job.label_volumes()) {
    const auto found = sums.find(id);
    const LabelTotal sum = found == sums.end() ? LabelTotal{} : found->second;
    const double error = sum.volume / wanted - 1.0;
    body += sum.volume;
    const std::string& name = job.names().at(id);
    log::info("{}: {} tets, {:.2f} ml ({:+.2f} %)", name, sum.tets, sum.volume / 1000.0,
              100.0 * error);
    run.gate(name + ".volume_error", std::abs(error), "<=", run.param<double>("max_label_error"));
    list.push_back({{"name", name},
                    {"id", id},
                    {"tets", sum.tets},
                    {"ml", sum.volume / 1000.0},
                    {"input_ml", wanted / 1000.0},
                    {"volume_error", error}});
  }
  const double error = body / job.body_volume() - 1.0;
  run.gate("volume_error", std::abs(error), "<=", run.param<double>("max_volume_error"));
  return {{"ml", body / 1000.0},
          {"input_ml", job.body_volume() / 1000.0},
          {"volume_error", error},
          {"labels", list}};
}

Json topology_json(const Topology& found, const Mended& mended) {
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
          {"mended",
           {{"islands", mended.islands},
            {"island_tets", mended.island_tets},
            {"island_ml", mended.island_volume / 1000.0},
            {"tets_removed", mended.tets_removed}}}};
}

Json improved_json(const Improved& improved) {
  return {{"edges_removed", improved.edges_removed},
          {"faces_flipped", improved.faces_flipped},
          {"moves", improved.moves},
          {"collapses", improved.collapses},
          {"splits", improved.splits},
          {"worst_before", improved.worst_before},
          {"worst_after", improved.worst_after}};
}

void gate_topology(StageRun& run, const Topology& found, std::size_t bodies) {
  const auto count = [](std::size_t n) { return static_cast<double>(n); };
  run.gate("inverted", count(found.inverted), "<=", 0.0);
  run.gate("duplicates", count(found.duplicate_tets + found.duplicate_points), "<=", 0.0);
  run.gate("stray_points", count(found.stray_points), "<=", 0.0);
  run.gate("non_manifold",
           count(found.non_manifold_edges + found.non_manifold_points + found.overfull_faces),
           "<=", 0.0);
  run.gate("components", count(found.components), "<=", count(bodies));
}

void add_cell_data(TetMesh& mesh, const std::vector<TetQuality>& quality) {
  for (int m = 0; m < measure_count; ++m) {
    auto& values = mesh.cell_data[measures()[m].name];
    for (const auto& q : quality) values.push_back(static_cast<float>(q[m]));
  }
}

void run_tetmesh(StageRun& run) {
  MeshJob job(run);
  const bool searched = run.has_param("target_tets");
  double cell_size = run.param<double>("cell_size");
  if (searched) cell_size = job.find_cell_size(run.param<std::size_t>("target_tets"));
  job.check_cell_size(cell_size);
  const int passes = searched || !job.by_fields() ? 0 : run.param<int>("volume_passes");
  for (int pass = 0; pass < passes; ++pass) {
    log::progress("tets", 0.3 * pass / passes, "calibrating volumes");
    job.calibrate(cell_size);
  }
  log::progress("tets", 0.3, "refining");
  auto [mesh, mended, improved] = job.mesh(cell_size);
  log::progress("tets", 1.0);
  if (mesh.tets.empty()) {
    throw Error(ExitCode::bad_config, {.where = "parameters",
                                       .field = "cell_size",
                                       .found = fmt::format("{:.3g} mm leaves no tet in {:.3g} ml",
                                                            cell_size, job.body_volume() / 1000.0),
                                       .remedy = "use a smaller cell size"});
  }
  if (mended.islands > 0) {
    log::warn(
        "{} pieces of {} tets and {:.3g} ml hung on parts too thin for the cell size: dropped",
        mended.islands, mended.island_tets, mended.island_volume / 1000.0);
  }
  if (mended.tets_removed > 0)
    log::info("boundary made manifold by removing {} tets", mended.tets_removed);
  const auto quality = measure(mesh);
  const Topology found = inspect(mesh);
  const Json summary = summarise(mesh, quality);
  const double smallest = summary["dihedral_min"]["min"], mean = summary["dihedral_min"]["mean"];
  log::info("{} tets, {} points, cell size {:.3g} mm, dihedral min {:.2f} deg, mean {:.1f} deg",
            mesh.tets.size(), mesh.points.size(), cell_size, smallest, mean);

  Json report{{"tets", mesh.tets.size()},
              {"points", mesh.points.size()},
              {"route", job.by_fields() ? "fields" : "surface"},
              {"cell_size_mm", cell_size}};
  report["volume"] = volumes(run, job, totals(mesh, quality));
  report["topology"] = topology_json(found, mended);
  if (improved) report["improved"] = improved_json(*improved);
  report["smoothness"] = volume_smoothness(mesh, quality);
  report["measures"] = summary;
  if (job.fields()) {
    Json biases = Json::object();
    for (std::size_t l = 0; l < job.fields()->ids().size(); ++l)
      biases[job.names().at(job.fields()->ids()[l])] = job.fields()->biases()[l];
    report["fields"] = {{"body_level", job.fields()->level()}, {"biases", biases}};
  }
  run.gate("min_dihedral", smallest, ">=", run.param<double>("min_dihedral"), "deg");
  gate_topology(run, found, job.bodies());
  if (searched) {
    const double target = run.param<double>("target_tets");
    run.gate("target_tets", std::abs(static_cast<double>(mesh.tets.size()) / target - 1.0),
             "<=", 0.1);
  }
  for (const char* name : {"tets", "points", "smoothness", "volume", "topology"})
    run.metric(name, report[name]);
  run.metric("cell_size", cell_size, "mm");
  for (const auto& [name, values] : summary.items()) {
    run.metric(name, Json{{"min", values["min"]}, {"mean", values["mean"]}, {"max", values["max"]}},
               values["unit"]);
  }
  add_cell_data(mesh, quality);
  write_vtu(run.out("mesh.vtu"), mesh);
  write_atomically(run.out("quality.json"), report.dump(1) + "\n");
}

}  // namespace

Stage tetmesh_stage() {
  Stage stage;
  stage.info = {
      .name = "tetmesh",
      .version = "2",
      .doc = "Labels or a surface to a conforming tetrahedral mesh with its quality.",
      .inputs = {{.role = "labels", .required = false, .doc = "labels.nrrd of viscera-labels"},
                 {.role = "surface", .required = false, .doc = "surface.vtp, one closed body"}},
      .outputs = {{"mesh.vtu", "mesh", "tets, cell array label, quality per tet, LPS mm"},
                  {"quality.json", "", "measures, histograms, worst tets, volumes, topology"}},
      .params = params(),
      .libraries = {{"CGAL", CGAL_VERSION_STR}}};
  stage.run = run_tetmesh;
  return stage;
}

}  // namespace viscera
