#include "stages/report/compare/compare_stage.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "stages/report/compare/csv.hpp"
#include "stages/report/compare/ensemble.hpp"
#include "stages/report/compare/figures.hpp"
#include "stages/report/compare/study.hpp"
#include "stages/report/page.hpp"
#include "stages/report/viewer_data.hpp"
#include "stages/report/web_files.hpp"

namespace viscera {
namespace {

constexpr const char* version = "6";

Param list(const char* name, Json fallback, const char* doc) {
  return {.name = name, .type = ParamType::list, .fallback = std::move(fallback), .doc = doc};
}

StageInfo compare_info() {
  StageInfo info{.name = "compare",
                 .version = version,
                 .doc = "Runs side by side: tables, figures, and what accuracy costs in time"};
  info.inputs = {{.role = "trajectory",
                  .many = true,
                  .doc = "trajectory.h5 in the output folder of viscera-simulate",
                  .manifest = true}};
  info.outputs = {{"compare.html", "comparison", "the page; opens from disk, loads nothing"},
                  {"study.json", "study", "all figures, for programs and --set accuracy"},
                  {"study.csv", "", "the points of every scene, a row each"},
                  {"effects.csv", "", "what each effect costs and changes"},
                  {"methods.csv", "", "time and smoothness of the runs of the table"},
                  {"stiffness.png", "", "grid of runs by time (param grid)"},
                  {"methods.png", "", "methods side by side at their greatest deformation"},
                  {"overlay.png", "", "the second method over the others, outlined"},
                  {"ensemble.png", "", "mean shape of the ensemble, coloured by its spread"}};
  info.params = {
      {.name = "title", .fallback = "Comparison of runs", .doc = "heading of the page"},
      list("cases", Json::array(), "names of the runs, in the order given"),
      list("grid", Json::array(), "runs that make the rows of stiffness.png"),
      list("methods", Json::array(), "runs to overlay; the second is the outlined"),
      list("table", Json::array(), "runs whose time and smoothness are tabulated [methods]"),
      list("ensemble", Json::array(),
           "runs of one mesh whose spread at the end is shown; [all]: every run"),
      list("references", Json::array(), "maps of simulate's params that make a run a reference"),
      list("wanted", Json::array({1.0, 0.5, 0.1}), "errors that the sentences speak of, mm"),
      {.name = "centroid",
       .fallback = "",
       .doc = "label whose centroid is a quantity of its own in a study"},
      {.name = "max_frames",
       .type = ParamType::integer,
       .fallback = 60,
       .lo = 2,
       .hi = 2000,
       .doc = "frames of each method that the page shows"}};
  info.libraries = {{"three.js", VISCERA_THREE_VERSION},
                    {"Chart.js", VISCERA_CHART_VERSION},
                    {"libpng", VISCERA_PNG_VERSION},
                    {"hdf5", hdf5_version()}};
  return info;
}

RunList runs_of(const StageRun& run, const std::vector<ComparedRun>& runs, const char* param) {
  RunList chosen;
  if (run.params().at(param) == Json{"all"}) {
    for (const auto& one : runs) chosen.push_back(&one);
    return chosen;
  }
  for (const auto& name : run.params().at(param)) {
    chosen.push_back(&run_called(runs, name.get<std::string>(), param));
  }
  return chosen;
}

// A method's row of tables 2 and 3 of the source paper: ours, null where a run has no such figure.
Json method_row(const ComparedRun& run) {
  const auto metric = [&run](const char* name) {
    const auto value = run.metric(name);
    return value ? Json(*value) : Json(nullptr);
  };
  Json row{{"run", run.name},
           {"solver", run.param("solver")},
           {"tets", run.tets()},
           {"device", run.manifest["device"]},
           {"exit", run.manifest["exit"]}};
  for (const char* name : {"substeps",
                           "contact_time",
                           "rest_time",
                           "task_wall",
                           "steps_wall",
                           "frames",
                           "frame_ms_median",
                           "frame_ms_q1",
                           "frame_ms_q3",
                           "frame_ms_p99",
                           "setup_wall",
                           "transfer_wall",
                           "diagnosis_wall",
                           "writing_wall",
                           "smoothness_rest",
                           "smoothness_rest_deviation",
                           "max_deformation_time",
                           "smoothness_max_deformation",
                           "smoothness_max_deformation_deviation",
                           "inverted_max_deformation",
                           "inverted_max",
                           "stability_Cs_max",
                           "min_J"}) {
    row[name] = metric(name);
  }
  const auto& times = run.trajectory->times_s();
  row["end_time"] = times.empty() ? 0.0 : times.back();
  row["frames_per_second"] = nullptr;
  if (row["frames"].is_number() && row["steps_wall"].is_number() && row["frames"] > 1) {
    row["frames_per_second"] =
        (row["frames"].get<double>() - 1.0) / row["steps_wall"].get<double>();
  }
  for (const auto& m : run.manifest["metrics"]) {
    if (m["name"] == "cpu_model" || m["name"] == "effects_on") row[m["name"]] = m["value"];
  }
  return row;
}

Json figure_json(const StageRun& run, const char* file, const char* what, const Figure& figure) {
  const std::string path = run.out(file).string();
  write_png(path, figure.image);
  return {{"what", what}, {"png", base64(read_file(path))}, {"caption", figure.caption}};
}

Json figures(const StageRun& run, const RunList& grid, const RunList& methods) {
  Json all = Json::array();
  if (!grid.empty()) all.push_back(figure_json(run, "stiffness.png", "grid", grid_figure(grid, 6)));
  if (!methods.empty()) {
    all.push_back(figure_json(run, "methods.png", "methods", side_by_side_figure(methods)));
  }
  if (methods.size() > 1) {
    all.push_back(figure_json(run, "overlay.png", "overlay", overlay_figure(methods)));
  }
  return all;
}

Json views(const RunList& methods, std::size_t max_frames) {
  Json all = Json::array();
  const std::vector<Colour> colours = colours_of(methods);
  for (const auto* run : methods) {
    ViewerData data = viewer_data(*run->trajectory, max_frames, run->name);
    all.push_back({{"name", run->name},
                   {"colour", colours[all.size()]},
                   {"meta", std::move(data.meta)},
                   {"scene", run->scene},
                   {"series", run->series},
                   {"packed", base64(data.packed)}});
  }
  return all;
}

// study.csv holds the points of all scenes; what only programs want stays in study.json.
void write_tables(const StageRun& run, const Json& report) {
  Json points = Json::array();
  for (const auto& scene : report["study"]["scenes"]) {
    for (const auto& point : scene["points"]) {
      Json row{{"scene", scene["name"]}, {"span", scene["span"]}};
      row.update(point);
      for (const char* column : {"setting", "mesh_sha256", "run", "end_s", "solver_error_bound"})
        row.erase(column);
      points.push_back(std::move(row));
    }
  }
  const auto write = [&run](const char* file, const Json& rows) {
    if (!rows.empty()) write_atomically(run.out(file), csv_of(rows));
  };
  write("study.csv", points);
  write("effects.csv", report["study"]["effects"]);
  write("methods.csv", report["methods"]);
}

void check(const StageRun& run) {
  for (const char* name : {"grid", "methods", "table", "ensemble", "cases"}) {
    for (const auto& item : run.params().at(name)) {
      if (item.is_string()) continue;
      throw Error(
          ExitCode::bad_config,
          {.where = "compare", .field = name, .found = item.dump(), .allowed = "names of runs"});
    }
  }
  for (const auto& item : run.params().at("references")) {
    if (item.is_object()) continue;
    throw Error(ExitCode::bad_config, {.where = "compare",
                                       .field = "references",
                                       .found = item.dump(),
                                       .allowed = "maps of simulate's params, [{solver: tled}]"});
  }
  for (const auto& item : run.params().at("wanted")) {
    if (item.is_number() && item.get<double>() > 0.0) continue;
    throw Error(ExitCode::bad_config, {.where = "compare",
                                       .field = "wanted",
                                       .found = item.dump(),
                                       .allowed = "errors in mm, greater than 0"});
  }
}

void compare(StageRun& run) {
  const auto runs = read_runs(run.inputs("trajectory"), run.params().at("cases"));
  const RunList grid = runs_of(run, runs, "grid"), methods = runs_of(run, runs, "methods");
  StudyOptions options{.references = run.params().at("references")};
  for (const auto& wanted : run.params().at("wanted")) options.wanted_mm.push_back(wanted);
  options.centroid = run.param<std::string>("centroid");
  std::ranges::sort(options.wanted_mm, std::greater());
  Json report{{"title", run.param<std::string>("title")},
              {"version", version},
              {"libraries", compare_info().libraries},
              {"runs", Json::array()},
              {"methods", Json::array()},
              {"study", study_of(runs, options)}};
  for (const auto& one : runs) report["runs"].push_back(method_row(one));
  const RunList table = runs_of(run, runs, "table");
  for (const auto* one : table.empty() ? methods : table)
    report["methods"].push_back(method_row(*one));
  for (const auto& scene : report["study"]["scenes"]) {
    for (const auto& sentence : scene["sentences"]) log::info("{}", sentence.get<std::string>());
  }
  report["figures"] = figures(run, grid, methods);
  report["ensemble"] = nullptr;
  if (const RunList members = runs_of(run, runs, "ensemble"); !members.empty()) {
    const Ensemble ensemble = ensemble_of(members);
    report["ensemble"] = ensemble.json;
    const std::pair<const char*, const char*> doubtful[] = {
        {"left_out", "diverged and are left out"},
        {"failed_gates", "failed gates and are in it"},
        {"not_at_rest", "were not at rest, as others were, and are in it"}};
    for (const auto& [list, words] : doubtful) {
      const auto names = ensemble.json[list].get<std::vector<std::string>>();
      if (names.empty()) continue;
      run.caveat(fmt::format("Of the ensemble's {} runs {} {}: {}.", members.size(), names.size(),
                             words, fmt::join(names, ", ")));
    }
    report["figures"].push_back(
        figure_json(run, "ensemble.png", "ensemble", ensemble_figure(*members.front(), ensemble)));
    for (const auto& label : ensemble.json["labels"]) {
      run.metric("radius_" + label["name"].get<std::string>(), label["radius_mm"], "mm");
    }
  }
  report["views"] = views(methods, run.param<std::size_t>("max_frames"));
  Json programs = report;  // without pictures and geometry
  for (const char* shown : {"figures", "views"}) programs.erase(shown);
  write_atomically(run.out("study.json"), programs.dump(1) + "\n");
  write_tables(run, report);
  const std::string page = filled_page(web::compare(), run.param<std::string>("title"), report);
  write_atomically(run.out("compare.html"), page);
  run.metric("runs", runs.size());
  run.machine_metric("page_size", static_cast<double>(page.size()) / 1e6, "MB");
}

}  // namespace

Stage compare_stage() {
  return {.info = compare_info(), .run = compare, .check = check};
}

}  // namespace viscera
