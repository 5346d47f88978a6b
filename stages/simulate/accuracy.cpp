#include "stages/simulate/accuracy.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/base/log.hpp"
#include "pipeline/contract/input_digest.hpp"
#include "sim/make.hpp"
#include "sim/measures/stability.hpp"
#include "stages/simulate/scene/scene_file.hpp"
#include "stages/simulate/stage.hpp"

namespace viscera {
namespace {

Error refused(const StageRun& run, const std::string& found, const std::string& allowed,
              const std::string& remedy) {
  return Error(ExitCode::bad_config, {.where = run.input("study").string(),
                                      .field = "accuracy",
                                      .found = found,
                                      .allowed = allowed,
                                      .remedy = remedy});
}

// What this run asks for, as far as a point of the study may have been made for something else.
struct Question {
  double accuracy_mm, end_s;
  double accuracy_limit;  // of the scene; 0: none
};

Question question_of(const StageRun& run) {
  const SceneFile file = read_scene(run.input("scene"), run.params().at("change"));
  return {.accuracy_mm = run.param<double>("accuracy"),
          .end_s = run.has_param("end") ? run.param<double>("end") : file.scene.time.end_s,
          .accuracy_limit = file.scene.accuracy_limit};
}

// What is wrong with an input that changes the problem: "" where the study's runs had the same.
std::string other_input(const StageRun& run, const JsonValue& scene, const std::string& role) {
  const auto known = scene.find(role + "_sha256");
  if (!run.has_input(role)) return known ? "no " + role + ", which the study's runs had" : "";
  if (!known) return "a " + role + ", which the study's runs of this scene did not have";
  if (known->text() == input_digest(run.input(role)).sha256) return "";
  return "another " + role + " than the study's runs had";
}

JsonValue scene_in(const StageRun& run, const JsonValue& study) {
  const std::string sha256 = input_digest(run.input("scene")).sha256;
  std::string other;
  for (const auto& scene : study["study"]["scenes"].items()) {
    const bool same_change = scene["change"].raw() == run.params().at("change");
    if (scene["scene_sha256"].text() != sha256 || !same_change) continue;
    other = other_input(run, scene, "checkpoint");
    if (other.empty()) other = other_input(run, scene, "stiffness");
    if (other.empty()) return scene;
  }
  if (!other.empty()) {
    throw refused(run, other, "the inputs of the study's runs",
                  "set solver and substeps instead, or run a study with it");
  }
  throw refused(run, "the study does not hold this scene", "a study of the very scene and change",
                "run a study with it: add it to configs/study.yaml");
}

// How far off the truth of the body may be, mm.
double doubt_of(const StageRun& run, const JsonValue& scene) {
  if (const auto body = scene.find("body")) return (*body)["agreement_mm"].number();
  throw refused(
      run, "the study knows the solver's error only, not the mesh's: " + scene["no_body"].text(),
      "a scene whose references are quadratic tets on two meshes finer than this one",
      "add such references to the study (configs/study.yaml has them for the scene settle), "
      "or set solver and substeps instead");
}

std::string text_or(const JsonValue& json, const char* member, const char* otherwise) {
  const auto found = json.find(member);
  return found ? found->text() : otherwise;
}

// What a time that was kept in single precision is told from another by, as a share.
constexpr double single_precision = 1e-6;

// Why this point shows nothing of the error of this run; "": it does.
std::string why_not(const JsonValue& point, const Question& question) {
  const std::string solver = text_or(point["setting"], "solver", "xpbd");
  const auto exceeds = [&point](const char* member, double limit) {
    const auto value = point.find(member);
    return value && value->number() > limit;
  };
  if (const std::string failed = point["failed"].text(); !failed.empty()) return failed;
  // How near PBD comes with one stiffness and substep says nothing of its error with others.
  if (solver == "pbd") return "PBD, whose error at one setting says nothing of another";
  if (!point.find("total_mm")) return "no truth on a finer mesh";
  // Quadratic tets are named by another param.
  const auto order = point["setting"].find("fem_order");
  const bool is_quadratic = solver == "fem" && order && order->number() == 2.0;
  if (!is_quadratic && !point["setting"].find("element")) return "unknown elements";
  const auto end = point.find("end_s");
  if (!end) return "unknown end";
  if (std::abs(end->number() - question.end_s) > single_precision * question.end_s) {
    return fmt::format("ran to {:g} s and not to {:g} s", end->number(), question.end_s);
  }
  if (exceeds("inverted", 0.0)) return "inverted tets";
  if (solver == "xpbd" && exceeds("cs", sim::cs_limit)) {
    return fmt::format("Cs above {:g}", sim::cs_limit);
  }
  if (question.accuracy_limit > 0.0 && exceeds("solver_error_bound", question.accuracy_limit)) {
    return fmt::format("predicted solver's error above the scene's accuracy_limit of {:g} %",
                       100.0 * question.accuracy_limit);
  }
  return "";
}

// One way to solve the scene.
struct Point {
  JsonValue json;
  std::string label, mesh_sha256, device;
  std::string why_not;  // as above
  std::optional<double> total_mm;

