#include "sim/stress/samples.hpp"

#include "sim/scene/elasticity.hpp"
#include "sim/solvers/fem/mesh.hpp"

namespace viscera::sim {
namespace {

Vec3<double> centroid(const Model& model, std::size_t tet) {
  Vec3<double> sum;
  for (const int v : model.tets[tet]) sum += 0.25 * model.rest[v];
  return sum;
}

Samples of_linear_tets(const Model& model, const Scene& scene, const State& state,
                       Samples samples) {
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    if (!samples.of[t].empty()) continue;
    samples.add(t, {centroid(model, t), model.volume[t],
                    strained(model, scene, t, gradient_of(model, state, t))});
  }
  return samples;
}

// What a group of tets adds to the stress of each: with its energy, (lambda - lambda_s) C^2/2 by
// volume, (lambda - lambda_s) C dC/dF F^T / J, which is the same in all directions where C = J - 1.
struct GroupStress {
  double volume_ratio;  // J, det F of the group
  double factor;        // (lambda - lambda_s) C, Pa
  GroupedVolume::Measure<double> measure;
};

// [m] or empty where there are no groups.
std::vector<GroupStress> group_stresses(const Model& model, const Scene& scene,
                                        const State& state) {
  std::vector<GroupStress> all;
  for (const auto& params : scene.params<GroupedVolume>()) {
    all.resize(model.tet_count());
    const auto groups = GroupedVolume::groups(model, params);
    const auto measure = GroupedVolume::Measure<double>::of(params.strain);
    for (std::size_t g = 0; g < groups->size(); ++g) {
      const Mat3<double> h = groups->displacement_gradient(g, state.u);
      const double modulus = GroupedVolume::of_groups(groups->mean_lame(model, g));
      for (const int t : groups->tets_of(g))
        all[t] = {1.0 + NeoHookean::volume_strain(h), modulus * measure.strain(h), measure};
    }
  }
  return all;
}

// Those of the domains; tets that are in none have their own.
Samples of_smoothed_elements(const Model& model, const Scene& scene, const State& state) {
  Samples samples{{}, std::vector<std::vector<Samples::Share>>(model.tet_count())};
  const auto of_groups = group_stresses(model, scene, state);
  Scene without_groups = scene;
  without_groups.params<GroupedVolume>().clear();
  // Tets of one label differ where E was measured.
  const auto strained_tet = [&](int t, const Mat3<double>& h) {
    Strained value = strained(model, without_groups, t, h);
    if (of_groups.empty()) return value;
    const GroupStress& group = of_groups[t];
    value.add_stress(tensor6(cauchy_of(group.factor * group.measure.slope(h), h)));
    value.volume_ratio = group.volume_ratio;
    return value;
  };
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (is_smoothed<Effect>) {
      const auto& laws = std::get<i>(scene.effects);
      if (laws.empty()) return;
      const auto domains = Effect::domains(model, laws.front());  // those of all terms of a law
      for (std::size_t d = 0; d < domains->size(); ++d) {
        const Mat3<double> h = domains->displacement_gradient(d, state.u);
        Sample sample{{}, domains->volume[d], {}};
        for (const int t : domains->tets_of(d)) {
          const double own = model.volume[t] / 6.0, share = own / sample.volume;
          sample.place += share * centroid(model, t);
          sample.value.add(share, strained_tet(t, h));
          samples.of[t].push_back({static_cast<int>(samples.all.size()), own});
        }
        samples.all.push_back(sample);
      }
    }
  });
  return samples;
}

Samples of_quadratic_tets(const Model& model, const Scene& scene, const State& state) {
  Samples samples{{}, std::vector<std::vector<Samples::Share>>(model.tet_count())};
  const FemMesh mesh(model, 2);
  const auto u = mesh.displacements(state);
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const auto& element = mesh.quadratic[t];
    for (int p = 0; p < FemElement<10>::point_count; ++p) {
      const auto& point = element.points[p];
      const Vec3<double> place =
          centroid(model, t) +
          FemElement<10>::point_reach * (model.rest[model.tets[t][p]] - centroid(model, t));
      samples.add(t, {place, point.volume,
                      strained(model, scene, t, gradient_at<10>(element.nodes, point, u))});
    }
  }
  return samples;
}

}  // namespace

void Samples::add(std::size_t tet, const Sample& sample) {
  of[tet].push_back({static_cast<int>(all.size()), sample.volume});
  all.push_back(sample);
}

Strained strained(const Model& model, const Scene& scene, std::size_t tet, const Mat3<double>& h) {
  const Mat3<double> f = plus_identity(1.0, h);
  Tensor6 green = tensor6(plus_identity(-1.0, transpose(f) * f));
  for (double& e : green) e *= 0.5;
  return {.cauchy = tensor6(cauchy_stress(model, scene, tet, h)),
          .green = green,
          .volume_ratio = det(f)};
}

Samples samples_of(const Model& model, const Scene& scene, const State& state, int order) {
  if (order == 2) return of_quadratic_tets(model, scene, state);
  return of_linear_tets(model, scene, state, of_smoothed_elements(model, scene, state));
}

}  // namespace viscera::sim
