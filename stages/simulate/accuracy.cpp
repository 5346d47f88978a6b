#include "stages/simulate/accuracy.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <vector>

#include "pipeline/contract/error.hpp"
#include "pipeline/contract/input_digest.hpp"
#include "pipeline/contract/json_value.hpp"
#include "pipeline/contract/log.hpp"
#include "sim/solvers/make.hpp"
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

JsonValue scene_in(const StageRun& run, const JsonValue& study) {
  const std::string sha256 = input_digest(run.input("scene")).sha256;
  for (const auto& scene : study["study"]["scenes"].items()) {
    const bool same_change = scene["change"].raw() == run.params().at("change");
    if (scene["scene_sha256"].text() == sha256 && same_change) return scene;
  }
  throw refused(run, "the study does not hold this scene", "a study of the very scene and change",
                "run a study with it: add it to configs/study.yaml");
}

// How far off may be what stands for the body: by the reference of the next mesh, and by its own of
// coarser steps. Without either nobody knows.
double doubt_of(const JsonValue& scene) {
  double doubt = 0.0;
  bool known = false;
  const auto add = [&](const JsonValue& of) {
    const auto agreement = of.find("agreement_mm");
    if (agreement) doubt += agreement->number(), known = true;
  };
  add(scene["body"]);
  for (const auto& mesh : scene["meshes"].items()) {
    if (!mesh.find("discretisation_mm")) add(mesh);
  }
  return known ? doubt : std::numeric_limits<double>::infinity();
}

// One way to solve the scene.
struct Point {
  JsonValue json;
  std::string label, failed, mesh_sha256, device, solver;
  std::optional<double> total_mm;

  // How near PBD happens to come with one stiffness and substep says nothing of its error with
  // others.
  bool counts() const { return failed.empty() && total_mm && solver != "pbd"; }
  // Lower quartile (0), median or upper quartile (2) of its times.
  double cost(std::size_t quartile = 1) const { return json["ms"][quartile].number(); }
};

std::string text_or(const JsonValue& json, const char* member, const char* otherwise) {
  const auto found = json.find(member);
  return found ? found->text() : otherwise;
}

Point point_from(const JsonValue& json) {
  Point point{.json = json,
              .label = json["label"].text(),
              .failed = json["failed"].text(),
              .mesh_sha256 = json["mesh_sha256"].text(),
              .device = text_or(json["setting"], "device", "cpu"),
              .solver = text_or(json["setting"], "solver", "xpbd")};
  if (const auto total = json.find("total_mm")) point.total_mm = total->number();
  return point;
}

std::vector<Point> points_of(const JsonValue& scene) {
  std::vector<Point> points;
  for (const auto& point : scene["points"].items()) points.push_back(point_from(point));
  return points;
}

// Whether a point was timed on a device that this run may use.
bool is_at_hand(const StageRun& run, const Point& point) {
  const std::string wanted = run.param<std::string>("device");
  if (wanted != "auto") return point.device == wanted;
  return point.device == "cpu" || sim::find_cuda_device().name;
}

// What to do where no point on this mesh gets there.
std::string remedy_for(const std::vector<Point>& points, double doubt, double accuracy_mm) {
  for (const auto& point : points) {
    if (!point.counts() || *point.total_mm + doubt > accuracy_mm) continue;
    return fmt::format("take the study's mesh of {} tets, on which {} reaches it",
                       point.json["tets"].whole<int>(), point.label);
  }
  return "ask for less: no mesh of the study reaches it";
}

// What reaches it on this mesh and device, the cheapest first; refused if there is nothing.
std::vector<Point> reaching(const StageRun& run, const std::vector<Point>& points, double doubt,
                            double accuracy_mm) {
  const std::string mesh = input_digest(run.input("mesh")).sha256;
  std::vector<Point> all;
  const Point* nearest = nullptr;
  for (const auto& point : points) {
    if (!point.counts() || point.mesh_sha256 != mesh || !is_at_hand(run, point)) continue;
    if (!nearest || *point.total_mm < *nearest->total_mm) nearest = &point;
    if (*point.total_mm + doubt <= accuracy_mm) all.push_back(point);
  }
  std::ranges::stable_sort(all, {}, [](const Point& point) { return point.cost(); });
  if (!all.empty()) return all;
  if (!nearest) {
    throw refused(run, "the study has no point on this mesh and device",
                  "a mesh and a device that the study has used", "run the study with them");
  }
  throw refused(run, fmt::format("{:g} mm is not reached on this mesh", accuracy_mm),
                fmt::format("{:.3g} mm or more: {}", *nearest->total_mm + doubt, nearest->label),
                remedy_for(points, doubt, accuracy_mm));
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
  const double doubt = doubt_of(scene), accuracy_mm = run.param<double>("accuracy");
  const auto all = reaching(run, points_of(scene), doubt, accuracy_mm);
  const Point& best = all.front();
  take_setting(run, best.json["setting"]);
  log::info("{:g} mm: {}, which the study shows to be {:.3g} mm off, sure to {:.3g} mm, for {}",
            accuracy_mm, best.label, *best.total_mm, doubt, price(scene["cost"].text(), all));
  run.metric("accuracy_setting", best.label);
  run.metric("accuracy_expected", *best.total_mm, "mm");
}

}  // namespace viscera
