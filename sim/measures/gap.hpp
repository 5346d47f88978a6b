// How far a part of the body is from an obstacle or from another part.
#pragma once

#include <string>
#include <vector>

#include "sim/model/probe.hpp"
#include "sim/model/surface.hpp"
#include "sim/scene/scene.hpp"

namespace viscera::sim {

// Names of a scene's obstacles, which are its effects of contact, as name_of() has them.
std::vector<std::string> obstacles_of(const Scene& scene);

// What belongs to one of the model's materials, in order; `vertices` are all of it or those of its
// surface, which is where it meets another material or nothing.
struct BodyPart {
  std::vector<int> vertices;
  std::vector<Triangle> faces = {};  // of its surface
  std::vector<int> tets = {};
};

// A quantity that a reader asks for, beside the Probe of model/probe.hpp: no mean of vertices.
struct GapProbe {
  std::string name;
  BodyPart part;
  std::string obstacle;  // of obstacles_of(); empty: the other part
  BodyPart other;
};

// Between a material and an obstacle, and between two materials. The latter throws Refusal (scene)
// where they share a vertex: between these there is none.
GapProbe gap_probe(const Model& model, const std::string& name, int material,
                   const std::string& obstacle);
GapProbe gap_probe(const Model& model, const std::string& name, int material, int other);

struct Gap {
  double distance;  // m; negative: inside of the obstacle or of the other part, at the deepest
  // The vertex that is nearest to the obstacle; or the vertex of one part that is nearest to the
  // other and, with negative weights, the point there: the mean of displacements so weighted is
  // what has changed the gap.
  std::vector<Probe::Part> nearest;
};

// With displacements u, [n] m, at a time, s. Looked for among the vertices of a part: of an
// obstacle faces between them may be nearer by no more than its curvature over an edge, of two
// parts edges that pass one another.
Gap gap_now(const Model& model, const Scene& scene, const GapProbe& probe,
            const std::vector<Vec3<double>>& u, double time);

}  // namespace viscera::sim
