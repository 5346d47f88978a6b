// Make or take a mesh, judge it, write it. The quality gates are judged on the mesh as written.
#include "stages/tetmesh/stage.hpp"

#include <CGAL/version.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <optional>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "stages/mesh/surface_io.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/tetmesh/estimate.hpp"
#include "stages/tetmesh/exchange/export.hpp"
#include "stages/tetmesh/exchange/gmsh_session.hpp"
#include "stages/tetmesh/exchange/import.hpp"
#include "stages/tetmesh/gates.hpp"
#include "stages/tetmesh/judge.hpp"
#include "stages/tetmesh/mesher/mesh_job.hpp"
#include "stages/tetmesh/read_request.hpp"
#include "stages/tetmesh/watchdog.hpp"

namespace viscera {
namespace {

constexpr int coarsenings = 8;

std::vector<Param> params() {
  return {
      {.name = "route",
       .type = ParamType::text,
       .fallback = "auto",
       .choices = {"auto", "fields", "surface"},
       .doc =
           "fields: all materials from the labels, sharing their interfaces; surface: inside the "
           "given surface; auto: fields when labels are given. A given mesh is taken as it is"},
      quantity("cell_size", "8 mm", "mm", 0.05, 500.0, "bound on the circumradius of a tet"),
      {.name = "target_tets",
       .type = ParamType::integer,
       .fallback = nullptr,
       .lo = fewest_tets,
       .hi = most_tets,
       .doc =
           "when set, the cell size is found that gives this many tets within 10 %; a size_field "
           "that says how many it wants has the last word"},
      {.name = "sizes",
       .type = ParamType::map,
       .fallback = Json::object(),
       .entry = {size_param()},
       .doc = "cell sizes of labels that shall not have cell_size (route fields): {tumour: 3 mm}"},
      quantity(
          "interface_size", 1.0, "1", 0.05, 1.0,
          "size at the boundary and between labels, as a part of the cell size (route fields)"),
      quantity("grading", 0.3, "1", 0.01, 10.0,
               "mm that the size may grow in a mm, where sizes differ"),
      {.name = "regions",
       .type = ParamType::map,
       .fallback = Json::object(),
       .entry = region_params(),
       .doc = "parts of the body that a scene's effects name, with their borders among the faces "
              "of the mesh: {support: {side: superior, within: 30 mm}, patch: {box_lo: [0 mm, "
              "0 mm, 0 mm], box_hi: [..]}}; a side is one of the labels, or of the surface"},
      quantity("facet_size", 1.0, "1", 0.05, 10.0,
               "surface facets, as a multiple of the cell size"),
      quantity("facet_distance", 0.1, "1", 0.001, 1.0,
               "largest distance of a facet from the surface, as a multiple of the cell size"),
      quantity("facet_angle", "25 deg", "deg", 0.0, 30.0, "smallest angle of a surface facet"),
      quantity("radius_edge", 3.0, "1", 2.0, 10.0, "bound on circumradius over shortest edge"),
      quantity("lattice", 1.25, "1", 0.0, 1.75,
               "constant of the body-centred cubic lattice that fills the inside, as a multiple of "
               "the cell size; 0: none"),
      quantity("sigma", nullptr, "mm", 0.01, 20.0,
               "Gaussian on the labels (route fields); unset: 0.8 of the largest voxel spacing"),
      {.name = "volume_passes",
       .type = ParamType::integer,
       .fallback = 2,
       .lo = 0.0,
       .hi = 10.0,
       .doc = "trial meshes from which the volumes of several materials are calibrated (route "
              "fields)"},
      {.name = "mesher",
       .type = ParamType::text,
       .fallback = "cgal",
       .choices = {"cgal", "hxt"},
       .doc = "cgal: Mesh_3; hxt: gmsh's HXT between the boundary and interfaces of Mesh_3"},
      {.name = "improve",
       .type = ParamType::text,
       .fallback = "auto",
       .choices = {"auto", "own", "cgal", "none"},
       .doc = "own: edge removal, flips, smoothing and collapse, worst tets first; cgal: Mesh_3's "
              "perturbation and exudation of slivers; none: as refined or given; auto: own, but "
              "none for a given mesh without regions"},
      quantity("sliver_angle", "10 deg", "deg", 0.0, 70.0,
               "dihedral angle below which improve: cgal works on a tet"),
      {.name = "time_limit",
       .type = ParamType::real,
       .fallback = "120 min",
       .unit = "s",
       .lo = 0.01,
       .hi = 1e6,
       .doc = "meshing that takes longer is ended (exit 75)",
       .in_key = false},
      {.name = "formats",
       .type = ParamType::list,
       .fallback = Json::array({"vtu"}),
       .doc = "files to write: vtu (always), msh, inp, feb"},
      {.name = "materials",
       .type = ParamType::map,
       .fallback = Json::object(),
       .entry = elastic_params(),
       .doc = "{label name: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3}}, for inp, feb and substeps"},
      {.name = "substeps",
       .type = ParamType::integer,
       .fallback = nullptr,
       .lo = 1.0,
       .hi = 1e6,
       .doc = "with materials: substeps a frame in which a simulation shall be stable (Cs <= 0.6); "
              "cell_size is raised as far as that needs, and a gate says whether it was enough"},
      quantity("frame_rate", "60 Hz", "Hz", 1.0, 1e5, "frames a second, for substeps"),
      quantity("min_dihedral", "10 deg", "deg", 0.0, 70.0, "gate: smallest dihedral angle"),
      quantity("max_volume_error", "2 %", "1", 0.0, 1.0,
               "gate: volume of the body against its input"),
      quantity("max_label_error", "10 %", "1", 0.0, 1.0,
               "gate: volume of each label against its own"),
      quantity("max_distance", nullptr, "mm", 0.0, 1e3,
               "gate, where a surface is given: largest distance between it and the mesh, either "
               "way; unset: only reported"),
      // As for the volume of a surface. The labels of four livers lose .003 to .05 % at 50,000
      // tets.
      quantity("max_lost_volume", "0.2 %", "1", 0.0, 1.0,
               "gate: volume of the lost parts (more than half a cell outside the mesh) over that "
               "of the labels, or of the surface where there are none"),
      // At 50,000 tets livers that keep their parts have voxels up to 0.8 and 1.0 cells from the
      // mesh, those that lose a strand of 20 or 15 mm, 2.5 and 2.7.
      quantity("max_lost_distance", 2.0, "1", 0.5, 1e3,
               "gate: largest distance of a voxel of the labels, or of the surface where there "
               "are none, from the mesh, as a multiple of the cell size"),
  };
}

Json mended_json(const Mended& mended) {
  return {{"islands", mended.islands},
          {"island_tets", mended.island_tets},
          {"island_ml", mended.island_volume / 1000.0},
          {"tets_removed", mended.tets_removed}};
}

Json improved_json(const Improved& improved) {
  return {{"thinned", improved.thinned},
          {"edges_removed", improved.edges_removed},
          {"faces_flipped", improved.faces_flipped},
          {"moves", improved.moves},
          {"collapses", improved.collapses},
          {"splits", improved.splits},
          {"shared", improved.shared},
          {"worst_before", improved.worst_before},
          {"worst_after", improved.worst_after}};
}

Json repairs_json(const Repairs& repairs) {
  return {{"cells_skipped", repairs.cells_skipped},    {"points_merged", repairs.points_merged},
          {"tets_collapsed", repairs.tets_collapsed},  {"duplicate_tets", repairs.duplicate_tets},
          {"tets_turned", repairs.tets_turned},        {"stray_points", repairs.stray_points},
          {"tets_relabelled", repairs.tets_relabelled}};
}

Json regions_json(const TetMesh& mesh, const std::vector<TetQuality>& quality) {
  Json regions = Json::object();
  for (const auto& [name, inside] : mesh.regions) {
    double ml = 0.0;
    for (std::size_t t = 0; t < inside.size(); ++t)
      if (inside[t]) ml += quality[t][volume] / 1000.0;
    regions[name] = {{"tets", std::ranges::count(inside, 1)}, {"ml", ml}};
  }
  return regions;
}

void add_cell_data(TetMesh& mesh, const std::vector<TetQuality>& quality) {
  for (int m = 0; m < measure_count; ++m) {
    auto& values = mesh.cell_data[measures()[m].name];
    for (const auto& q : quality) values.push_back(static_cast<float>(q[m]));
  }
}

// The finished mesh, what it is judged against, and how it came about.
struct Made {
  TetMesh mesh;
  Wanted wanted;
  Json how;
};

void report_mended(const Mended& mended) {
  if (mended.islands > 0) {
    log::warn(
        "{} pieces of {} tets and {:.3g} ml hung on parts too thin for the cell size: dropped",
        mended.islands, mended.island_tets, mended.island_volume / 1000.0);
  }
  if (mended.tets_removed > 0)
    log::info("boundary made manifold by removing {} tets", mended.tets_removed);
}

using Target = std::optional<std::size_t>;  // tets; none: as many as the cell size gives

double expected_tets(const StageRun& run, const MeshJob& job, const Target& target) {
  if (target) return static_cast<double>(*target);
  const double cell_size = run.param<double>("cell_size");
  job.check_cell_size(cell_size);
  return job.expected_tets(cell_size);
}

void calibrate(const StageRun& run, MeshJob& job, double cell_size) {
  const int passes = job.needs_aim() ? run.param<int>("volume_passes") : 0;
  for (int pass = 0; pass < passes; ++pass) {
    log::progress("tets", 0.3 * pass / passes, "calibrating volumes");
    job.calibrate(cell_size);
  }
}

double settle_cell_size(const StageRun& run, MeshJob& job, const Target& target) {
  if (target) return job.find_cell_size(*target);
  const double cell_size = run.param<double>("cell_size");
  calibrate(run, job, cell_size);
  return cell_size;
}

// How many tets of a mesh are too many or too few for its target, as a logarithm.
double off_target(const TetMesh& mesh, const Target& target) {
  if (!target) return 0.0;
  return std::log(std::max(1.0, static_cast<double>(mesh.tets.size())) /
                  static_cast<double>(*target));
}

// The larger of what a mesh is off its target and what its angles lack, in units of what their
// gates allow.
double missed(const TetMesh& mesh, const Target& target, double min_dihedral_deg) {
  double miss = std::abs(std::expm1(off_target(mesh, target))) / allowed_off_target;
  if (min_dihedral_deg <= 0.0) return miss;
  for (const TetQuality& tet : measure(mesh))
    miss = std::max(miss, min_dihedral_deg / std::max(tet[dihedral_min], 1e-6));
  return miss;
}

// How many tets a cell size gives, and which of them the border of a region cuts flat, is by
// chance: where a gate would fail for that, nearly the same cell size mostly passes.
MeshJob::Result mesh_of(const StageRun& run, const MeshJob& job, const Target& target,
                        double& cell_size) {
  constexpr int retries = 4;
  constexpr double apart = 0.015;
  const double least_angle = job.has_regions() ? run.param<double>("min_dihedral") : 0.0;
  const double asked = cell_size;
  double tried = asked;
  MeshJob::Result best = job.mesh(tried);
  double miss = missed(best.mesh, target, least_angle), off = off_target(best.mesh, target);
  for (int retry = 1; retry <= retries && miss > 1.0; ++retry) {
    if (std::abs(std::expm1(off)) > allowed_off_target) {
      tried *= std::exp(off / 3.0);
    } else {
      const int steps = (retry + 1) / 2;
      tried = asked * (1.0 + (retry % 2 == 1 ? -steps : steps) * apart);
    }
    MeshJob::Result other = job.mesh(tried);
    const double missed_now = missed(other.mesh, target, least_angle);
    off = off_target(other.mesh, target);
    log::info("cells of {:.3f} mm miss a gate by a factor of {:.2f}, of {:.3f} mm {}", cell_size,
              miss, tried, missed_now <= 1.0 ? "none" : fmt::format("by {:.2f}", missed_now));
    if (missed_now >= miss) continue;
    miss = missed_now, cell_size = tried, best = std::move(other);
  }
  return best;
}

// A mesh whose altitudes are large enough for the substeps asked for. They grow with the cell size,
// but unevenly: steps are shorter than what is missing, so as not to end coarser than needed.
MeshJob::Result mesh_for(const StageRun& run, MeshJob& job, const TimeGoal& goal,
                         const Target& target, double& cell_size) {
  log::progress("tets", 0.3, "refining");
  MeshJob::Result result = mesh_of(run, job, target, cell_size);
  if (target) return result;
  for (int attempt = 1; attempt < coarsenings; ++attempt) {
    const double factor =
        shortfall(assess_time_step(result.mesh, measure(result.mesh), goal), goal);
    if (factor <= 1.0) break;
    log::info("cell size {:.3g} mm: altitudes {:.3g} times too small for {} substeps", cell_size,
              factor, *goal.substeps);
    cell_size *= std::max(1.03, std::pow(factor, 0.7));
    calibrate(run, job, cell_size);
    result = job.mesh(cell_size);
  }
  return result;
}

TimeGoal time_goal(const StageRun& run, const std::map<int, std::string>& names) {
  TimeGoal goal{.frame_s = 1.0 / run.param<double>("frame_rate"),
                .materials = read_materials(run.params().at("materials"), names)};
  if (!run.has_param("substeps")) return goal;
  goal.substeps = run.param<int>("substeps");
  if (!goal.materials.empty()) return goal;
  throw Error(ExitCode::bad_config, {.where = "parameters",
                                     .field = "substeps",
                                     .found = "given without materials",
                                     .allowed = "both, or neither",
                                     .remedy = "add materials: {NAME: {E: ..., nu: ..., density: "
                                               "...}}"});
}

Made make_mesh(StageRun& run, MeshRequest request) {
  const Target target = request.target_tets;
  MeshJob job(std::move(request));
  const TimeGoal time = time_goal(run, job.names());
  const double tets = expected_tets(run, job, target), memory = job.estimate_memory(tets);
  log::info("expecting about {:.0f} thousand tets and {:.0f} MB", tets / 1e3, memory / 1e6);
  check_memory(memory);
  std::optional<Watchdog> watchdog;
  if (!run.is_in_memory())
    watchdog.emplace(run.param<double>("time_limit"), memory, run.out("").parent_path());
  double cell_size = settle_cell_size(run, job, target);
  const std::clock_t begin = std::clock();  // in one thread
  auto [mesh, mended, improved] = mesh_for(run, job, time, target, cell_size);
  run.machine_metric("meshing", static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC, "s");
  log::progress("tets", 1.0);
  if (mesh.tets.empty()) {
    throw Error(ExitCode::bad_config, {.where = "parameters",
                                       .field = "cell_size",
                                       .found = fmt::format("{:.3g} mm leaves no tet in {:.3g} ml",
                                                            cell_size, job.body_volume() / 1000.0),
                                       .remedy = "use a smaller cell size"});
  }
  report_mended(mended);
  log::info("cell size {:.3g} mm", cell_size);
  run.metric("cell_size", cell_size, "mm");
  Made made{.mesh = std::move(mesh),
            .wanted = {.label_volumes = job.label_volumes(),
                       .body_volume = job.body_volume(),
                       .bodies = job.bodies(),
                       .cell_size = cell_size,
                       .time = time},
            .how = {{"route", job.by_fields() ? "fields" : "surface"},
                    {"cell_size_mm", cell_size},
                    {"mended", mended_json(mended)}}};
  if (target) made.wanted.tets = static_cast<double>(*target);
  if (job.labels()) {
    made.wanted.labels = job.labels();
    made.wanted.loss = job.loss(made.mesh, cell_size);
    made.wanted.misplaced = job.misplaced(made.mesh, cell_size);
  }
  if (improved) made.how["improved"] = improved_json(*improved);
  if (job.fields()) {
    Json biases = Json::object();
    for (std::size_t l = 0; l < job.fields()->ids().size(); ++l)
      biases[job.names().at(job.fields()->ids()[l])] = job.fields()->biases()[l];
    made.how["fields"] = {{"body_level", job.fields()->level()}, {"biases", biases}};
  }
  return made;
}

// Regions that the file brings along, where tets are to change: nothing holds their borders then.
void drop_regions(TetMesh& mesh) {
  for (const auto& [name, inside] : mesh.regions)
    log::warn("region {} of the file is dropped, for its tets are changed", name);
  mesh.regions.clear();
}

// A mesh made elsewhere. No surface holds its boundary, so that the improver leaves it alone, and
// with it the borders of regions.
Made take_mesh(StageRun& run) {
  if (run.has_input("size_field")) {
    throw Error(ExitCode::bad_config, {.where = run.input("size_field").string(),
                                       .field = "size_field",
                                       .found = "given beside a mesh, which is taken as it is",
                                       .allowed = "size_field beside labels",
                                       .remedy = "leave one of the two out"});
  }
  Imported imported = import_mesh(run.input("mesh"));
  Made made{.mesh = std::move(imported.mesh), .how = {{"route", "import"}}};
  const Json repairs = repairs_json(imported.repairs);
  for (const auto& [what, count] : repairs.items())
    if (count.get<std::size_t>() > 0 && what != "cells_skipped")
      log::warn("mended: {} {}", count.get<std::size_t>(), what);
  if (imported.labels_from.empty())
    log::warn("{}: no labels: all tets are label 1", run.input("mesh").string());
  made.how["labels_from"] = imported.labels_from;
  made.how["repairs"] = repairs;
  run.metric("repairs", repairs);
  const auto improver = run.param<std::string>("improve");
  if (improver == "cgal") {
    throw Error(ExitCode::bad_config, {.where = "parameters",
                                       .field = "improve",
                                       .found = "cgal, for a mesh that Mesh_3 did not make",
                                       .allowed = "auto, own or none"});
  }
  made.wanted.time = time_goal(run, made.mesh.label_names);
  const auto regions =
      make_regions(read_regions(run.params().at("regions")), box_of(made.mesh.points));
  const auto planes = planes_of(regions);
  const bool improves = improver == "own" || (improver == "auto" && !planes.empty());
  if (improves || !planes.empty()) drop_regions(made.mesh);
  cut_along(made.mesh, planes, with_planes({}, planes));
  if (improves) made.how["improved"] = improved_json(improve(made.mesh, {}));
  name_regions(made.mesh, regions);
  return made;
}

// What quality.json says; the measures become cell data.
Json judge_made(StageRun& run, Made& made) {
  const auto quality = measure(made.mesh);
  Json report = judge(run, made.mesh, quality, made.wanted);
  for (const auto& [key, value] : made.how.items()) report[key] = value;
  if (!made.mesh.regions.empty()) report["regions"] = regions_json(made.mesh, quality);
  add_cell_data(made.mesh, quality);
  const auto& missing = made.wanted.loss.missing;
  if (made.wanted.labels) {
    made.mesh.cell_data[missing_volume].assign(missing.begin(), missing.end());
  }
  return report;
}

void run_tetmesh(StageRun& run) {
  Made made = run.has_input("mesh") ? take_mesh(run) : make_mesh(run, read_request(run));
  if (run.has_input("surface")) made.wanted.surface = body_of(read_vtp(run.input("surface")));
  const Json report = judge_made(run, made);
  const TetExport body = prepare_export(made.mesh, made.wanted.time.materials);
  for (const auto& format : chosen_formats(run.params().at("formats")))
    format.write(run.out(format.file), body);
  write_atomically(run.out("quality.json"), report.dump(1) + "\n");
}

std::vector<OutputFile> outputs() {
  std::vector<OutputFile> files;
  for (const auto& format : tet_formats())
    files.push_back({format.file, files.empty() ? "mesh" : "", format.doc});
  files.push_back({"quality.json", "", "measures, histograms, worst tets, volumes, topology"});
  return files;
}

}  // namespace

TetMesh make_tets(StageRun& run, const TetSource& source) {
  const auto& [labels, surface, size_field] = source;
  MeshRequest request = request_of(run);
  const bool by_fields = request.by_fields(labels != nullptr, surface != nullptr);
  if (size_field) take_size_field(*size_field, "size_field", request);
  if (labels) request.labels = *labels;
  if (!by_fields) request.surface = *surface;
  Made made = make_mesh(run, std::move(request));
  if (surface) made.wanted.surface = body_of(*surface);
  judge_made(run, made);
  return std::move(made.mesh);
}

Stage tetmesh_stage() {
  Stage stage;
  stage.info = {
      .name = "tetmesh",
      .version = "12",
      .doc = "Labels or a surface to a conforming tetrahedral mesh with its quality.",
      .inputs = {{.role = "labels", .required = false, .doc = "labels.nrrd of viscera-labels"},
                 {.role = "surface",
                  .required = false,
                  .doc = "surface.vtp, one closed body; the mesh's distance from it is measured"},
                 {.role = "mesh",
                  .required = false,
                  .doc = "a mesh made elsewhere, .vtu or .msh: checked, repaired or refused"},
                 {.role = "size_field",
                  .required = false,
                  .doc = "size_field.vtu of viscera-simulate: cells are smaller where they have a "
                         "larger part in the error (route fields)"}},
      .outputs = outputs(),
      .params = params(),
      .gates = mesh_gates::all(),
      .libraries = {{"CGAL", CGAL_VERSION_STR}, {"gmsh", gmsh_version()}}};
  stage.run = run_tetmesh;
  stage.estimate = estimate_tetmesh;
  stage.check = [](const StageRun& run) {
    chosen_formats(run.params().at("formats"));
    read_regions(run.params().at("regions"));
  };
  return stage;
}

}  // namespace viscera
