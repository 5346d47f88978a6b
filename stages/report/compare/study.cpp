#include "stages/report/compare/study.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "pipeline/contract/json_value.hpp"
#include "stages/report/compare/distance.hpp"
#include "stages/report/compare/sentences.hpp"
#include "stages/report/compare/setting.hpp"

namespace viscera {
namespace {

using Runs = std::vector<const ComparedRun*>;

// What a scene's file and changes make one problem; settings and meshes are ways to solve it.
std::string problem_of(const ComparedRun& run) {
  return run.input("scene") + run.param("change");
}

Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

// What stores or brings in energy that metrics.csv does not hold.
bool has_other_energy(const ComparedRun& run) {
  for (const auto& metric : run.manifest["metrics"]) {
    if (metric["name"] != "effects_on") continue;
    const JsonValue effects(metric["value"], "manifest.json of " + run.name, "effects_on");
    return std::ranges::any_of(effects.texts(), [](const std::string& effect) {
      return std::ranges::count(std::array{"spring", "prony", "pressure", "load", "prescribed"},
                                effect) > 0;
    });
  }
  return false;
}

// The largest rise of the total energy above what it was before, over the largest elastic energy;
// not a number where energies are missing.
double energy_rise(const ComparedRun& run) {
  if (has_other_energy(run)) return NAN;
  double least = std::numeric_limits<double>::infinity(), rise = 0.0, elastic = 0.0;
  const Json &total = run.series["total_J"], &parts = run.series["elastic_J"];
  for (std::size_t f = 0; f < total.size(); ++f) {
    if (!total[f].is_number() || !parts[f].is_number()) continue;
    least = std::min(least, total[f].get<double>());
    rise = std::max(rise, total[f].get<double>() - least);
    elastic = std::max(elastic, parts[f].get<double>());
  }
  return elastic > 0.0 ? rise / elastic : 0.0;
}

// Of the body rather than of its mesh: what linear tets err by is not in it.
bool is_quadratic(const ComparedRun& run) {
  return run.param("solver") == "fem" && run.param("fem_order") == "2";
}

double volume_off(const ComparedRun& run) {
  double most = 0.0;
  for (const auto& ratio : run.series["volume_ratio"]) {
    if (ratio.is_number()) most = std::max(most, std::abs(ratio.get<double>() - 1.0));
  }
  return most;
}

// Lower quartile, median and upper quartile of equal runs; the quartiles rounded outwards. A single
// run is as uncertain as its frames.
Json times_of(const Runs& equal, const char* metric, double factor) {
  const auto share = [run = equal.front()](const char* quartile) {
    return run->metric(quartile).value_or(NAN) / run->metric("frame_ms_median").value_or(NAN);
  };
  if (equal.size() == 1) {
    const double ms = factor * equal.front()->metric(metric).value_or(NAN);
    const double low = share("frame_ms_q1"), high = share("frame_ms_q3");
    return {std::isfinite(low) ? ms * low : ms, ms, std::isfinite(high) ? ms * high : ms};
  }
  std::vector<double> ms;
  for (const auto* run : equal) ms.push_back(factor * run->metric(metric).value_or(NAN));
  std::ranges::sort(ms);
  const auto quarter = (ms.size() - 1) / 4;
  return {ms[quarter], ms[ms.size() / 2], ms[ms.size() - 1 - quarter]};
}

class SceneStudy {
 public:
  SceneStudy(const Runs& runs, const StudyOptions& options, DistanceBetween& distance)
      : distance_(distance) {
    for (const auto* run : runs) {
      const bool is_reference =
          std::ranges::any_of(options.references, [&](const Json& r) { return matches(*run, r); });
      auto& list = is_reference ? (is_quadratic(*run) ? bodies_ : references_)[run->input("mesh")]
                                : points_[run->input("mesh") + setting_of(*run).dump()];
      // What does not differ between rounds is one run, however many cases name it; of references
      // one a setting will do.
      const bool known = std::ranges::any_of(list, [&](const ComparedRun* other) {
        return setting_of(*other) == setting_of(*run) &&
               (is_reference || other->param("repeat") == run->param("repeat"));
      });
      if (!known) list.push_back(run);
      if (!is_reference && !known && list.size() == 1) order_.push_back(&list);
    }
  }

