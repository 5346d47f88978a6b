#include "sim/model/surface.hpp"

#include <algorithm>

#include "sim/base/tet_face.hpp"

namespace viscera::sim {

std::vector<TetFace> tet_faces(const Model& model) {
  struct Side {
    Triangle key;
    TetFace face;
  };
  std::vector<Side> sides;
  sides.reserve(4 * model.tet_count());
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Tet& tet = model.tets[t];
    for (int k = 0; k < 4; ++k) {
      const Triangle face = face_of_tet(tet, k);
      Side& side = sides.emplace_back(Side{face, {face, static_cast<int>(t), -1}});
      std::ranges::sort(side.key);
    }
  }
  std::ranges::stable_sort(sides, {}, &Side::key);
  std::vector<TetFace> faces;
  for (std::size_t i = 0; i < sides.size(); ++i) {
    TetFace& face = faces.emplace_back(sides[i].face);
    const bool shared = i + 1 < sides.size() && sides[i + 1].key == sides[i].key;
    if (shared) face.other = sides[++i].face.tet;
  }
  return faces;
}

std::vector<Triangle> boundary_faces(const Model& model) {
  std::vector<Triangle> boundary;
  for (const TetFace& face : tet_faces(model)) {
    if (face.other < 0) boundary.push_back(face.vertices);
  }
  return boundary;
}

std::vector<int> vertices_of(const std::vector<Triangle>& faces) {
  std::vector<int> vertices;
  for (const Triangle& face : faces) vertices.insert(vertices.end(), face.begin(), face.end());
  std::ranges::sort(vertices);
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  return vertices;
}

Vec3<double> area_vector(const Model& model, const Triangle& face) {
  const Vec3<double>& a = model.rest[face[0]];
  return 0.5 * cross(model.rest[face[1]] - a, model.rest[face[2]] - a);
}

}  // namespace viscera::sim
