#include "sim/stress/patch.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace viscera::sim {
namespace {

void keep_each_once(std::vector<int>& numbers) {
  std::ranges::sort(numbers);
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
}

// The value at a place of the linear function that fits samples best, each by its volume.
class Fit {
 public:
  Fit(const std::vector<Sample>& all, std::vector<int> patch)
      : all_(all), patch_(std::move(patch)) {
    for (const int s : patch_) volume_ += all[s].volume;
    for (const int s : patch_) mean_ += (all[s].volume / volume_) * all[s].place;
    Mat3<double> spread{};
    for (const int s : patch_) {
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
      sum.add(share * (1.0 + dot(slope, all_[s].place - mean_)), all_[s].value);
    }
    return sum;
  }
  Strained mean() const {
    Strained sum;
    for (const int s : patch_) sum.add(all_[s].volume / volume_, all_[s].value);
    return sum;
  }

 private:
  static constexpr double flat = 1e-6;  // of the cube of the mean variance
  const std::vector<Sample>& all_;
  std::vector<int> patch_;
  double volume_ = 0.0;
  Vec3<double> mean_;
  std::optional<Mat3<double>> inverse_;
};

std::vector<int> samples_in(const Samples& samples, const std::vector<int>& tets) {
  std::vector<int> found;
  for (const int t : tets) {
    for (const auto& share : samples.of[t]) found.push_back(share.sample);
  }
  keep_each_once(found);
  return found;
}

// Monomials of the second or the third degree and below: 10 or 20, those of first degree first.
template <int terms>
Eigen::Matrix<double, terms, 1> monomials(const Vec3<double>& p) {
  const auto& [x, y, z] = p;
  Eigen::Matrix<double, terms, 1> all;
  all.template head<10>() << x, y, z, 1.0, x * x, y * y, z * z, x * y, y * z, z * x;
  if constexpr (terms == 20) {
    all.template tail<10>() << x * x * x, y * y * y, z * z * z, x * x * y, x * x * z, y * y * x,
        y * y * z, z * z * x, z * z * y, x * y * z;
  }
  return all;
}

// By least squares with weights exp(-4 r^2), r being 1 at the farthest vertex. None where vertices
// are fewer than three a term or do not tell the terms apart, as two layers of them a third degree.
template <int terms>
std::optional<Mat3<double>> gradient_fitted_to(const Model& model, const State& state,
                                               const std::vector<int>& vertices, int at) {
  constexpr double told_apart = 1e-6;  // reciprocal condition number of the normal equations
  if (std::ssize(vertices) < 3 * terms) return std::nullopt;
  double reach = 0.0;
  for (const int v : vertices) reach = std::max(reach, norm(model.rest[v] - model.rest[at]));
  Eigen::Matrix<double, terms, terms> normal = Eigen::Matrix<double, terms, terms>::Zero();
  Eigen::Matrix<double, terms, 3> right = Eigen::Matrix<double, terms, 3>::Zero();
  for (const int v : vertices) {
    const Vec3<double> p = (1.0 / reach) * (model.rest[v] - model.rest[at]);
    const auto row = monomials<terms>(p);
    const double weight = std::exp(-4.0 * dot(p, p));
    const auto& [x, y, z] = state.u[v];
    normal.template selfadjointView<Eigen::Lower>().rankUpdate(row, weight);
    right += weight * row * Eigen::RowVector3d(x, y, z);
  }
  const Eigen::LLT<Eigen::Matrix<double, terms, terms>> factors(normal);
  if (factors.info() != Eigen::Success || factors.rcond() < told_apart) return std::nullopt;
  const Eigen::Matrix<double, terms, 3> fit = factors.solve(right);
  Mat3<double> h;
  for (int k = 0; k < 3; ++k)
    h.col[k] = (1.0 / reach) * Vec3<double>{fit(k, 0), fit(k, 1), fit(k, 2)};
  return h;
}

}  // namespace

TetsAround::TetsAround(const Model& model) : model_(model), tets_(model.vertex_count()) {
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    for (const int v : model.tets[t]) tets_[v].push_back(static_cast<int>(t));
  }
}

std::vector<int> TetsAround::tets_at(const std::vector<int>& vertices, int material) const {
  std::vector<int> found;
  for (const int v : vertices) {
    for (const int t : tets_[v]) {
      if (model_.material_of[t] == material) found.push_back(t);
    }
  }
  keep_each_once(found);
  return found;
}

std::vector<int> TetsAround::vertices_of(const std::vector<int>& tets) const {
  std::vector<int> found;
  for (const int t : tets) found.insert(found.end(), model_.tets[t].begin(), model_.tets[t].end());
  keep_each_once(found);
  return found;
}

Strained fitted_to_samples(const Model& model, const Samples& samples, const TetsAround& around,
                           int vertex, const std::vector<int>& tets) {
  const Vec3<double>& place = model.rest[vertex];
  const Fit fit(samples.all, samples_in(samples, tets));
  if (fit.reaches(place)) return fit.at(place);
  const auto wider = around.tets_at(around.vertices_of(tets), model.material_of[tets.front()]);
  const Fit wider_fit(samples.all, samples_in(samples, wider));
  return wider_fit.reaches(place) ? wider_fit.at(place) : fit.mean();
}

std::optional<Mat3<double>> fitted_gradient(const Model& model, const State& state,
                                            const TetsAround& around, int vertex,
                                            const std::vector<int>& tets) {
  constexpr int most_rings = 4;
  const int material = model.material_of[tets.front()];
  std::vector<int> vertices = around.vertices_of(tets);
  std::optional<Mat3<double>> of_second_degree;
  for (int ring = 1; ring <= most_rings; ++ring) {
    if (ring > 1) vertices = around.vertices_of(around.tets_at(vertices, material));
    if (const auto h = gradient_fitted_to<20>(model, state, vertices, vertex)) return h;
    if (!of_second_degree)
      of_second_degree = gradient_fitted_to<10>(model, state, vertices, vertex);
  }
  return of_second_degree;
}

}  // namespace viscera::sim
