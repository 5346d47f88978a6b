#include "stages/report/report_stage.hpp"

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "stages/report/gltf.hpp"
#include "stages/report/page.hpp"
#include "stages/report/slices.hpp"
#include "stages/report/sources.hpp"
#include "stages/report/viewer_data.hpp"

namespace viscera {
namespace {

constexpr const char* version = "3";

StageInfo report_info() {
  StageInfo info{.name = "report",
                 .version = version,
                 .doc = "One self-contained HTML page from the files of a run"};
  const auto optional = [](const char* role, const char* doc) {
    return InputRole{.role = role, .required = false, .doc = doc, .manifest = true};
  };
  info.inputs = {
      optional("labels", "labels.nrrd, with labels.json and manifest.json beside it"),
      optional("image", "image.nrrd of viscera-labels: the CT, shown with the labels on it"),
      optional("surface", "surface.vtp, with manifest.json beside it"),
      optional("mesh", "mesh.vtu, with quality.json and manifest.json beside it"),
      optional("trajectory", "trajectory.h5, with metrics.csv and manifest.json beside it")};
  info.outputs = {{"report.html", "report", "the page; opens from disk, loads nothing"},
                  {"summary.json", "", "verdict, gates, metrics and digests for programs"},
                  {"animation.glb", "", "the motion as animated glTF, for other viewers and AR"}};
  info.params = {{.name = "title",
                  .type = ParamType::text,
                  .fallback = "Soft-tissue simulation",
                  .doc = "heading of the page"},
                 {.name = "max_frames",
                  .type = ParamType::integer,
                  .fallback = 120,
                  .lo = 2,
                  .hi = 2000,
                  .doc = "frames of the trajectory to show at most, evenly chosen"},
                 {.name = "gltf_frames",
                  .type = ParamType::integer,
                  .fallback = 30,
                  .lo = 0,
                  .hi = 2000,
                  .doc = "frames of animation.glb at most; 0: no such file"}};
  info.libraries = {{"three.js", VISCERA_THREE_VERSION},
                    {"Chart.js", VISCERA_CHART_VERSION},
                    {"hdf5", VISCERA_HDF5_VERSION},
                    {"zlib", VISCERA_ZLIB_VERSION}};
  return info;
}

std::map<std::string, std::filesystem::path> given_inputs(const StageRun& run) {
  std::map<std::string, std::filesystem::path> inputs;
  for (const auto& declared : report_info().inputs) {
    if (run.has_input(declared.role)) inputs[declared.role] = run.input(declared.role);
  }
  return inputs;
}

void check(const StageRun& run) {
  if (run.has_input("image") && !run.has_input("labels")) {
    throw Error(ExitCode::usage, {.where = "command line",
                                  .field = "--in image",
                                  .found = "an image without labels to show on it",
                                  .remedy = "add --in labels=labels.nrrd"});
  }
  if (!given_inputs(run).empty()) return;
  throw Error(ExitCode::usage, {.where = "command line",
                                .field = "--in",
                                .found = "nothing to report on",
                                .allowed = "labels, surface, mesh, trajectory: at least one",
                                .remedy = "add for example --in trajectory=out/trajectory.h5"});
}

void make_report(StageRun& run) {
  const auto title = run.param<std::string>("title");
  Json report = read_sources(given_inputs(run));
  report["title"] = title;
  report["version"] = version;
  report["libraries"] = report_info().libraries;
  report["verdict"] = verdict_of(report);
  report["viewer"] = nullptr;
  std::string geometry;
  if (run.has_input("trajectory")) {
    const auto path = run.input("trajectory");
    const TrajectoryReader trajectory(path);
    Json simulate;
    for (const auto& stage : report["stages"]) {
      if (stage["stage"] == "simulate") simulate = stage;
    }
    ViewerData viewer =
        viewer_data(trajectory, run.param<std::size_t>("max_frames"), path.string(),
                    tissue_of(report["scene"], path.parent_path() / "scene.json", simulate));
    report["viewer"] = std::move(viewer.meta);
    geometry = std::move(viewer.packed);
    const std::string gltf = gltf_binary(trajectory, run.param<std::size_t>("gltf_frames"));
    if (!gltf.empty()) write_atomically(run.out("animation.glb"), gltf);
  }
  report["slices"] = nullptr;
  std::string packed_slices;
  if (run.has_input("image")) {
    Slices slices = slices_of(run.input("image"), run.input("labels"));
    report["slices"] = std::move(slices.meta);
    packed_slices = std::move(slices.packed);
  }
  const std::string page = filled_page(web::report(), title, report, geometry, packed_slices);
  write_atomically(run.out("report.html"), page);
  write_atomically(run.out("summary.json"), document_of(summary_of(report)));
  run.machine_metric("page_size", static_cast<double>(page.size()) / 1e6, "MB");
  run.metric("gates_passed", report["verdict"]["gates_passed"]);
  run.metric("gates_failed", report["verdict"]["gates_failed"]);
  if (report["viewer"].is_null()) return;
  run.metric("position_error", report["viewer"]["position_error_mm"], "mm");
  run.metric("frames_shown", report["viewer"]["times_s"].size());
}

// Between .03 and .4 s on trajectories of .1 to 4 MB (docs/performance.md); slices of an image come
// besides.
Estimate estimate_report(StageRun& run, const Expected& before) {
  constexpr double low_s = 0.05, high_s = 0.4, least_s_per_mb = 0.03, most_s_per_mb = 0.15;
  constexpr double program_mb = 33.0, mb_per_mb = 1.0;
  Estimate estimate{.expected = before};
  double mb = before.trajectory_mb;
  if (run.has_input("trajectory"))
    mb = 1e-6 * static_cast<double>(std::filesystem::file_size(run.input("trajectory")));
  estimate.memory_mb = program_mb + mb_per_mb * mb;
  estimate.wall_low_s = low_s + least_s_per_mb * mb;
  estimate.wall_high_s = high_s + most_s_per_mb * mb;
  return estimate;
}

}  // namespace

Stage report_stage() {
  return {.info = report_info(), .run = make_report, .check = check, .estimate = estimate_report};
}

}  // namespace viscera
