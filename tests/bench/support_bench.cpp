// What a support's border costs: bodies at rest by Newton's method, held where the mesh has a
// region `support` or, in meshes without it, by the vertices that lie in it, off quadratic tets on
// the first mesh, which must have the region.
//   bench_support CSV NU REFERENCE.vtu MESH.vtu…     gravity along +y
// Where there is a CUDA device smoothed elements are brought to rest by XPBD in blocks, too, with
// milliseconds a frame; Cs may be above the policy's limit.
// Errors are root mean squares over the mass, in percent of the displacement's, of the displacement
// at vertices; that of the reference is interpolated there. Also how far the centroid of each
// material is off, mm.
#include <cstdio>
#include <fstream>

#include "sim/make.hpp"
#include "sim/measures/stability.hpp"
#include "tests/bench/bodies.hpp"

namespace viscera {
namespace {

using sim::Model, sim::State, sim::Vec3;
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

// Of one mesh after another, all against the truth on the first.
class Bench {
 public:
  Bench(const char* csv, const char* reference, double nu)
      : path_(csv), nu_(nu), reference_(liver_tissue(reference, nu)), border_(lowest(reference_)) {
    hold_above(reference_, border_);
    truth_ = equilibrium(reference_, scene_of(sim::Element::linear, nu), 2).u;
    csv_ = "mesh,tets,support,element,substeps,Cs,ms_frame,total_percent";
    for (const auto& name : reference_.label_names) csv_ += "," + name + "_mm";
    csv_ += "\n";
  }

  void mesh(const std::string& path) {
    Model model = liver_tissue(path.c_str(), nu_);
    const bool has_region = model.regions.contains(support);
    hold_above(model, has_region ? lowest(model) : border_);
    const std::string name = fmt::format("{},{},{}", path.substr(path.rfind('/') + 1),
                                         model.tet_count(), has_region ? "region" : "vertices");
    const Displacement wanted = at_vertices(model, reference_, truth_);
    for (const char* element : {"linear", "smoothed", "quadratic"}) {
      const bool smoothed = element == std::string("smoothed");
      const sim::Scene scene =
          scene_of(smoothed ? sim::Element::smoothed : sim::Element::linear, nu_);
      const State rest = equilibrium(model, scene, element == std::string("quadratic") ? 2 : 1);
      row(fmt::format("{},{},,,", name, element), model, rest.u, wanted);
      if (smoothed && sim::find_cuda_device().name) xpbd(name, model, wanted);
    }
  }

 private:
  // From where nothing is deformed: single tets that Newton's method leaves inside out would not be
  // brought back.
  void xpbd(const std::string& name, const Model& model, const Displacement& wanted) {
    const Displacement none(wanted.size());
    for (const int substeps : {16, 32, 64, 128}) {
      const sim::Scene scene = scene_of(sim::Element::smoothed, nu_, substeps);
      const auto solver =
          make_on_cuda(model, scene, {.scheme = sim::Scheme::block_gauss_seidel, .threads = 1});
      const auto [state, ms] = rest_from(*solver, {none, none}, 500);
      row(fmt::format("{},smoothed,{},{:.2f},{:.3f}", name, substeps,
                      assess(model, scene).limit.value, Times::of(ms).median),
          model, state.u, wanted);
    }
  }

  void row(std::string line, const Model& model, const Displacement& u,
           const Displacement& wanted) {
    const Displacement none(wanted.size());
    line += fmt::format(",{:.3f}", 100.0 * off(model, u, wanted) / off(model, none, wanted));
    for (std::size_t m = 0; m < reference_.materials.size(); ++m) {
      const int material = static_cast<int>(m);
      line += fmt::format(",{:.3f}", 1e3 * norm(centroid_motion(model, u, material) -
                                                centroid_motion(reference_, truth_, material)));
    }
    fmt::print("{}\n", line);
    std::fflush(stdout);
    csv_ += line + "\n";
    std::ofstream(path_) << csv_;
  }

  const char* path_;
  double nu_;
  Model reference_;
  double border_;  // of the support, z in m
  Displacement truth_;
  std::string csv_;
};

}  // namespace
}  // namespace viscera

int main(int argc, char** argv) {
  if (argc < 5) {
    return std::fputs("usage: bench_support CSV NU REFERENCE.vtu MESH.vtu…\n", stderr), 2;
  }
  viscera::Bench bench(argv[1], argv[3], std::stod(argv[2]));
  for (int i = 4; i < argc; ++i) bench.mesh(argv[i]);
}
