#include "stages/report/compare/study.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "pipeline/base/json_value.hpp"
#include "stages/report/compare/distance.hpp"
#include "stages/report/compare/sentences.hpp"
#include "stages/report/compare/setting.hpp"

namespace viscera {
namespace {

using Runs = std::vector<const ComparedRun*>;

// What a run changed of its scene's file.
Json change_of(const ComparedRun& run) {
  return run.manifest["params"].value("change", Json::object());
}

// What a scene's file, its changes, a start and a measured stiffness make one problem; settings and
// meshes are ways to solve it.
std::string problem_of(const ComparedRun& run, const Json& change) {
  return run.input("scene") + "|" + run.input("checkpoint") + "|" + run.input("stiffness") + "|" +
         change.dump();
}

std::string problem_of(const ComparedRun& run) {
  return problem_of(run, change_of(run));
}

Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json text(const std::string& value) {
  return value.empty() ? Json(nullptr) : Json(value);
}

// The time (s) that the run was to end at.
Json end_of(const ComparedRun& run) {
  const auto time = run.scene.find("time");
  return time == run.scene.end() ? Json(nullptr) : Json(number(time->value("end", NAN)));
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

// The digest of its trajectory.
Json motion_of(const ComparedRun& run) {
  return run.manifest["outputs"][0]["sha256"];
}

// Of the body rather than of its mesh: what other elements err by is not in it.
bool is_quadratic(const ComparedRun& run) {
  return element_of(run) == "quadratic";
}

// What a run solves: the mesh and its elements.
std::string equations_of(const ComparedRun& run) {
  return run.input("mesh") + "|" + element_of(run);
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
      : distance_(distance), centroid_(options.centroid) {
    for (const auto* run : runs) {
      const bool is_reference =
          std::ranges::any_of(options.references, [&](const Json& r) { return matches(*run, r); });
      auto& list =
          is_reference
              ? (is_quadratic(*run) ? quadratic_ : simple_)[equations_of(*run)]
              : points_[run->input("mesh") + setting_of(*run).dump() + end_of(*run).dump()];
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

  bool has_references() const { return !simple_.empty() || !quadratic_.empty(); }

  Json made() {
    find_finest();
    find_body();
    Json json{{"name", finest_->input_name("scene")},
              {"scene_sha256", finest_->input("scene")},
              {"checkpoint_sha256", text(finest_->input("checkpoint"))},
              {"stiffness_sha256", text(finest_->input("stiffness"))},
              {"change", change_of(*finest_)},
              {"span", span_ == Span::end ? "end" : "history"},
              {"cost", span_ == Span::end ? "ms until it rests" : "ms a frame"},
              {"size_mm", number(size_mm_)},
              {"body", body()},
              {"no_body", why_no_body_},
              {"centroid", centroid_},
              {"front_by", truth_ ? "total_mm" : "solver_mm"},
              {"meshes", meshes()},
              {"points", Json::array()}};
    for (const auto* equal : order_) json["points"].push_back(point(*equal));
    mark_front(json["points"], truth_ != nullptr);
    return json;
  }

 private:
  using ByEquations = std::map<std::string, Runs>;

  // The references of every mesh and element, those on the finest mesh last.
  static Runs by_tets(const ByEquations& references) {
    Runs all;
    for (const auto& [equations, runs] : references) all.push_back(runs.back());
    std::ranges::sort(all, {}, [](const ComparedRun* run) { return run->tets(); });
    return all;
  }

  void find_finest() {
    finest_ = by_tets(quadratic_.empty() ? simple_ : quadratic_).back();
    span_ = finest_->param("fem_time") == "quasi_static" && finest_->param("solver") == "fem"
                ? Span::end
                : Span::history;
    size_mm_ = largest_displacement(*finest_->trajectory);
  }

  // A truth, which no point can be its own judge by: see study.hpp.
  void find_body() {
    const Runs all = by_tets(quadratic_);
    const auto count = all.size();
    if (count < 2 || all[count - 2]->tets() >= all[count - 1]->tets()) {
      why_no_body_ = "no two meshes, one finer than the other, have references of quadratic tets";
      return;
    }
    const ComparedRun &truth = *all[count - 1], &check = *all[count - 2];
    double steps_mm = 0.0;
    if (span_ == Span::history) {
      steps_mm = std::min(steps_agreement_of(truth), steps_agreement_of(check));
      if (std::isinf(steps_mm)) {
        why_no_body_ = "no reference of quadratic tets with other time steps checks theirs";
        return;
      }
    }
    const Distance between = distance_(*check.trajectory, *truth.trajectory, span_);
    const double agreement_mm = between.largest + steps_mm;
    if (truth.diverged() || check.diverged() || !std::isfinite(agreement_mm)) {
      why_no_body_ = "the two finest references of quadratic tets do not both reach the end";
      return;
    }
    truth_ = &truth, check_ = &check;
    body_agreement_ = agreement_mm;
    centroid_agreement_ = between.centroid + steps_mm;
  }

  Json body() const {
    if (!truth_) return nullptr;
    return {
        {"reference", label_of(*truth_)},  {"tets", truth_->tets()},
        {"check", label_of(*check_)},      {"check_tets", check_->tets()},
        {"agreement_mm", body_agreement_}, {"agreement_centroid_mm", number(centroid_agreement_)}};
  }

  double apart(const ComparedRun& a, const ComparedRun& b) {
    return distance_(*a.trajectory, *b.trajectory, span_).largest;
  }

  // By how much the last two references of this run's mesh and element differ; infinite: there is
  // one.
  double agreement_of(const ByEquations& references, const ComparedRun& run) {
    const auto found = references.find(equations_of(run));
    if (found == references.end() || found->second.size() < 2) {
      return std::numeric_limits<double>::infinity();
    }
    const Runs& runs = found->second;
    const auto [known, is_new] = agreements_.emplace(runs.back(), 0.0);
    if (is_new) known->second = apart(*runs[runs.size() - 2], *runs.back());
    return known->second;
  }

  // By how much this reference of quadratic tets and one with other time steps differ; infinite:
  // there is none. One whose motion is the same bits took the same steps.
  double steps_agreement_of(const ComparedRun& reference) {
    double least = std::numeric_limits<double>::infinity();
    for (const auto* other : quadratic_[equations_of(reference)]) {
      const auto differs = [&](const char* step) {
        return setting_of(*other)[step] != setting_of(reference)[step];
      };
      if (!differs("substeps") && !differs("fem_time") && !differs("fem_step_error")) continue;
      if (motion_of(*other) == motion_of(reference)) continue;
      least = std::min(least, apart(*other, reference));
    }
    return least;
  }

  // Of a motion none where the reference was to end before the run: what comes after is not known.
  std::optional<Distance> error_of(const ComparedRun& run, const ComparedRun& reference) {
    const Json end = end_of(run), known = end_of(reference);
    const bool is_longer = end.is_number() && known.is_number() && end > known;
    if (span_ == Span::history && is_longer) return std::nullopt;
    return distance_(*run.trajectory, *reference.trajectory, span_);
  }

  // Of mesh and solver: against a truth on another, finer mesh only.
  std::optional<Distance> total_of(const ComparedRun& run) {
    if (!truth_ || run.tets() >= truth_->tets()) return std::nullopt;
    return error_of(run, *truth_);
  }

  Json meshes() {
    Json list = Json::array();
    for (const auto& [equations, runs] : simple_) {
      const ComparedRun& last = *runs.back();
      const auto discretisation = total_of(last);
      list.push_back(
          {{"sha256", last.input("mesh")},
           {"element", element_of(last)},
           {"tets", last.tets()},
           {"reference", label_of(last)},
           {"check", runs.size() > 1 ? Json(label_of(*runs[runs.size() - 2])) : Json(nullptr)},
           {"agreement_mm", number(agreement_of(simple_, last))},
           {"discretisation_mm", number(discretisation ? discretisation->largest : NAN)}});
    }
    std::sort(list.begin(), list.end(), [](const Json& a, const Json& b) {
      return std::pair(a["tets"].get<int>(), a["element"]) <
             std::pair(b["tets"].get<int>(), b["element"]);
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
              {"end_s", end_of(run)},
              {"tets", run.tets()},
              {"ms", times_of(equal, end ? "steps_wall" : "frame_ms_median", end ? 1e3 : 1.0)},
              {"p99_ms", number(run.metric("frame_ms_p99").value_or(NAN))},
              {"repeats", equal.size()},
              {"cs", number(run.metric("stability_Cs_max").value_or(NAN))},
              {"solver_error_bound", number(run.metric("solver_error_bound").value_or(NAN))},
              {"energy_rise", number(energy_rise(run))},
              {"volume_off", number(volume_off(run))},
              {"inverted", run.metric("inverted_max").value_or(0.0)}};
    // Against references of other elements the error would be the elements'.
    const ByEquations& references = is_quadratic(run) ? quadratic_ : simple_;
    const auto same = references.find(equations_of(run));
    std::optional<Distance> solver;
    if (same != references.end()) solver = error_of(run, *same->second.back());
    const auto total = total_of(run);
    const double solver_mm = solver ? solver->largest : NAN,
                 total_mm = total ? total->largest : NAN;
    json["solver_mm"] = number(solver_mm);
    json["solver_rms_mm"] = number(solver ? solver->rms : NAN);
    json["total_mm"] = number(total_mm);
    const double centroid_mm = total ? total->centroid : NAN;
    json["centroid_mm"] = number(centroid_mm);
    json["end_mm"] = number(solver ? solver->end : NAN);
    json["failed"] = why_failed(equal, solver_mm, total_mm);
    json["doubtful"] = !(solver_mm > 10.0 * agreement_of(references, run));
    json["total_doubtful"] = !(total_mm > 10.0 * body_agreement_);
    json["centroid_doubtful"] = !(centroid_mm > 10.0 * centroid_agreement_);
    json["front"] = false;
    return json;
  }

  // Errors that are not known (not a number) are no failure.
  std::string why_failed(const Runs& equal, double solver_mm, double total_mm) const {
    const ComparedRun& run = *equal.front();
    if (run.diverged()) return "diverged";
    const bool is_short = run.trajectory->times_s().size() < finest_->trajectory->times_s().size();
    const bool is_history = span_ == Span::history;
    if ((is_history && is_short) || std::isinf(solver_mm) || std::isinf(total_mm)) {
      return "did not reach the end";
    }
    if (span_ == Span::end && !run.metric("rest_time")) return "not at rest in time";
    if (solver_mm > size_mm_ || total_mm > size_mm_) return "farther off than the body moves";
    for (const auto* other : equal) {
      if (motion_of(*other) != motion_of(run)) return "equal runs differ";
    }
    return "";
  }

  // By the total where there is a truth, of all meshes. Else by the solver's error, of points of
  // one mesh: that of another mesh is another error. What is nearer to its reference than ten times
  // the reference's own agreement is not judged, and so on no front.
  static void mark_front(Json& points, bool has_truth) {
    const char* error = has_truth ? "total_mm" : "solver_mm";
    const char* doubtful = has_truth ? "total_doubtful" : "doubtful";
    const auto counts = [&](const Json& p) {
      return p["failed"] == "" && p[error].is_number() && p[doubtful] == false;
    };
    const auto is_better = [&](const Json& a, const Json& b) {
      const double ms = a["ms"][1], mm = a[error], other_ms = b["ms"][1], other_mm = b[error];
      return ms <= other_ms && mm <= other_mm && (ms < other_ms || mm < other_mm);
    };
    for (auto& p : points) {
      p["front"] = counts(p) && std::ranges::none_of(points, [&](const Json& other) {
                     const bool comparable = has_truth || other["mesh_sha256"] == p["mesh_sha256"];
                     return comparable && counts(other) && is_better(other, p);
                   });
    }
  }

  DistanceBetween& distance_;
  std::string centroid_;                // of this label; "": none
  ByEquations simple_, quadratic_;      // references by mesh and element; simple: of 4 nodes a tet
  std::map<std::string, Runs> points_;  // by mesh, setting and end
  std::vector<const Runs*> order_;
  std::map<const ComparedRun*, double> agreements_;  // of references with those before them, mm
  const ComparedRun* finest_ = nullptr;              // of the references
  const ComparedRun *truth_ = nullptr, *check_ = nullptr;  // of the body; null: there is none
  std::string why_no_body_;
  double body_agreement_ = 0.0, centroid_agreement_ = 0.0;  // mm
  Span span_ = Span::history;
  double size_mm_ = 0.0;
};

// A run of the scene as it is beside one with a change, on the same mesh in the same way.
Json effects_of(const std::map<std::string, Runs>& problems, DistanceBetween& distance) {
  Json list = Json::array();
  for (const auto& [key, changed] : problems) {
    const Json change = change_of(*changed.front());
    const auto plain = problems.find(problem_of(*changed.front(), Json::object()));
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
  DistanceBetween distance(options.centroid);
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
