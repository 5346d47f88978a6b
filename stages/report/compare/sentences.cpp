#include "stages/report/compare/sentences.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <map>
#include <set>

namespace viscera {
namespace {

// An error of the points, and the member that says whether it is too small to be told.
struct Measure {
  const char *error, *doubtful;
};
constexpr Measure solver_alone = {"solver_mm", "doubtful"}, total = {"total_mm", "total_doubtful"},
                  centroid = {"centroid_mm", "centroid_doubtful"};

// What has this error at most, without having failed; of the doubtful, or of the others.
std::vector<const Json*> reaching(const Json& points, const Measure& measure, double wanted,
                                  const std::string& mesh, bool doubtful = false) {
  std::vector<const Json*> all;
  for (const auto& p : points) {
    const Json& error = p[measure.error];
    if (p["failed"] != "" || !error.is_number() || error.get<double>() > wanted) continue;
    if (p[measure.doubtful] != doubtful) continue;
    if (mesh.empty() || p["mesh_sha256"] == mesh) all.push_back(&p);
  }
  std::ranges::sort(all, {}, [](const Json* p) { return (*p)["ms"][1].get<double>(); });
  return all;
}

std::string number(double ms) {
  return ms < 100.0 ? fmt::format("{:.3g}", ms) : fmt::format("{:.0f}", ms);
}

// The median, and the interval by which it is told from others: "2.5 [2.4 to 5.9] ms".
std::string ms(const Json& point) {
  const std::string lo = number(point["ms"][0]), median = number(point["ms"][1]),
                    hi = number(point["ms"][2]);
  if (lo == hi) return median + " ms";
  return fmt::format("{} [{} to {}] ms", median, lo, hi);
}

// What a point is called where all are on one mesh, and where they are not.
std::string name_of(const Json& point, const std::string& mesh) {
  const std::string label = point["label"];
  return mesh.empty() ? fmt::format("{}, {} tets", label, point["tets"].get<int>()) : label;
}

// What follows "1 mm costs": `all` reach it, `untold` may.
std::string price(const Json& scene, const std::vector<const Json*>& all,
                  const std::vector<const Json*>& untold, const std::string& mesh) {
  const Json& best = *all.front();
  std::vector<std::string> alike, dearer, without, open;
  std::set<std::string> told = {best["method"]};
  for (const Json* other : all) {
    const std::string method = (*other)["method"];
    if (!told.insert(method).second) continue;
    if ((*other)["ms"][0].get<double>() > best["ms"][2].get<double>()) {
      dearer.push_back(fmt::format(", {} needs {}", method, ms(*other)));
    } else {
      alike.push_back(fmt::format("{} ({})", name_of(*other, mesh), ms(*other)));
    }
  }
  for (const Json* p : untold) {
    const std::string method = (*p)["method"];
    if (told.insert(method).second) open.push_back(method);
  }
  for (const auto& p : scene["points"]) {
    const std::string method = p["method"];
    const bool here = mesh.empty() || p["mesh_sha256"] == mesh;
    if (here && told.insert(method).second) without.push_back(method);
  }
  std::string text = fmt::format("{} ({})", ms(best), name_of(best, mesh));
  if (!alike.empty()) {
    text += fmt::format(", not to be told apart from {}", fmt::join(alike, " or "));
  }
  text += fmt::format("{}", fmt::join(dearer, ""));
  if (!open.empty()) text += fmt::format(", of {} it is not told", fmt::join(open, " and "));
  if (!without.empty())
    text += fmt::format(", no run of {} gets there", fmt::join(without, " or "));
  return text;
}

// Where the goals end: what comes nearest. A goal that only doubtful errors reach is not told.
std::string not_reached(const Json& scene, const Measure& measure, double wanted,
                        const std::string& mesh) {
  const Json& points = scene["points"];
  const bool may_be = !reaching(points, measure, wanted, mesh, true).empty();
  std::string text = fmt::format("{:g} mm is not {}", wanted, may_be ? "told" : "reached");
  if (may_be) text += " (errors that small are below ten times what the reference is sure to)";
  const auto all = reaching(points, measure, std::numeric_limits<double>::infinity(), mesh);
  if (all.empty()) return text;
  const auto error_of = [&](const Json* p) { return (*p)[measure.error].get<double>(); };
  const Json& nearest = **std::ranges::min_element(all, {}, error_of);
  return text + fmt::format(": {:.2g} mm is the least{} ({}, {})", error_of(&nearest),
                            may_be ? " that is told" : "", ms(nearest), name_of(nearest, mesh));
}

std::string sentence(const Json& scene, const std::string& begin, const Measure& measure,
                     const std::vector<double>& wanted, const std::string& mesh) {
  std::vector<std::string> parts, goals;
  std::string same;
  const auto finish = [&] {
    if (goals.empty()) return;
    parts.push_back(fmt::format("{} mm {} {}", fmt::join(goals, ", "),
                                goals.size() > 1 ? "cost" : "costs", same));
    goals.clear();
  };
  for (const double w : wanted) {  // largest first
    const auto all = reaching(scene["points"], measure, w, mesh);
    if (all.empty()) {
      finish();
      parts.push_back(not_reached(scene, measure, w, mesh));
      break;
    }
    const std::string text =
        price(scene, all, reaching(scene["points"], measure, w, mesh, true), mesh);
    if (text != same) finish();
    same = text;
    goals.push_back(fmt::format("{:g}", w));
  }
  finish();
  return fmt::format("{}: {}.", begin, fmt::join(parts, "; "));
}

}  // namespace

Json sentences_of(const Json& scene, const std::vector<double>& wanted_mm) {
  std::map<std::string, int> settings;
  for (const auto& p : scene["points"]) ++settings[p["mesh_sha256"]];
  if (settings.empty()) return Json::array();
  const auto most = std::ranges::max_element(settings, {}, [](const auto& m) { return m.second; });
  int tets = 0;
  for (const auto& p : scene["points"]) {
    if (p["mesh_sha256"] == most->first) tets = p["tets"];
  }
  const std::string name = scene["name"], cost = scene["cost"];
  Json all = Json::array();
  all.push_back(
      sentence(scene, fmt::format("{}, solver alone on the mesh of {} tets, {}", name, tets, cost),
               solver_alone, wanted_mm, most->first));
  const Json& body = scene["body"];
  if (body.is_null()) {
    all.push_back(
        fmt::format("{}: solver error only, because {}. What the mesh adds to it is not known.",
                    name, scene["no_body"].get<std::string>()));
    return all;
  }
  all.push_back(
      sentence(scene,
               fmt::format("{}, mesh and solver together (the body is known to {:.2g} mm), {}",
                           name, body["agreement_mm"].get<double>(), cost),
               total, wanted_mm, ""));
  if (body["agreement_centroid_mm"].is_null()) return all;
  all.push_back(sentence(scene,
                         fmt::format("{}, the centroid of {} (known to {:.2g} mm), {}", name,
                                     scene["centroid"].get<std::string>(),
                                     body["agreement_centroid_mm"].get<double>(), cost),
                         centroid, wanted_mm, ""));
  return all;
}

}  // namespace viscera
