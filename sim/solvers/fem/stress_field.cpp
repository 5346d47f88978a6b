#include "sim/solvers/fem/stress_field.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <optional>
#include <set>

#include "sim/scene/elasticity.hpp"
#include "sim/solvers/fem/mesh.hpp"

namespace viscera::sim {
namespace {

// A point of quadrature.
struct Sample {
  Vec3<double> place;  // at rest, m
  double volume;       // m3
  Strained value;
};

struct Samples {
  struct Share {
    int sample;
    double volume;  // of the sample's, what is in the tet, m3
  };
  std::vector<Sample> all;
  std::vector<std::vector<Share>> of;  // [m] those of a tet

  void add(std::size_t tet, const Sample& sample) {
    of[tet].push_back({static_cast<int>(all.size()), sample.volume});
    all.push_back(sample);
  }
};

void add(double share, const Strained& from, Strained& to) {
  for (int k = 0; k < 6; ++k) {
    to.cauchy[k] += share * from.cauchy[k];
    to.green[k] += share * from.green[k];
  }
  to.volume_ratio += share * from.volume_ratio;
}

Tensor6 part(const Mat3<double>& m) {
  const auto& [x, y, z] = m.col;
  return {x.x, y.y, z.z, 0.5 * (x.y + y.x), 0.5 * (y.z + z.y), 0.5 * (x.z + z.x)};
}

// What a gradient of displacement makes of the tissue of a tet.
Strained strained(const Model& model, const Scene& scene, std::size_t tet, const Mat3<double>& h) {
  const Mat3<double> f = plus_identity(1.0, h);
  Tensor6 green = part(plus_identity(-1.0, transpose(f) * f));
  for (double& e : green) e *= 0.5;
  return {
      .cauchy = part(cauchy_stress(model, scene, tet, h)), .green = green, .volume_ratio = det(f)};
}

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

// What a group of tets adds to the stress of each: with its energy, (lambda - lambda_s) (J - 1)^2/2
// by volume, the same in all directions.
struct GroupStress {
  double volume_ratio;  // J, det F of the group
  double mean_stress;   // (lambda - lambda_s) (J - 1), Pa
};

// [m] or empty where there are no groups.
std::vector<GroupStress> group_stresses(const Model& model, const Scene& scene,
                                        const State& state) {
  std::vector<GroupStress> all;
  for (const auto& params : scene.params<GroupedVolume>()) {
    all.resize(model.tet_count());
    const auto groups = GroupedVolume::groups(model, params);
    for (std::size_t g = 0; g < groups->size(); ++g) {
      const double change = NeoHookean::volume_strain(groups->displacement_gradient(g, state.u));
      const double modulus = GroupedVolume::of_groups(groups->mean_lame(model, g));
      for (const int t : groups->tets_of(g)) all[t] = {1.0 + change, modulus * change};
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
    for (int k = 0; k < 3; ++k) value.cauchy[k] += of_groups[t].mean_stress;
    value.volume_ratio = of_groups[t].volume_ratio;
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
          add(share, strained_tet(t, h), sample.value);
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

Samples samples_of(const Model& model, const Scene& scene, const State& state, int order) {
  if (order == 2) return of_quadratic_tets(model, scene, state);
  return of_linear_tets(model, scene, state, of_smoothed_elements(model, scene, state));
}

// The value at a place of the linear function that fits samples best, each by its volume.
class Fit {
 public:
  Fit(const std::vector<Sample>& all, const std::set<int>& patch) : all_(all), patch_(patch) {
    for (const int s : patch) volume_ += all[s].volume;
    for (const int s : patch) mean_ += (all[s].volume / volume_) * all[s].place;
    Mat3<double> spread{};
    for (const int s : patch) {
      const Vec3<double> off = all[s].place - mean_;
      const double share = all[s].volume / volume_;
      spread.col[0] += (share * off.x) * off;
      spread.col[1] += (share * off.y) * off;
      spread.col[2] += (share * off.z) * off;
    }
    const double width = (spread.col[0].x + spread.col[1].y + spread.col[2].z) / 3.0;
    if (det(spread) > flat * width * width * width) inverse_ = inverse(spread);
  }

  // Whether samples are enough, and the place not so far outside of them that what they are off
  // would be multiplied: in units of their variance the corner of a box lies 9 off its middle.
  bool reaches(const Vec3<double>& place) const {
    const Vec3<double> off = place - mean_;
    return patch_.size() >= 8 && inverse_ && dot(off, *inverse_ * off) < 20.0;
  }
  Strained at(const Vec3<double>& place) const {
    const Vec3<double> slope = *inverse_ * (place - mean_);
    Strained sum;
    for (const int s : patch_) {
      const double share = all_[s].volume / volume_;
      add(share * (1.0 + dot(slope, all_[s].place - mean_)), all_[s].value, sum);
    }
    return sum;
  }
  Strained mean() const {
    Strained sum;
    for (const int s : patch_) add(all_[s].volume / volume_, all_[s].value, sum);
    return sum;
  }

 private:
  static constexpr double flat = 1e-6;  // of the cube of the mean variance
  const std::vector<Sample>& all_;
  const std::set<int>& patch_;
  double volume_ = 0.0;
  Vec3<double> mean_;
  std::optional<Mat3<double>> inverse_;
};

// Tets around vertices, each list in ascending order.
class Around {
 public:
  explicit Around(const Model& model) : model_(model), tets_(model.vertex_count()) {
    for (std::size_t t = 0; t < model.tet_count(); ++t) {
      for (const int v : model.tets[t]) tets_[v].push_back(static_cast<int>(t));
    }
  }
  std::set<int> tets(const StressField::Corner& corner) const {
    std::set<int> found;
    for (const int t : tets_[corner.vertex]) {
      if (model_.material_of[t] == corner.material) found.insert(t);
    }
    return found;
  }
  // With all of their material that share a vertex with one of them.
  std::set<int> with_neighbours(const std::set<int>& tets, int material) const {
    std::set<int> wider;
    for (const int t : tets) {
      for (const int v : model_.tets[t]) wider.merge(this->tets({v, material}));
    }
    return wider;
  }

 private:
  const Model& model_;
  std::vector<std::vector<int>> tets_;
};

std::set<int> samples_in(const Samples& samples, const std::set<int>& tets) {
  std::set<int> found;
  for (const int t : tets) {
    for (const auto& share : samples.of[t]) found.insert(share.sample);
  }
  return found;
}

// The gradient of displacement at a vertex, from a quadratic function fitted to the displacements
// of vertices around it.
std::optional<Mat3<double>> fitted_gradient(const Model& model, const State& state,
                                            const std::set<int>& tets, int vertex) {
  constexpr int terms = 10;
  std::set<int> vertices;
  for (const int t : tets) vertices.insert(model.tets[t].begin(), model.tets[t].end());
  if (std::ssize(vertices) < 2 * terms) return std::nullopt;
  const auto rows = static_cast<Eigen::Index>(vertices.size());
  Eigen::Matrix<double, Eigen::Dynamic, terms> a(rows, terms);
  Eigen::Matrix<double, Eigen::Dynamic, 3> u(rows, 3);
  double reach = 0.0;
  for (const int v : vertices) {
    reach = std::max(reach, norm(model.rest[v] - model.rest[vertex]));
  }
  Eigen::Index r = 0;
  for (const int v : vertices) {
    const Vec3<double> p = (1.0 / reach) * (model.rest[v] - model.rest[vertex]);
    a.row(r) << p.x, p.y, p.z, 1.0, p.x * p.x, p.y * p.y, p.z * p.z, p.x * p.y, p.y * p.z,
        p.z * p.x;
    u.row(r++) << state.u[v].x, state.u[v].y, state.u[v].z;
  }
  const auto factors = a.colPivHouseholderQr();
  if (factors.rank() < terms) return std::nullopt;
  const Eigen::Matrix<double, terms, 3> fit = factors.solve(u);
  Mat3<double> h;
  for (int k = 0; k < 3; ++k) {
    h.col[k] = (1.0 / reach) * Vec3<double>{fit(k, 0), fit(k, 1), fit(k, 2)};
  }
  return h;
}

// The linear function of the samples around a corner, at it.
Strained fitted_samples(const Model& model, const Samples& samples, const Around& around,
                        const StressField::Corner& corner, const std::set<int>& tets) {
  const Vec3<double>& place = model.rest[corner.vertex];
  const std::set<int> near = samples_in(samples, tets);
  const Fit fit(samples.all, near);
  if (fit.reaches(place)) return fit.at(place);
  const std::set<int> far = samples_in(samples, around.with_neighbours(tets, corner.material));
  const Fit wider(samples.all, far);
  return wider.reaches(place) ? wider.at(place) : fit.mean();
}

double mean_stress(const Tensor6& cauchy) {
  return (cauchy[0] + cauchy[1] + cauchy[2]) / 3.0;
}

Strained recover(const Model& model, const Samples& samples, const Around& around,
                 const StressField::Corner& corner, const Scene& scene, const State& state,
                 int order) {
  const std::set<int> tets = around.tets(corner);
  const Strained sampled = fitted_samples(model, samples, around, corner, tets);
  if (order == 2) return sampled;
  const auto h =
      fitted_gradient(model, state, around.with_neighbours(tets, corner.material), corner.vertex);
  if (!h) return sampled;
  Strained fitted = strained(model, scene, *tets.begin(), *h);
  const double pressure = mean_stress(sampled.cauchy) - mean_stress(fitted.cauchy);
  for (int k = 0; k < 3; ++k) fitted.cauchy[k] += pressure;
  fitted.volume_ratio = sampled.volume_ratio;
  return fitted;
}

std::vector<Strained> means_of(const Model& model, const Samples& samples) {
  std::vector<Strained> tets(model.tet_count());
  for (std::size_t t = 0; t < tets.size(); ++t) {
    for (const auto& [sample, volume] : samples.of[t])
      add(volume / model.volume[t], samples.all[sample].value, tets[t]);
  }
  return tets;
}

}  // namespace

Mat3<double> full(const Tensor6& s) {
  return {{{s[0], s[3], s[5]}, {s[3], s[1], s[4]}, {s[5], s[4], s[2]}}};
}

std::array<double, 3> principal_values(const Tensor6& s) {
  Eigen::Matrix3d m;
  m << s[0], s[3], s[5], s[3], s[1], s[4], s[5], s[4], s[2];
  const Eigen::Vector3d ascending =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(m, Eigen::EigenvaluesOnly).eigenvalues();
  return {ascending[2], ascending[1], ascending[0]};
}

bool has_stress(const Scene& scene) {
  bool found = false;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (requires { &Effect::energy; }) found |= !std::get<i>(scene.effects).empty();
  });
  return found;
}

std::vector<Strained> strained_tets(const Model& model, const Scene& scene, const State& state,
                                    int order) {
  return means_of(model, samples_of(model, scene, state, order));
}

StressField stress_field(const Model& model, const Scene& scene, const State& state, int order) {
  const Samples samples = samples_of(model, scene, state, order);
  StressField field{.tets = means_of(model, samples)};
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    for (const int v : model.tets[t]) field.corners.push_back({v, model.material_of[t]});
  }
  std::sort(field.corners.begin(), field.corners.end());
  field.corners.erase(std::unique(field.corners.begin(), field.corners.end()), field.corners.end());
  const auto place = [&field](int vertex, int material) {
    const StressField::Corner corner{vertex, material};
    const auto found = std::lower_bound(field.corners.begin(), field.corners.end(), corner);
    return static_cast<int>(found - field.corners.begin());
  };
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    Tet corners;
    for (int k = 0; k < 4; ++k) corners[k] = place(model.tets[t][k], model.material_of[t]);
    field.corners_of.push_back(corners);
  }
  const Around around(model);
  for (const auto& corner : field.corners) {
    field.recovered.push_back(recover(model, samples, around, corner, scene, state, order));
  }
  return field;
}

}  // namespace viscera::sim
