#include "stages/tetmesh/improve/project_fields.hpp"

#include <algorithm>

namespace viscera {
namespace {

constexpr int max_field_steps = 16;
constexpr double settled = 1e-4;    // of a voxel
constexpr double max_voxels = 3.0;  // that a point may be moved

// The shortest step onto the zero planes of one or two linearised conditions.
std::optional<Vec> newton_step(const std::array<double, 2>& value, const std::array<Vec, 2>& slope,
                               std::size_t conditions) {
  const double aa = dot(slope[0], slope[0]);
  if (aa < 1e-16) return std::nullopt;
  if (conditions == 1) return scale(-value[0] / aa, slope[0]);
  const double ab = dot(slope[0], slope[1]), bb = dot(slope[1], slope[1]);
  const double determinant = aa * bb - ab * ab;
  if (determinant < 1e-3 * aa * bb || bb < 1e-16) return std::nullopt;
  const double x = (ab * value[1] - bb * value[0]) / determinant;
  const double y = (ab * value[0] - aa * value[1]) / determinant;
  return add(scale(x, slope[0]), scale(y, slope[1]));
}

Vec to_lps_direction(const Frame& frame, const Vec& v) {
  Vec turned{};
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) turned[r] += frame.direction[3 * r + c] * v[c];
  return turned;
}

std::optional<Contact> project(const MaterialFields& fields, const Vec& point,
                               const std::vector<int>& labels) {
  const std::size_t conditions = labels.size() - 1;
  if (labels.size() < 2 || conditions > 2) return std::nullopt;
  // With the outside among three labels, one condition is the body's and one between materials.
  const int pairs[2][2] = {{labels[0], labels[1]},
                           {labels[labels[0] == 0 ? 1 : 0], labels[conditions]}};
  const Frame& frame = fields.frame();
  const double voxel = std::min({frame.spacing[0], frame.spacing[1], frame.spacing[2]});
  const Vec start = frame.from_lps(point);
  Vec p = start;
  std::array<double, 2> value{};
  std::array<Vec, 2> slope{};
  for (int step = 0; step < max_field_steps; ++step) {
    for (std::size_t c = 0; c < conditions; ++c)
      value[c] = fields.lead(p, pairs[c][0], pairs[c][1], slope[c]);
    const auto move = newton_step(value, slope, conditions);
    if (!move) return std::nullopt;
    // Gradients jump between voxels: shorter steps end a walk to and fro.
    p = add(p, scale(step < max_field_steps / 2 ? 1.0 : 0.5, *move));
    if (norm(sub(p, start)) > max_voxels * voxel) return std::nullopt;
    if (norm(*move) > settled * voxel) continue;
    Contact contact{frame.to_lps(p), {}};
    for (std::size_t c = 0; c < conditions; ++c)
      contact.normals.push_back(to_lps_direction(frame, scale(1.0 / norm(slope[c]), slope[c])));
    return contact;
  }
  return std::nullopt;
}

}  // namespace

Projector field_projector(const MaterialFields& fields) {
  return [&fields](const Vec& point, const std::vector<int>& labels) {
    return project(fields, point, labels);
  };
}

}  // namespace viscera