  bool has_references() const { return !references_.empty() || !bodies_.empty(); }

  Json made() {
    find_finest();
    Json json{{"name", finest_->input_name("scene")},
              {"scene_sha256", finest_->input("scene")},
              {"change", finest_->manifest["params"]["change"]},
              {"span", span_ == Span::end ? "end" : "history"},
              {"cost", span_ == Span::end ? "ms until it rests" : "ms a frame"},
              {"size_mm", number(size_mm_)},
              {"body", body()},
              {"meshes", meshes()},
              {"points", Json::array()}};
    for (const auto* equal : order_) json["points"].push_back(point(*equal));
    mark_front(json["points"]);
    return json;
  }

 private:
  void find_finest() {
    Runs all;
    for (const auto& [mesh, runs] : bodies_.empty() ? references_ : bodies_) {
      all.push_back(runs.back());
    }
    std::ranges::sort(all, {}, [](const ComparedRun* run) { return run->tets(); });
    finest_ = all.back();
    if (all.size() > 1) next_ = all[all.size() - 2];
    span_ = finest_->param("fem_time") == "quasi_static" && finest_->param("solver") == "fem"
                ? Span::end
                : Span::history;
    size_mm_ = largest_displacement(*finest_->trajectory);
  }

  Json body() {
    body_agreement_ = next_ ? apart(*next_, *finest_) : NAN;
    return {{"reference", label_of(*finest_)},
            {"tets", finest_->tets()},
            {"check", next_ ? Json(label_of(*next_)) : Json(nullptr)},
            {"check_tets", next_ ? Json(next_->tets()) : Json(nullptr)},
            {"agreement_mm", number(body_agreement_)}};
  }

  double apart(const ComparedRun& a, const ComparedRun& b) {
    return distance_(*a.trajectory, *b.trajectory, span_).largest;
  }

  Json meshes() {
    Json list = Json::array();
    for (const auto& [mesh, runs] : references_) {
      const ComparedRun& last = *runs.back();
      const bool checked = runs.size() > 1;
      const double agreement = checked ? apart(*runs[runs.size() - 2], last) : NAN;
      agreement_[mesh] = agreement;
      list.push_back({{"sha256", mesh},
                      {"tets", last.tets()},
                      {"reference", label_of(last)},
                      {"check", checked ? Json(label_of(*runs[runs.size() - 2])) : Json(nullptr)},
                      {"agreement_mm", number(agreement)},
                      {"discretisation_mm",
                       &last == finest_ ? Json(nullptr) : number(apart(last, *finest_))}});
    }
    std::sort(list.begin(), list.end(), [](const Json& a, const Json& b) {
      return a["tets"].get<int>() < b["tets"].get<int>();
    });
    return list;
  }

  Json point(const Runs& equal) {
    const ComparedRun& run = *equal.front();
    const std::string mesh = run.input("mesh");
    const bool end = span_ == Span::end;
    Json json{{"setting", setting_of(run)},
              {"label", label_of(run)},
              {"solver", run.param("solver")},
              {"method", method_of(run)},
              {"run", run.name},
              {"mesh_sha256", mesh},
              {"tets", run.tets()},
              {"ms", times_of(equal, end ? "steps_wall" : "frame_ms_median", end ? 1e3 : 1.0)},
              {"p99_ms", number(run.metric("frame_ms_p99").value_or(NAN))},
              {"repeats", equal.size()},
              {"cs", number(run.metric("stability_Cs_max").value_or(NAN))},
              {"energy_rise", number(energy_rise(run))},
              {"volume_off", number(volume_off(run))},
              {"inverted", run.metric("inverted_max").value_or(0.0)}};
    const Distance total = distance_(*run.trajectory, *finest_->trajectory, span_);
    const auto same = references_.find(mesh);
    Distance solver{NAN, NAN, NAN};
    if (same != references_.end()) {
      solver = distance_(*run.trajectory, *same->second.back()->trajectory, span_);
    }
    json["solver_mm"] = number(solver.largest);
    json["solver_rms_mm"] = number(solver.rms);
    json["total_mm"] = number(total.largest);
    json["end_mm"] = number(solver.end);
    json["failed"] = why_failed(equal, total.largest);
    const double doubt = same != references_.end() ? agreement_[mesh] : NAN;
    json["doubtful"] = !(solver.largest > 10.0 * doubt);
    json["total_doubtful"] = !(total.largest > 10.0 * body_agreement_);
    json["front"] = false;
    return json;
  }

