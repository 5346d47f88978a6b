// Von Mises stress of Neo-Hookean tissue, from where its points are: what the viewer colours by.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "pipeline/base/param.hpp"
#include "sim/base/math.hpp"
#include "sim/model/material.hpp"
#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

using Tissue = std::map<std::string, sim::Lame>;  // by label name

// Of a scene (scene.json). Empty where stresses cannot be told from it: another law than
// Neo-Hookean (or others beside it on some tets), E measured tet by tet, materials that change on
// the way. `where`: the scene's file; `simulate`: the manifest of the run. Either JSON may be null.
// Throws Error(bad_input) for what is no scene.
Tissue tissue_of(const Json& scene, const std::string& where, const Json& simulate);

class VonMises {
 public:
  // Throws std::out_of_range for a label without tissue.
  VonMises(const TetMesh& mesh, const Tissue& tissue);

  // Of Cauchy's stress in every tet, kPa; `xyz` mm, three a point. With P of
  // effects/laws/neo_hookean.hpp, sigma = P F^T / J. Fibres, viscosity and Prony branches are not
  // in it. 0 for a tet inside out.
  std::vector<double> operator()(const std::vector<double>& xyz) const;

 private:
  struct Tet {
    sim::Mat3<double> rest_inverse;  // 1/mm
    sim::Lame lame;                  // Pa
  };
  const TetMesh& mesh_;
  std::vector<Tet> tets_;
};

}  // namespace viscera
