// How far apart two motions are, in mm: on one mesh vertex by vertex, between two meshes of one
// body at the vertices of the first, with the displacement of the second interpolated there.
#pragma once

#include <limits>
#include <map>
#include <memory>
#include <string>

#include "stages/trajectory/trajectory_io.hpp"

namespace viscera {

struct Distance {
  double rms = 0.0;      // weighted by volume, over frames
  double largest = 0.0;  // of any vertex in any frame
  double end = 0.0;      // of any vertex in the last frame
  // Of the displacement of the label's centroid in any frame; not a number where none is asked for
  // or one of the two has no such label.
  double centroid = std::numeric_limits<double>::quiet_NaN();
};

enum class Span { history, end };  // every frame of equal time, or the last of each

// Interpolation between meshes is kept from one call to the next, by mesh.
class DistanceBetween {
 public:
  // `centroid`: the label whose centroid is followed; "": none.
  explicit DistanceBetween(std::string centroid = "") : centroid_(std::move(centroid)) {}

  // Not finite when the first lacks a frame of the second (it did not get there) or has it at
  // another time. For `end` the history is that of one frame.
  Distance operator()(const TrajectoryReader& of, const TrajectoryReader& reference, Span span);

 private:
  struct Place {
    int tet = 0;
    std::array<double, 4> weights{};
  };
  const std::vector<Place>& places(const TetMesh& of, const TetMesh& in);
  std::map<std::pair<std::string, std::string>, std::vector<Place>> known_;
  std::string centroid_;
};

// The largest displacement of any vertex in any frame, mm.
double largest_displacement(const TrajectoryReader& trajectory);

}  // namespace viscera
