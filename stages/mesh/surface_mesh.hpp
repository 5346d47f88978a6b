// Closed triangle surfaces as stages pass them on: plain arrays, LPS millimetres.
//
// One closed, outward-oriented surface per label; surfaces of neighbouring labels run side by side
// and share no points. Where a volume has several labels, the surface of the whole body stands
// beside them under id 0.
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

namespace viscera {

inline constexpr int body_label = 0;

struct SurfaceMesh {
  std::vector<std::array<double, 3>> points;  // mm
  std::vector<std::array<int, 3>> triangles;  // counter-clockwise seen from outside
  std::vector<int> labels;                    // one per triangle
  std::map<int, std::string> label_names;
};

// The triangles of one label with the points they use, in their order.
SurfaceMesh extract(const SurfaceMesh& surface, int label);

void append(SurfaceMesh& surface, const SurfaceMesh& part);

struct SurfaceCheck {
  std::size_t open_edges = 0;          // with one triangle
  std::size_t non_manifold_edges = 0;  // with more than two
  std::size_t misoriented_edges = 0;   // run through twice in one direction
  std::size_t degenerate = 0;          // triangles of an area below 1e-10 mm2
  std::size_t shells = 0;
  double volume = 0.0;  // signed, mm3
  double area = 0.0;    // mm2
};

SurfaceCheck check(const SurfaceMesh& surface);

// Cross product of two edges: twice the area, along the outward normal.
std::array<double, 3> doubled_area_normal(const SurfaceMesh& surface, const std::array<int, 3>& t);

double enclosed_volume(const SurfaceMesh& surface);  // signed, mm3

struct Shell {
  double volume = 0.0;            // signed, mm3: negative around a cavity
  std::array<double, 3> place{};  // its first point
  std::vector<int> triangles;
};

// Connected pieces, in the order of their first triangles.
std::vector<Shell> find_shells(const SurfaceMesh& surface);

}  // namespace viscera
