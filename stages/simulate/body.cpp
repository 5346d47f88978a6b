#include "stages/simulate/body.hpp"

#include <cmath>

namespace viscera {

sim::Model make_body(const TetMesh& mesh, const std::map<int, sim::Material>& by_label) {
  std::vector<sim::Vec3<double>> points;
  for (const auto& [x, y, z] : mesh.points) {
    points.push_back(mm_to_m * sim::Vec3<double>{x, y, z});
  }
  sim::Model model = sim::make_model(points, mesh.tets, mesh.labels, by_label, mesh.label_names);
  model.regions = mesh.regions;
  return model;
}

std::vector<double> missing_volumes(const TetMesh& mesh) {
  constexpr double mm3_to_m3 = mm_to_m * mm_to_m * mm_to_m;
  std::vector<double> missing;
  const auto found = mesh.cell_data.find(missing_volume);
  if (found == mesh.cell_data.end()) return missing;
  for (const float volume : found->second) {
    if (!std::isfinite(volume)) return {};
    missing.push_back(mm3_to_m3 * volume);
  }
  return missing;
}

std::vector<float> positions_mm(const sim::Model& model, const sim::State& state) {
  std::vector<float> positions;
  positions.reserve(3 * model.vertex_count());
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const sim::Vec3<double> x = m_to_mm * (model.origin + model.rest[i] + state.u[i]);
    for (const double value : {x.x, x.y, x.z}) positions.push_back(static_cast<float>(value));
  }
  return positions;
}

std::array<double, 3> scanned_place(const sim::Model& model, std::size_t tet) {
  sim::Vec3<double> middle = model.origin;
  for (const int v : model.tets[tet]) middle += 0.25 * model.rest[v];
  return {m_to_mm * middle.x, m_to_mm * middle.y, m_to_mm * middle.z};
}

}  // namespace viscera
