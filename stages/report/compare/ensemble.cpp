#include "stages/report/compare/ensemble.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "pipeline/base/error.hpp"

namespace viscera {
namespace {

using Point = std::array<double, 3>;

RunList counted(const RunList& runs, Json& left_out) {
  RunList kept;
  for (const auto* run : runs) {
    if (run->diverged() || run->trajectory->times_s().empty()) {
      left_out.push_back(run->name);
    } else if (!kept.empty() && run->input("mesh") != kept.front()->input("mesh")) {
      throw Error(ExitCode::bad_config, {.where = "compare",
                                         .field = "ensemble",
                                         .found = "run '" + run->name + "' has another mesh",
                                         .allowed = "runs of one mesh"});
    } else {
      kept.push_back(run);
    }
  }
  if (kept.size() >= 2) return kept;
  throw Error(ExitCode::bad_config, {.where = "compare",
                                     .field = "ensemble",
                                     .found = "less than two runs that did not diverge",
                                     .allowed = "two or more"});
}

// Runs whose end a gate objects to, and those that others were at rest for: their shapes are in the
// means, and may say more of a run that was too short than of its materials.
Json failed(const RunList& runs) {
  Json names = Json::array();
  for (const auto* run : runs) {
    const auto fails = [](const Json& gate) { return !gate["passed"].get<bool>(); };
    if (std::ranges::any_of(run->manifest["gates"], fails)) names.push_back(run->name);
  }
  return names;
}

Json still_moving(const RunList& runs) {
  Json names = Json::array();
  for (const auto* run : runs) {
    if (!run->metric("rest_time")) names.push_back(run->name);
  }
  return names.size() < runs.size() ? names : Json::array();
}

// Centre of the volume of each label's tets.
std::map<int, Point> centres(const TetMesh& mesh, const std::vector<float>& xyz) {
  std::map<int, Point> sums;
  std::map<int, double> volumes;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    Point p[4];
    for (int c = 0; c < 4; ++c) {
      for (int k = 0; k < 3; ++k) p[c][k] = xyz[3 * mesh.tets[t][c] + k];
    }
    const auto edge = [&](int c, int k) { return p[c][k] - p[0][k]; };
    const double volume = (edge(1, 0) * (edge(2, 1) * edge(3, 2) - edge(2, 2) * edge(3, 1)) +
                           edge(1, 1) * (edge(2, 2) * edge(3, 0) - edge(2, 0) * edge(3, 2)) +
                           edge(1, 2) * (edge(2, 0) * edge(3, 1) - edge(2, 1) * edge(3, 0))) /
                          6.0;
    const int label = mesh.labels[t];
    volumes[label] += volume;
    for (int k = 0; k < 3; ++k) {
      sums[label][k] += volume * 0.25 * (p[0][k] + p[1][k] + p[2][k] + p[3][k]);
    }
  }
  for (auto& [label, sum] : sums) {
    for (double& x : sum) x /= volumes[label];
  }
  return sums;
}

double apart(const Point& a, const Point& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

Json label_json(const std::string& name, const Point& rest, const std::vector<Point>& ends) {
  const auto n = static_cast<double>(ends.size());
  Point mean{}, spread{};
  std::vector<double> moved, off;
  for (const Point& end : ends) {
    for (int k = 0; k < 3; ++k) mean[k] += end[k] / n;
    moved.push_back(apart(end, rest));
  }
  for (const Point& end : ends) {
    for (int k = 0; k < 3; ++k) spread[k] += (end[k] - mean[k]) * (end[k] - mean[k]) / n;
    off.push_back(apart(end, mean));
  }
  for (double& s : spread) s = std::sqrt(s);
  std::ranges::sort(off);
  const auto holding = static_cast<std::size_t>(std::ceil(0.95 * n)) - 1;
  double average = 0.0;
  for (const double m : moved) average += m / n;
  return {{"name", name},
          {"moved_mm",
           {{"mean", average},
            {"least", *std::ranges::min_element(moved)},
            {"most", *std::ranges::max_element(moved)}}},
          {"centre_mm", mean},
          {"spread_mm", spread},
          {"radius_mm", off[holding]}};
}

// Viridis, coarsely.
Colour bright(double t) {
  constexpr Colour stops[] = {{0.27, 0.00, 0.33},
                              {0.23, 0.32, 0.55},
                              {0.13, 0.57, 0.55},
                              {0.37, 0.79, 0.38},
                              {0.99, 0.91, 0.14}};
  const double x = 4.0 * std::clamp(t, 0.0, 1.0);
  const int i = std::min(3, static_cast<int>(x));
  Colour colour;
  for (int k = 0; k < 3; ++k) colour[k] = stops[i][k] + (x - i) * (stops[i + 1][k] - stops[i][k]);
  return colour;
}

}  // namespace

Ensemble ensemble_of(const RunList& runs) {
  Json left_out = Json::array();
  const RunList kept = counted(runs, left_out);
  const TetMesh& mesh = kept.front()->trajectory->mesh();
  const auto n = static_cast<double>(kept.size());
  std::vector<double> sum(3 * mesh.points.size()), squares(sum.size());
  std::map<int, std::vector<Point>> ends;
  std::vector<float> rest;
  for (const auto& p : mesh.points) {
    for (const double x : p) rest.push_back(static_cast<float>(x));
  }
  for (const auto* run : kept) {
    const auto xyz = run->trajectory->positions_mm(run->trajectory->times_s().size() - 1);
    for (std::size_t i = 0; i < xyz.size(); ++i) {
      const double u = xyz[i] - rest[i];  // squares of displacements, so that nothing cancels
      sum[i] += u / n, squares[i] += u * u / n;
    }
    for (const auto& [label, centre] : centres(mesh, xyz)) ends[label].push_back(centre);
  }
  Ensemble ensemble;
  for (std::size_t i = 0; i < sum.size(); ++i) {
    ensemble.mean_xyz.push_back(static_cast<float>(rest[i] + sum[i]));
  }
  double largest = 0.0;
  for (std::size_t p = 0; p < mesh.points.size(); ++p) {
    double variance = 0.0;
    for (std::size_t i = 3 * p; i < 3 * p + 3; ++i) {
      variance += std::max(0.0, squares[i] - sum[i] * sum[i]);
    }
    ensemble.spread_mm.push_back(std::sqrt(variance));
    largest = std::max(largest, ensemble.spread_mm.back());
  }
  const auto before = centres(mesh, rest);
  Json labels = Json::array();
  for (const auto& [label, points] : ends) {
    const auto name = mesh.label_names.find(label);
    labels.push_back(
        label_json(name == mesh.label_names.end() ? std::to_string(label) : name->second,
                   before.at(label), points));
  }
  ensemble.json = {{"runs", kept.size()},          {"left_out", left_out},
                   {"failed_gates", failed(kept)}, {"not_at_rest", still_moving(kept)},
                   {"largest_spread_mm", largest}, {"labels", labels}};
  return ensemble;
}

Figure ensemble_figure(const ComparedRun& run, const Ensemble& ensemble) {
  const double largest = std::max(1e-9, ensemble.json["largest_spread_mm"].get<double>());
  std::vector<Colour> colours;
  for (const double spread : ensemble.spread_mm) colours.push_back(bright(spread / largest));
  Figure figure = shape_figure(run, ensemble.mean_xyz, colours);
  figure.caption = {{"largest_spread_mm", largest}, {"runs", ensemble.json["runs"]}};
  return figure;
}

}  // namespace viscera
