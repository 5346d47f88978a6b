#include "stages/simulate/accuracy.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/error.hpp"
#include "pipeline/contract/input_digest.hpp"
#include "pipeline/contract/json_text.hpp"
#include "pipeline/contract/log.hpp"
#include "sim/solvers/make.hpp"

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

const Json& scene_in(const StageRun& run, const Json& study) {
  const std::string sha256 = input_digest(run.input("scene")).sha256;
  for (const auto& scene : study.at("study").at("scenes")) {
    if (scene.at("scene_sha256") == sha256 && scene.at("change") == run.params().at("change")) {
      return scene;
    }
  }
  throw refused(run, "the study does not hold this scene", "a study of the very scene and change",
                "run a study with it: add it to configs/study.yaml");
}

// How far off may be what stands for the body: by the reference of the next mesh, and by its own of
// coarser steps. Without either nobody knows.
double doubt_of(const Json& scene) {
  double doubt = 0.0;
  bool known = false;
  const auto add = [&](const Json& agreement) {
    if (agreement.is_number()) doubt += agreement.get<double>(), known = true;
  };
  add(scene.at("body").at("agreement_mm"));
  for (const auto& mesh : scene.at("meshes")) {
    if (mesh.at("discretisation_mm").is_null()) add(mesh.at("agreement_mm"));
  }
  return known ? doubt : std::numeric_limits<double>::infinity();
}

// Whether a point was timed on a device that this run may use.
bool is_at_hand(const StageRun& run, const Json& point) {
  const std::string wanted = run.param<std::string>("device");
  const std::string device = point.at("setting").value("device", "cpu");
  if (wanted != "auto") return device == wanted;
  return device == "cpu" || sim::find_cuda_device().name;
}

// How near PBD happens to come with one stiffness and substep says nothing of its error with
// others.
bool has_compliance(const Json& point) {
  return point.at("setting").value("solver", "xpbd") != "pbd";
}

// What to do where no point on this mesh gets there.
std::string remedy_for(const Json& scene, double accuracy_mm) {
  for (const auto& point : scene.at("points")) {
    if (point.at("failed") != "" || !point.at("total_mm").is_number()) continue;
    if (!has_compliance(point)) continue;
    if (point["total_mm"].get<double>() + doubt_of(scene) > accuracy_mm) continue;
    return fmt::format("take the study's mesh of {} tets, on which {} reaches it",
                       point.at("tets").get<int>(), point.at("label").get<std::string>());
  }
  return "ask for less: no mesh of the study reaches it";
}

// Lower quartile (0), median or upper quartile (2) of a point's times.
double cost(const Json& point, int quartile = 1) {
  return point.at("ms").at(quartile).get<double>();
}

// What reaches it on this mesh and device, the cheapest first; refused if there is nothing.
std::vector<const Json*> reaching(const StageRun& run, const Json& scene, double accuracy_mm) {
  const std::string mesh = input_digest(run.input("mesh")).sha256;
  const double doubt = doubt_of(scene);
  std::vector<const Json*> all;
  const Json* nearest = nullptr;
  const auto error = [](const Json& point) { return point.at("total_mm").get<double>(); };
  for (const auto& point : scene.at("points")) {
    const bool counts = has_compliance(point) && point.at("mesh_sha256") == mesh &&
                        point.at("failed") == "" && point.at("total_mm").is_number() &&
                        is_at_hand(run, point);
    if (!counts) continue;
    if (!nearest || error(point) < error(*nearest)) nearest = &point;
    if (error(point) + doubt <= accuracy_mm) all.push_back(&point);
  }
  std::ranges::stable_sort(all, {}, [](const Json* point) { return cost(*point); });
  if (!all.empty()) return all;
  if (!nearest) {
    throw refused(run, "the study has no point on this mesh and device",
                  "a mesh and a device that the study has used", "run the study with them");
  }
  throw refused(run, fmt::format("{:g} mm is not reached on this mesh", accuracy_mm),
                fmt::format("{:.3g} mm or more: {}", error(*nearest) + doubt,
                            nearest->at("label").get<std::string>()),
                remedy_for(scene, accuracy_mm));
}

// "2.48 [2.43 to 5.94] ms a frame", and what may be no dearer.
std::string price(const Json& scene, const std::vector<const Json*>& all) {
  const Json& best = *all.front();
  std::vector<std::string> alike;
  for (const Json* other : all) {
    if (other == &best || cost(*other, 0) > cost(best, 2)) continue;
    alike.push_back(other->at("label").get<std::string>());
  }
  return fmt::format("{:.3g} [{:.3g} to {:.3g}] {}{}{}", cost(best), cost(best, 0), cost(best, 2),
                     scene.at("cost").get<std::string>(),
                     alike.empty() ? "" : ", not to be told apart from ", fmt::join(alike, " or "));
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
  const Json study = parse_json(read_file(run.input("study")));
  try {
    const Json& scene = scene_in(run, study);
    const auto all = reaching(run, scene, run.param<double>("accuracy"));
    const Json& point = *all.front();
    for (const auto& [name, value] : point.at("setting").items()) {
      if (name != "accuracy" && run.params().contains(name)) run.set_param(name, value);
    }
    log::info("{:g} mm: {}, which the study shows to be {:.3g} mm off, sure to {:.3g} mm, for {}",
              run.param<double>("accuracy"), point.at("label").get<std::string>(),
              point.at("total_mm").get<double>(), doubt_of(scene), price(scene, all));
    run.metric("accuracy_setting", point.at("label"));
    run.metric("accuracy_expected", point.at("total_mm"), "mm");
  } catch (const Json::exception& e) {
    throw Error(ExitCode::bad_input, {.where = run.input("study").string(),
                                      .found = e.what(),
                                      .allowed = "study.json of viscera-compare",
                                      .remedy = "run the study again"});
  }
}

}  // namespace viscera
