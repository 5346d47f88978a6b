#include "stages/report/stress.hpp"

#include "pipeline/base/json_value.hpp"
#include "sim/base/von_mises.hpp"

namespace viscera {
namespace {

using sim::Mat3, sim::Vec3;

constexpr double pa_per_kpa = 1000.0;

Mat3<double> edges(const std::array<int, 4>& tet, const double* xyz) {
  const auto point = [xyz](int p) {
    return Vec3<double>{xyz[3 * p], xyz[3 * p + 1], xyz[3 * p + 2]};
  };
  const Vec3<double> origin = point(tet[0]);
  return {{point(tet[1]) - origin, point(tet[2]) - origin, point(tet[3]) - origin}};
}

}  // namespace

Tissue tissue_of(const Json& json, const std::string& where, const Json& simulate) {
  if (json.is_null()) return {};
  const JsonValue scene(json, where);
  const auto materials = scene.find("materials"), effects = scene.find("effects"),
             schedule = scene.find("schedule");
  if (!materials || !effects) return {};
  for (const char* other : {"linear", "stvk", "corotational", "distance", "volume"}) {
    if (effects->find(other)) return {};
  }
  if (!effects->find("neo_hookean") || scene.find("corotational_tets")) return {};
  if (schedule && !schedule->items().empty()) return {};
  if (simulate.is_object()) {
    for (const auto& input : simulate["inputs"]) {
      if (input["role"] == "stiffness") return {};
    }
  }
  Tissue tissue;
  for (const auto& [name, m] : materials->members()) {
    tissue[name] =
        sim::lame({.youngs_modulus = m["E"].number(), .poisson_ratio = m["nu"].number()});
  }
  return tissue;
}

VonMises::VonMises(const TetMesh& mesh, const Tissue& tissue) : mesh_(mesh) {
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    tets_.push_back({sim::inverse(edges(mesh.tets[t], mesh.points[0].data())),
                     tissue.at(mesh.label_names.at(mesh.labels[t]))});
  }
}

std::vector<double> VonMises::operator()(const std::vector<double>& xyz) const {
  std::vector<double> stress;
  stress.reserve(tets_.size());
  for (std::size_t t = 0; t < tets_.size(); ++t) {
    const Mat3<double> f = edges(mesh_.tets[t], xyz.data()) * tets_[t].rest_inverse;
    const Mat3<double> cof = sim::cofactor(f);
    const double mu = tets_[t].lame.mu, lambda = tets_[t].lame.neo_hookean_lambda();
    const double j = sim::det(f);
    Mat3<double> p;
    for (int k = 0; k < 3; ++k) {
      p.col[k] = mu * (f.col[k] - cof.col[k]) + (lambda * (j - 1.0)) * cof.col[k];
    }
    const Mat3<double> kirchhoff = p * sim::transpose(f);
    stress.push_back(j > 0.0 ? sim::von_mises(kirchhoff) / (pa_per_kpa * j) : 0.0);
  }
  return stress;
}

}  // namespace viscera
