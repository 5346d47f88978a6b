// Hangs a body of labels from its upper 20 mm and prints with what force it is held.
// Usage: hanging-body LABELS.nrrd
#include <cstdio>

#include "sim/make.hpp"
#include "sim/measures/forces.hpp"
#include "stages/image/image_io.hpp"
#include "stages/tetmesh/mesher/mesh_job.hpp"

int main(int, char** arguments) {
  using namespace viscera;
  // Labels to tets, 12 mm large.
  MeshRequest request;
  request.labels = read_image(arguments[1]).image;
  const MeshJob job(std::move(request));
  const TetMesh mesh = job.mesh(12.0).mesh;

  // The body, in metres, of one material.
  std::vector<sim::Vec3<double>> points;
  for (const auto& p : mesh.points) points.push_back({1e-3 * p[0], 1e-3 * p[1], 1e-3 * p[2]});
  const sim::Material liver{
      .youngs_modulus = 5e3, .poisson_ratio = 0.45, .density = 1060.0, .damping = 0.05};
  std::map<int, sim::Material> materials;
  for (const auto& [label, name] : job.names()) materials[label] = liver;
  const sim::Model body = sim::make_model(points, mesh.tets, mesh.labels, materials);

  // The effects that the scene calls for, and no others.
  sim::Scene scene;
  scene.params<sim::NeoHookean>() = {{}};
  scene.params<sim::Viscosity>() = {{}};
  scene.params<sim::Gravity>() = {{}};
  sim::Fixed::Params upper;
  upper.side = "superior";
  upper.within = 0.02;
  scene.params<sim::Fixed>() = {upper};

  const auto solver = sim::make_on_cpu(body, scene, {});
  const int frames = 120;  // 2 s: by then it hangs still
  for (int frame = 0; frame < frames; ++frame) solver->advance_frame();

  // What holds the body, N: the negative of what its material does to the held vertices, besides
  // their own weight.
  const auto forces = sim::element_forces(body, scene, solver->state());
  const double gravity = sim::Gravity::Params().acceleration;
  double weight = 0.0, held = 0.0;
  for (const double mass : body.mass) weight += mass * gravity;
  for (const int v : sim::Fixed::vertices(body, upper))
    held += body.mass[v] * gravity - forces[v].z;
  std::printf("%zu tets weigh %.3f N and are held with %.3f N\n", body.tet_count(), weight, held);
}
