#include "stages/mesh/tet_checks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <numeric>

#include "pipeline/base/error.hpp"
#include "sim/base/tet_face.hpp"
#include "stages/mesh/vec.hpp"

namespace viscera {
namespace {

constexpr std::size_t places_told = 3;

struct Refused {
  const char *field, *what, *allowed, *remedy;
};

// `place(i)` is the text of the i-th of `count`.
template <class Place>
void refuse_any(std::size_t count, Place place, const std::string& file, const Refused& refused) {
  if (count == 0) return;
  std::string places;
  for (std::size_t i = 0; i < std::min(places_told, count); ++i) {
    const auto& [name, at] = place(i);
    places += fmt::format("{}{} at ({:.2f}, {:.2f}, {:.2f}) mm", i > 0 ? ", " : "", name, at[0],
                          at[1], at[2]);
  }
  throw Error(ExitCode::bad_input, {.where = file,
                                    .field = refused.field,
                                    .found = fmt::format("{} {}: {}{}", count, refused.what, places,
                                                         count > places_told ? ", ..." : ""),
                                    .allowed = refused.allowed,
                                    .remedy = refused.remedy});
}

// Indices of the values that equal one before them in ascending order.
template <class T>
std::vector<int> repeated(const std::vector<T>& values) {
  std::vector<int> order(values.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, {}, [&](int i) { return values[i]; });
  std::vector<int> again;
  for (std::size_t i = 1; i < order.size(); ++i) {
    if (values[order[i]] == values[order[i - 1]]) again.push_back(order[i]);
  }
  return again;
}

void refuse_non_manifold(const TetMesh& mesh, const std::vector<Face>& faces,
                         const std::string& file) {
  std::vector<std::array<int, 3>> triangles;
  for (const Face& face : faces) {
    if (face.count == 1)
      triangles.push_back(sim::face_of_tet(mesh.tets[face.tets[0]], face.opposite[0]));
  }
  constexpr const char* allowed = "a boundary where triangles meet in pairs, in one fan a point";
  constexpr const char* remedy = "join the parts by a face, or part them, where the mesh is made";
  const auto edges = singular_edges(triangles);
  const auto edge = [&](std::size_t i) {
    const auto [a, b] = edges[i];
    return std::pair{fmt::format("edge {} to {}", a, b),
                     scale(0.5, add(mesh.points[a], mesh.points[b]))};
  };
  refuse_any(
      edges.size(), edge, file,
      {"boundary", "edges of the boundary do not have exactly two triangles", allowed, remedy});
  const auto points = singular_points(triangles, mesh.points.size());
  const auto point = [&](std::size_t i) {
    return std::pair{fmt::format("point {}", points[i]), mesh.points[points[i]]};
  };
  refuse_any(points.size(), point, file,
             {"points", "points join parts of the body that touch nowhere else", allowed, remedy});
}

}  // namespace

void refuse_tets(const TetMesh& mesh, const std::vector<int>& tets, const std::string& file,
                 const char* what, const char* allowed) {
  const auto place = [&](std::size_t i) {
    Vec centre{};
    for (const int corner : mesh.tets[tets[i]])
      centre = add(centre, scale(0.25, mesh.points[corner]));
    return std::pair{fmt::format("tet {}", tets[i]), centre};
  };
  refuse_any(tets.size(), place, file,
             {"tets", what, allowed,
              "mend the mesh where it was made, or mesh the labels or surface anew"});
}

// Seen from a face, its two tets must lie on different sides; where all tets are positive, they
// then run through its corners in opposite senses.
void refuse_overlaps(const TetMesh& mesh, const std::vector<Face>& faces, const std::string& file) {
  std::vector<int> overfull, folded;
  for (const Face& face : faces) {
    if (face.count > 2) overfull.push_back(face.tets[0]);
    if (face.count != 2) continue;
    const auto a = sim::face_of_tet(mesh.tets[face.tets[0]], face.opposite[0]);
    auto b = sim::face_of_tet(mesh.tets[face.tets[1]], face.opposite[1]);
    std::rotate(b.begin(), std::find(b.begin(), b.end(), a[0]), b.end());
    if (a == b) folded.push_back(face.tets[0]);
  }
  refuse_tets(mesh, overfull, file, "faces have more than two tets", "at most two tets at a face");
  refuse_tets(mesh, folded, file, "pairs of tets lie on the same side of their common face",
              "tets that do not overlap");
}

void check_body(const TetMesh& mesh, const std::string& file) {
  std::vector<std::array<int, 4>> sorted = mesh.tets;
  for (auto& tet : sorted) std::ranges::sort(tet);
  refuse_tets(mesh, repeated(sorted), file, "tets stand twice", "every tet once");
  const std::vector<Face> faces = find_faces(mesh);
  refuse_overlaps(mesh, faces, file);
  refuse_non_manifold(mesh, faces, file);
}

}  // namespace viscera