  bool counts() const { return why_not.empty(); }
  // Lower quartile (0), median or upper quartile (2) of its times.
  double cost(std::size_t quartile = 1) const { return json["ms"][quartile].number(); }
};

Point point_from(const JsonValue& json, const Question& question) {
  Point point{.json = json,
              .label = json["label"].text(),
              .mesh_sha256 = json["mesh_sha256"].text(),
              .device = text_or(json["setting"], "device", "cpu"),
              .why_not = why_not(json, question)};
  if (const auto total = json.find("total_mm")) point.total_mm = total->number();
  return point;
}

std::vector<Point> points_of(const JsonValue& scene, const Question& question) {
  std::vector<Point> points;
  for (const auto& point : scene["points"].items()) points.push_back(point_from(point, question));
  return points;
}

// Whether a point was timed on a device that this run may use.
bool is_at_hand(const StageRun& run, const Point& point) {
  const std::string wanted = run.param<std::string>("device");
  if (wanted != "auto") return point.device == wanted;
  return point.device == "cpu" || sim::find_cuda_device().name;
}

// What to do where no point on this mesh gets there: a mesh with one that does, or else
// `otherwise`.
std::string remedy_for(const std::vector<Point>& points, double doubt, double accuracy_mm,
                       const char* otherwise) {
  for (const auto& point : points) {
    if (!point.counts() || *point.total_mm + doubt > accuracy_mm) continue;
    return fmt::format("take the study's mesh of {} tets, on which {} reaches it",
                       point.json["tets"].whole<int>(), point.label);
  }
  return otherwise;
}

// "Cs above 0.6 (xpbd, 16 substeps; xpbd, 8 substeps), diverged (tled, 16 substeps)".
std::string reasons_of(const std::vector<const Point*>& left_out) {
  std::map<std::string, std::vector<std::string>> labels;
  for (const Point* point : left_out) labels[point->why_not].push_back(point->label);
  std::vector<std::string> reasons;
  for (const auto& [reason, names] : labels) {
    reasons.push_back(fmt::format("{} ({})", reason, fmt::join(names, "; ")));
  }
  return fmt::format("{}", fmt::join(reasons, ", "));
}

// What reaches it on this mesh and device, the cheapest first; refused if there is nothing.
std::vector<Point> reaching(const StageRun& run, const std::vector<Point>& points, double doubt,
                            double accuracy_mm) {
  const std::string mesh = input_digest(run.input("mesh")).sha256;
  std::vector<Point> all;
  std::vector<const Point*> left_out;
  const Point* nearest = nullptr;
  for (const auto& point : points) {
    if (point.mesh_sha256 != mesh || !is_at_hand(run, point)) continue;
    if (!point.counts()) {
      left_out.push_back(&point);
      continue;
    }
    if (!nearest || *point.total_mm < *nearest->total_mm) nearest = &point;
    if (*point.total_mm + doubt <= accuracy_mm) all.push_back(point);
  }
  std::ranges::stable_sort(all, {}, [](const Point& point) { return point.cost(); });
  if (!all.empty()) return all;
  if (!nearest && left_out.empty()) {
    throw refused(run, "the study has no point on this mesh and device",
                  "a mesh and a device that the study has used", "run the study with them");
  }
  if (!nearest) {
    throw refused(
        run, "no point of the study on this mesh and device shows it: " + reasons_of(left_out),
        "a point of this end, with a told error, without inverted tets, within the limits "
        "of Cs and accuracy_limit",
        remedy_for(points, doubt, accuracy_mm,
                   "run a study with such points, or set solver and substeps instead"));
  }
  const std::string without = left_out.empty() ? "" : "; not counted: " + reasons_of(left_out);
  throw refused(
      run, fmt::format("{:g} mm is not reached on this mesh{}", accuracy_mm, without),
      fmt::format("{:.3g} mm or more: {}", *nearest->total_mm + doubt, nearest->label),
      remedy_for(
          points, doubt, accuracy_mm,
          "ask for less, or run a study with more settings: no mesh of this one reaches it"));
}

// "2.48 [2.43 to 5.94] ms a frame", and what may be no dearer.
std::string price(const std::string& unit, const std::vector<Point>& all) {
  const double low = all.front().cost(0), median = all.front().cost(), high = all.front().cost(2);
  std::vector<std::string> alike;
  for (std::size_t i = 1; i < all.size(); ++i) {
    if (all[i].cost(0) <= high) alike.push_back(all[i].label);
  }
  return fmt::format("{:.3g} [{:.3g} to {:.3g}] {}{}{}", median, low, high, unit,
                     alike.empty() ? "" : ", not to be told apart from ", fmt::join(alike, " or "));
}

void take_setting(StageRun& run, const JsonValue& setting) {
  const auto& declared = simulate_stage().info.params;
  for (const auto& [name, value] : setting.members()) {
    const auto param = std::ranges::find(declared, name, &Param::name);
    if (param == declared.end() || name == "accuracy") continue;
    run.set_param(
        name, resolve_value(*param, value.raw(), run.input("study").string(), "setting." + name));
  }
}

}  // namespace

void take_accuracy(StageRun& run) {
  if (!run.has_param("accuracy")) return;
  if (!run.has_input("study")) {
    throw Error(ExitCode::usage, {.where = "command line",
                                  .field = "accuracy",
                                  .found = "given without a study",
                                  .allowed = "accuracy beside --in study=study.json",
                                  .remedy = "make one: viscera run configs/study.yaml"});
  }
  const JsonText study = read_json(run.input("study"));
  const JsonValue scene = scene_in(run, study.root());
  const Question question = question_of(run);
  const double doubt = doubt_of(run, scene), accuracy_mm = question.accuracy_mm;
  const auto all = reaching(run, points_of(scene, question), doubt, accuracy_mm);
  const Point& best = all.front();
  take_setting(run, best.json["setting"]);
  log::info("{:g} mm: {}, which the study shows to be {:.3g} mm off, sure to {:.3g} mm, for {}",
            accuracy_mm, best.label, *best.total_mm, doubt, price(scene["cost"].text(), all));
  run.metric("accuracy_setting", best.label);
  run.metric("accuracy_expected", *best.total_mm, "mm");
}

}  // namespace viscera
