#include "stages/tetmesh/generate/nesting.hpp"

#include <fmt/format.h>

#include <numbers>

#include "pipeline/base/error.hpp"
#include "stages/mesh/vec.hpp"

namespace viscera {
namespace {

// The solid angle of the shell seen from `p` is 4 pi inside and 0 outside (van Oosterom and
// Strackee 1983, eq. 8).
bool encloses(const SurfaceMesh& surface, const Shell& shell, const Vec& p) {
  double angle = 0.0;
  for (const int t : shell.triangles) {
    const auto& corner = surface.triangles[t];
    const Vec a = sub(surface.points[corner[0]], p), b = sub(surface.points[corner[1]], p),
              c = sub(surface.points[corner[2]], p);
    const double la = norm(a), lb = norm(b), lc = norm(c);
    angle += 2.0 * std::atan2(dot(a, cross(b, c)),
                              la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
  }
  return std::abs(angle) > 2.0 * std::numbers::pi;
}

}  // namespace

void check_nesting(const SurfaceMesh& surface, const std::string& file) {
  const auto shells = find_shells(surface);
  for (const Shell& shell : shells) {
    int around = 0;
    for (const Shell& other : shells)
      if (&other != &shell) around += encloses(surface, other, shell.place);
    const bool cavity = around % 2 != 0;
    if ((shell.volume < 0.0) == cavity) continue;
    throw Error(ExitCode::bad_input,
                {.where = file,
                 .field = fmt::format("shell near ({:.1f}, {:.1f}, {:.1f}) mm", shell.place[0],
                                      shell.place[1], shell.place[2]),
                 .found = cavity ? "a body within another body" : "a surface turned inside out",
                 .allowed = "outer shells turned outwards, cavities within them turned inwards",
                 .remedy = cavity ? "leave the inner one out, turn it, or give both as labels"
                                  : "turn its triangles"});
  }
}

}  // namespace viscera
