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

Vec3<double> area_vector(const Model& model, const Triangle& face) {
  const Vec3<double>& a = model.rest[face[0]];
  return 0.5 * cross(model.rest[face[1]] - a, model.rest[face[2]] - a);
}

// By the Voronoi regions of the triangle's features: Ericson, "Real-Time Collision Detection"
// (2005), section 5.1.5.
Vec3<double> nearest_on_triangle(const Vec3<double>& p, const Vec3<double>& a,
                                 const Vec3<double>& b, const Vec3<double>& c) {
  const Vec3<double> ab = b - a, ac = c - a, ap = p - a, bp = p - b, cp = p - c;
  const double d1 = dot(ab, ap), d2 = dot(ac, ap);
  if (d1 <= 0.0 && d2 <= 0.0) return a;
  const double d3 = dot(ab, bp), d4 = dot(ac, bp);
  if (d3 >= 0.0 && d4 <= d3) return b;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return a + (d1 / (d1 - d3)) * ab;
  const double d5 = dot(ab, cp), d6 = dot(ac, cp);
  if (d6 >= 0.0 && d5 <= d6) return c;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return a + (d2 / (d2 - d6)) * ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 >= d3 && d5 >= d6) return b + ((d4 - d3) / (d4 - d3 + d5 - d6)) * (c - b);
  return a + (vb / (va + vb + vc)) * ab + (vc / (va + vb + vc)) * ac;
}

}  // namespace viscera::sim
