// The body with its supports and loads as a static problem that other finite element programs
// solve: what a scene comes to at its end, and nothing of the way there. Units mm, N, t, s, hence
// MPa and t/mm3, as those programs have them.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "sim/base/math.hpp"
#include "sim/model/model.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/simulate/scene/scene_file.hpp"

namespace viscera {

enum class ElasticLaw { neo_hookean, mooney_rivlin, ogden, stvk, linear };

struct StaticProblem {
  struct Label {
    std::string name;
    sim::Material material;  // SI
    std::vector<int> elements;
  };
  struct PushedFace {
    int element, opposite;  // the face, by the corner that it lacks
    double pressure;        // MPa, inwards
  };
  ElasticLaw law = ElasticLaw::neo_hookean;
  double law_shape = 0.0;  // mooney_rivlin: C01 / (C10 + C01); ogden: the exponent
  // mm, LPS: the mesh's points, then the middles of edges where elements have ten nodes.
  std::vector<std::array<double, 3>> nodes;
  int element_nodes = 4;                      // or 10
  std::vector<std::array<int, 10>> elements;  // of each the first `element_nodes`
  std::map<int, Label> labels;
  std::map<int, sim::Vec3<double>> held;    // node: its displacement, mm
  sim::Vec3<double> gravity;                // mm/s2
  std::map<int, sim::Vec3<double>> forces;  // node: N, of constant size and direction
  std::map<int, double> beds;               // node: N/mm towards its place at rest
  std::vector<PushedFace> pushed;           // pressure follows the face
};

// Of the scene with the effects that act at its end, on linear tets, or on quadratic ones where the
// scene's elements are smoothed or quadratic. Throws sim::Refusal for effects that no static
// problem of these kinds has: obstacles and contact, and laws that other programs lack.
StaticProblem static_problem(const SceneFile& file, const TetMesh& mesh, const sim::Model& model);

struct SceneFormat {
  const char* name;
  const char* file;
  const char* doc;
  void (*write)(const std::filesystem::path&, const StaticProblem&);
};
const std::vector<SceneFormat>& scene_formats();

// Throw sim::Refusal for what the format or its program lacks.
void write_scene_inp(const std::filesystem::path& path, const StaticProblem& problem);
void write_scene_feb(const std::filesystem::path& path, const StaticProblem& problem);

}  // namespace viscera
