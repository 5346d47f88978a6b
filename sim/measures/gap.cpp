#include "sim/measures/gap.hpp"

#include <limits>
#include <set>

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
  return {name, {vertices.begin(), vertices.end()}, obstacle};
}

Gap gap_now(const Model& model, const Scene& scene, const GapProbe& probe,
            const std::vector<Vec3<double>>& u, double time) {
  Gap gap{std::numeric_limits<double>::infinity(), -1};
  for_each_obstacle(scene, [&]<class Effect>(const auto& params, const std::string& name) {
    if (name != probe.obstacle) return;
    const auto distance = Effect::distance_at(model, params, time);
    for (const int v : probe.vertices) {
      const double own = distance(model.rest[v] + u[v]);
      if (own < gap.distance) gap = {own, v};
    }
  });
  return gap;
}

}  // namespace viscera::sim
