// What a support's border costs: bodies at rest by Newton's method, held where the mesh has a
// region `support` or, in meshes without it, by the vertices that lie in it, off quadratic tets on
// the first mesh, which must have the region.
//   bench_support CSV NU REFERENCE.vtu MESH.vtu…     gravity along +y
// Errors are root mean squares over the mass, in percent of the displacement's, of the displacement
// at vertices; that of the reference is interpolated there. Also how far the centroid of each
// material is off, mm.
#include <cstdio>
#include <fstream>

#include "tests/bench/bodies.hpp"

namespace viscera {
namespace {

using sim::Model, sim::Vec3;
using Displacement = std::vector<Vec3<double>>;

constexpr const char* support = "support";

// Of the region, m in patient coordinates.
double lowest(const Model& model) {
  double z = HUGE_VAL;
  for (std::size_t t = 0; t < model.tet_count(); ++t)
    for (const int v : model.tets[t])
      if (model.regions.at(support)[t]) z = std::min(z, model.rest[v].z + model.origin.z);
  return z;
}

void hold_above(Model& model, double z) {
  for (std::size_t i = 0; i < model.vertex_count(); ++i)
    model.fixed[i] = model.rest[i].z + model.origin.z > z - 1e-9;
}

// A field at another mesh's vertices: linear in the tet that a vertex is in, or is nearest to.
Displacement at_vertices(const Model& to, const Model& from, const Displacement& u) {
  Displacement found;
  for (const auto& x : to.rest) {
    double best = -HUGE_VAL;
    Vec3<double> value;
    for (std::size_t t = 0; t < from.tet_count(); ++t) {
      const auto& tet = from.tets[t];
      const Vec3<double> local =
          from.rest_inverse[t] * (x + to.origin - from.origin - from.rest[tet[0]]);
      const double first = 1.0 - local.x - local.y - local.z;
      const double least = std::min({first, local.x, local.y, local.z});
      if (least <= best) continue;
      best = least;
      value = first * u[tet[0]] + local.x * u[tet[1]] + local.y * u[tet[2]] + local.z * u[tet[3]];
    }
    found.push_back(value);
  }
  return found;
}

Vec3<double> centroid_motion(const Model& model, const Displacement& u, int material) {
  Vec3<double> sum;
  double volume = 0.0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    if (model.material_of[t] != material) continue;
    for (const int v : model.tets[t]) sum += (0.25 * model.volume[t]) * u[v];
    volume += model.volume[t];
  }
  return (1.0 / volume) * sum;
}

}  // namespace
}  // namespace viscera

int main(int argc, char** argv) {
  using namespace viscera;
  if (argc < 5) {
    return std::fputs("usage: bench_support CSV NU REFERENCE.vtu MESH.vtu…\n", stderr), 2;
  }
  const double nu = std::stod(argv[2]);
  Model reference = liver_tissue(argv[3], nu);
  const double border = lowest(reference);
  hold_above(reference, border);
  const Displacement truth = equilibrium(reference, scene_of(sim::Element::linear, nu), 2).u;
  std::string csv = "mesh,tets,support,element,total_percent";
  for (const auto& name : reference.label_names) csv += "," + name + "_mm";
  csv += "\n";
  for (int i = 4; i < argc; ++i) {
    Model model = liver_tissue(argv[i], nu);
    const bool has_region = model.regions.contains(support);
    hold_above(model, has_region ? lowest(model) : border);
    const Displacement wanted = at_vertices(model, reference, truth), none(wanted.size());
    for (const char* element : {"linear", "smoothed", "quadratic"}) {
      const std::string name = element;
      const auto kind = name == "smoothed" ? sim::Element::smoothed : sim::Element::linear;
      const auto u = equilibrium(model, scene_of(kind, nu), name == "quadratic" ? 2 : 1).u;
      const std::string path = argv[i];
      std::string line = fmt::format("{},{},{},{},{:.3f}", path.substr(path.rfind('/') + 1),
                                     model.tet_count(), has_region ? "region" : "vertices", element,
                                     100.0 * off(model, u, wanted) / off(model, none, wanted));
      for (std::size_t m = 0; m < reference.materials.size(); ++m) {
        const int material = static_cast<int>(m);
        line += fmt::format(",{:.3f}", 1e3 * norm(centroid_motion(model, u, material) -
                                                  centroid_motion(reference, truth, material)));
      }
      fmt::print("{}\n", line);
      std::fflush(stdout);
      csv += line + "\n";
      std::ofstream(argv[1]) << csv;
    }
  }
}
