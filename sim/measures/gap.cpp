#include "sim/measures/gap.hpp"

#include <algorithm>
#include <iterator>
#include <limits>
#include <set>

#include "sim/base/refusal.hpp"
#include "sim/base/triangle.hpp"
#include "sim/measures/overlap.hpp"

namespace viscera::sim {
namespace {

// function.template operator()<Effect>(params, name) for every obstacle.
template <class Function>
void for_each_obstacle(const Scene& scene, Function&& function) {
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (Effect::kind == EffectKind::contact) {
      const auto& all = std::get<i>(scene.effects);
      for (std::size_t k = 0; k < all.size(); ++k)
        function.template operator()<Effect>(all[k], name_of<Effect>(all, k));
    }
  });
}

BodyPart surface_of(const Model& model, int material) {
  BodyPart part;
  for (const TetFace& face : tet_faces(model)) {
    const bool here = model.material_of[face.tet] == material;
    const bool beyond = face.other >= 0 && model.material_of[face.other] == material;
    if (here != beyond) part.faces.push_back(face.vertices);
  }
  part.vertices = vertices_of(part.faces);
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    if (model.material_of[t] == material) part.tets.push_back(static_cast<int>(t));
  }
  return part;
}

// Of a part's vertices, the one nearest to the other's surface, if that is nearer than `gap` is.
void look_for_nearer(const BodyPart& part, const BodyPart& other,
                     const std::vector<Vec3<double>>& at, Gap& gap) {
  struct Ball {
    Vec3<double> centre;
    double radius;
  };
  const auto ball_around = [&at](const auto& vertices) {
    Ball ball{};
    for (const int v : vertices) ball.centre += at[v];
    ball.centre *= 1.0 / static_cast<double>(vertices.size());
    for (const int v : vertices) ball.radius = std::max(ball.radius, norm(at[v] - ball.centre));
    return ball;
  };
  const auto is_farther = [&](const Vec3<double>& p, const Ball& ball) {
    return norm(p - ball.centre) - ball.radius >= gap.distance;
  };
  const Ball whole = ball_around(other.vertices);
  std::vector<Ball> balls;
  for (const Triangle& face : other.faces) balls.push_back(ball_around(face));
  for (const int v : part.vertices) {
    if (is_farther(at[v], whole)) continue;
    for (std::size_t f = 0; f < balls.size(); ++f) {
      if (is_farther(at[v], balls[f])) continue;
      const auto& [a, b, c] = other.faces[f];
      const Vec3<double> point = nearest_on_triangle(at[v], at[a], at[b], at[c]);
      const double distance = norm(at[v] - point);
      if (distance >= gap.distance) continue;
      const auto& share = over_triangle(point, at[a], at[b], at[c]).b;
      gap = {distance, {{v, 1.0}, {a, -share[0]}, {b, -share[1]}, {c, -share[2]}}};
    }
  }
}

// Of a part's vertices that lie in the other, the one that is deepest, if it is deeper than `gap`.
void look_for_deeper(const Model& model, const BodyPart& part, const BodyPart& other,
                     const std::vector<Vec3<double>>& at, Gap& gap) {
  for (const auto& [vertex, tet] : vertices_in_tets(model, part.vertices, other.tets, at)) {
    Gap way{std::numeric_limits<double>::infinity(), {}};
    look_for_nearer({{vertex}}, other, at, way);
    if (-way.distance >= gap.distance) continue;
    gap = {-way.distance, way.nearest};
    for (auto& [v, weight] : gap.nearest) weight = -weight;
  }
}

}  // namespace

std::vector<std::string> obstacles_of(const Scene& scene) {
  std::vector<std::string> names;
  for_each_obstacle(
      scene, [&]<class Effect>(const auto&, const std::string& name) { names.push_back(name); });
  return names;
}

GapProbe gap_probe(const Model& model, const std::string& name, int material,
                   const std::string& obstacle) {
  std::set<int> vertices;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    if (model.material_of[t] == material)
      vertices.insert(model.tets[t].begin(), model.tets[t].end());
  }
  return {name, {{vertices.begin(), vertices.end()}}, obstacle, {}};
}

GapProbe gap_probe(const Model& model, const std::string& name, int material, int other) {
  GapProbe probe{name, surface_of(model, material), "", surface_of(model, other)};
  std::vector<int> shared;
  std::ranges::set_intersection(probe.part.vertices, probe.other.vertices,
                                std::back_inserter(shared));
  if (shared.empty()) return probe;
  throw Refusal(Refusal::Cause::scene, "probes." + name + ".between",
                "labels that touch at " + std::to_string(shared.size()) + " vertices",
                "labels with something between them, or an obstacle");
}

Gap gap_now(const Model& model, const Scene& scene, const GapProbe& probe,
            const std::vector<Vec3<double>>& u, double time) {
  Gap gap{std::numeric_limits<double>::infinity(), {}};
  if (probe.obstacle.empty()) {
    std::vector<Vec3<double>> at = model.rest;
    for (std::size_t i = 0; i < at.size(); ++i) at[i] += u[i];
    look_for_nearer(probe.part, probe.other, at, gap);
    look_for_nearer(probe.other, probe.part, at, gap);
    look_for_deeper(model, probe.part, probe.other, at, gap);
    look_for_deeper(model, probe.other, probe.part, at, gap);
    return gap;
  }
  for_each_obstacle(scene, [&]<class Effect>(const auto& params, const std::string& name) {
    if (name != probe.obstacle) return;
    const auto distance = Effect::distance_at(model, params, time);
    for (const int v : probe.part.vertices) {
      const double own = distance(model.rest[v] + u[v]);
      if (own < gap.distance) gap = {own, {{v, 1.0}}};
    }
  });
  return gap;
}

}  // namespace viscera::sim