  std::string why_failed(const Runs& equal, double total_mm) const {
    const ComparedRun& run = *equal.front();
    if (run.diverged()) return "diverged";
    if (!std::isfinite(total_mm)) return "did not reach the end";
    if (span_ == Span::end && !run.metric("rest_time")) return "not at rest in time";
    if (total_mm > size_mm_) return "farther off than the body moves";
    for (const auto* other : equal) {
      if (other->manifest["outputs"][0]["sha256"] != run.manifest["outputs"][0]["sha256"]) {
        return "equal runs differ";
      }
    }
    return "";
  }

  static void mark_front(Json& points) {
    const auto cost = [](const Json& p) { return p["ms"][1].get<double>(); };
    const auto error = [](const Json& p) { return p["total_mm"].get<double>(); };
    const auto counts = [](const Json& p) { return p["failed"] == ""; };
    for (auto& p : points) {
      p["front"] = counts(p) && std::ranges::none_of(points, [&](const Json& other) {
                     return counts(other) && cost(other) <= cost(p) && error(other) <= error(p) &&
                            (cost(other) < cost(p) || error(other) < error(p));
                   });
    }
  }

  DistanceBetween& distance_;
  std::map<std::string, Runs> references_;  // by mesh, of linear tets
  std::map<std::string, Runs> bodies_;      // by mesh, of quadratic ones
  std::map<std::string, Runs> points_;      // by mesh and setting
  std::vector<const Runs*> order_;
  std::map<std::string, double> agreement_;
  const ComparedRun *finest_ = nullptr, *next_ = nullptr;
  double body_agreement_ = 0.0;  // mm
  Span span_ = Span::history;
  double size_mm_ = 0.0;
};

// A run of the scene as it is beside one with a change, on the same mesh in the same way.
Json effects_of(const std::map<std::string, Runs>& problems, DistanceBetween& distance) {
  Json list = Json::array();
  for (const auto& [key, changed] : problems) {
    const Json& change = changed.front()->manifest["params"]["change"];
    const auto plain = problems.find(changed.front()->input("scene") + "{}");
    if (change.empty() || plain == problems.end()) continue;
    const auto group = [](const Runs& runs, const ComparedRun& like) {
      Runs equal;
      for (const auto* run : runs) {
        if (run->input("mesh") == like.input("mesh") && setting_of(*run) == setting_of(like)) {
          equal.push_back(run);
        }
      }
      return equal;
    };
    const Runs with = group(changed, *changed.front()),
               without = group(plain->second, *changed.front());
    if (without.empty()) continue;
    const Json ms = times_of(with, "frame_ms_median", 1.0);
    const Json ms_without = times_of(without, "frame_ms_median", 1.0);
    const Distance apart =
        distance(*with.front()->trajectory, *without.front()->trajectory, Span::history);
    list.push_back({{"scene", without.front()->input_name("scene")},
                    {"label", label_of(*with.front())},
                    {"tets", with.front()->tets()},
                    {"change", change},
                    {"ms", ms},
                    {"ms_without", ms_without},
                    {"told_apart", ms[0] > ms_without[2] || ms[2] < ms_without[0]},
                    {"mm", number(apart.largest)},
                    {"failed", with.front()->diverged() ? "diverged" : ""}});
  }
  return list;
}

}  // namespace

Json study_of(const std::vector<ComparedRun>& runs, const StudyOptions& options) {
  std::map<std::string, Runs> problems;
  std::vector<std::string> order;
  for (const auto& run : runs) {
    auto& list = problems[problem_of(run)];
    if (list.empty()) order.push_back(problem_of(run));
    list.push_back(&run);
  }
  DistanceBetween distance;
  Json study{{"wanted_mm", options.wanted_mm}, {"scenes", Json::array()}};
  for (const auto& problem : order) {
    SceneStudy scene(problems[problem], options, distance);
    if (!scene.has_references()) continue;
    Json json = scene.made();
    json["sentences"] = sentences_of(json, options.wanted_mm);
    study["scenes"].push_back(std::move(json));
  }
  study["effects"] = effects_of(problems, distance);
  return study;
}

}  // namespace viscera
