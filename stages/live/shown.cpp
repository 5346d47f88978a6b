#include "stages/live/shown.hpp"

#include <algorithm>
#include <cmath>

#include "sim/model/surface.hpp"
#include "sim/scene/elasticity.hpp"

namespace viscera::live {

Surfaces surfaces_of(const sim::Model& model) {
  const auto faces = tet_faces(model);
  std::vector<double> outside(model.materials.size());  // area, m2
  for (const sim::TetFace& face : faces) {
    if (face.other >= 0) continue;
    outside[model.material_of[face.tet]] += norm(area_vector(model, face.vertices));
  }
  Surfaces surfaces;
  surfaces.outermost = std::ranges::max_element(outside) - outside.begin();
  for (const std::string& name : model.label_names) surfaces.all.push_back({name, {}});
  const auto add = [&](int material, const sim::Triangle& face) {
    surfaces.all[material].faces.push_back(face);
  };
  for (const sim::TetFace& face : faces) {
    const auto [a, b, c] = face.vertices;
    const int hidden = static_cast<int>(surfaces.outermost);
    const int own = model.material_of[face.tet];
    const int other = face.other < 0 ? -1 : model.material_of[face.other];
    if (own == other) continue;
    if (other < 0 || own != hidden) add(own, face.vertices);
    if (other >= 0 && other != hidden) add(other, {a, c, b});
  }
  return surfaces;
}

MeasureInfo info_of(Measure measure) {
  switch (measure) {
    case Measure::displacement:
      return {"displacement", "mm"};
    case Measure::stress:
      return {"von Mises stress", "kPa"};
    case Measure::volume:
      return {"volume ratio", "1"};
    default:
      return {"material", ""};
  }
}

Measure next_of(Measure measure) {
  return measure == Measure::volume ? Measure::material
                                    : static_cast<Measure>(static_cast<int>(measure) + 1);
}

Measurer::Measurer(const sim::Model& body, const Surfaces& surfaces) : body_(body) {
  std::vector<char> is_shown(body.vertex_count());
  for (const Surface& surface : surfaces.all) {
    for (const auto& face : surface.faces) {
      for (const int v : face) is_shown[v] = 1;
    }
  }
  for (std::size_t t = 0; t < body.tet_count(); ++t) {
    if (std::ranges::any_of(body.tets[t], [&](int v) { return is_shown[v]; })) tets_.push_back(t);
  }
}

std::vector<float> Measurer::measure(Measure measure, const Snapshot& snapshot) {
  const std::size_t n = body_.vertex_count();
  std::vector<float> values(n);
  if (measure == Measure::material) return values;
  if (measure == Measure::displacement) {
    for (std::size_t i = 0; i < n; ++i) {
      values[i] = static_cast<float>(1e3 * norm(snapshot.state.u[i]));
    }
    return values;
  }
  body_.materials = snapshot.setting->materials;
  std::vector<double> sum(n), volume(n);
  for (const std::size_t t : tets_) {
    const double value = of_tet(measure, snapshot, t);
    for (const int v : body_.tets[t]) {
      sum[v] += body_.volume[t] * value;
      volume[v] += body_.volume[t];
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (volume[i] > 0.0) values[i] = static_cast<float>(sum[i] / volume[i]);
  }
  return values;
}

double Measurer::of_tet(Measure measure, const Snapshot& snapshot, std::size_t tet) const {
  if (measure == Measure::stress) {
    return 1e-3 * von_mises_stress(body_, snapshot.setting->scene, snapshot.state, tet);
  }
  return 1.0 + sim::NeoHookean::volume_strain(gradient_of(body_, snapshot.state, tet));
}

std::vector<float> normals_of(const std::vector<sim::Triangle>& faces,
                              const std::vector<float>& positions) {
  std::vector<sim::Vec3<float>> sum(positions.size() / 3);
  const auto at = [&](int v) {
    return sim::Vec3<float>{positions[3 * v], positions[3 * v + 1], positions[3 * v + 2]};
  };
  for (const auto& [a, b, c] : faces) {
    const auto area = cross(at(b) - at(a), at(c) - at(a));
    for (const int v : {a, b, c}) sum[v] += area;
  }
  std::vector<float> normals;
  normals.reserve(positions.size());
  for (const auto& area : sum) {
    const float length = norm(area), share = length > 0.0F ? 1.0F / length : 0.0F;
    for (const float x : {area.x, area.y, area.z}) normals.push_back(share * x);
  }
  return normals;
}

}  // namespace viscera::live
