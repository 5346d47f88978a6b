// What a window shows of a body, without drawing it: the surface of each material, and values of a
// state on its vertices.
#pragma once

#include "stages/live/session.hpp"

namespace viscera::live {

struct Surface {
  std::string name;                  // of the material
  std::vector<sim::Triangle> faces;  // to the outside and, but for the outermost, to the others
};
struct Surfaces {
  std::vector<Surface> all;  // one for every material of the model, in its order
  std::size_t outermost;     // that with the largest share of the body's surface
};
Surfaces surfaces_of(const sim::Model& model);

enum class Measure { material, displacement, stress, volume };

struct MeasureInfo {
  const char* title;
  const char* unit;
};
MeasureInfo info_of(Measure measure);
Measure next_of(Measure measure);

// Values on the vertices of the surfaces, in the unit of info_of(); those of tets are averaged by
// their volume at rest.
class Measurer {
 public:
  Measurer(const sim::Model& body, const Surfaces& surfaces);
  // [vertices]; 0 where no surface is, and everywhere for Measure::material.
  std::vector<float> measure(Measure measure, const Snapshot& snapshot);

 private:
  double of_tet(Measure measure, const Snapshot& snapshot, std::size_t tet) const;

  sim::Model body_;                // with the materials of the snapshot
  std::vector<std::size_t> tets_;  // that have a vertex on a surface
};

// Normals of unit length on the vertices of a surface, by area; 0 elsewhere. x, y, z, mm or any.
std::vector<float> normals_of(const std::vector<sim::Triangle>& faces,
                              const std::vector<float>& positions);

}  // namespace viscera::live
