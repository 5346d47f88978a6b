// A liver-like body given by formulas, so that its volumes can be computed to any accuracy: two
// lobes blended into a wedge with a hollowed underside, two ellipsoidal tumours, and a vessel tree
// of tapering segments under Murray's law. About 20 x 15 x 12 cm and 1.4 l, LPS millimetres.
//
// Only + - * / and square roots are used: every IEEE machine draws the same volume.
#pragma once

#include <array>
#include <vector>

namespace viscera::phantom {

using Point = std::array<double, 3>;

enum Label : int { background = 0, liver = 1, tumour = 2, vessels = 3 };

struct Ellipsoid {
  Point centre, radii;  // mm
};
struct Segment {
  Point from, to;
  double radius_from, radius_to;  // mm
};

// Where the phantom stands in LPS space.
inline constexpr Point centre{-62.0, -14.0, 846.0};

const std::array<Ellipsoid, 2>& tumours();  // about `centre`
const std::vector<Segment>& vessel_tree();  // about `centre`

// Signed value of the body at `p` (about `centre`): negative inside, about a distance in mm.
double body(const Point& p);

// The label at an LPS position. Tumours cut vessels, vessels cut the liver.
Label label_at(const Point& lps);

}  // namespace viscera::phantom
