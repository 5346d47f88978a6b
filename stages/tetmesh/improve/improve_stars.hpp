// The mesh while it is being improved: tets that come and go, and around every point the list of
// its tets, from which everything else (rings of edges, neighbours) is found on demand.
#pragma once

#include <limits>
#include <utility>
#include <vector>

#include "stages/tetmesh/improve/improve.hpp"

namespace viscera {

using Tet = std::array<int, 4>;

// By how much a change must raise the quality that it is judged by: less is rounding.
inline constexpr double min_gain = 1e-9;

// A tet that stands on an edge (a, b), seen along the edge: the arc of its two other corners in
// the sense that makes (a, b, from, to) positive.
struct Arc {
  int tet, from, to, label;
};

struct Ring {
  std::vector<Arc> arcs;  // arcs[i].to == arcs[i + 1].from
  bool closed = false;    // else the edge is on the boundary
};

// Tets side by side, judged in one go.
struct TetLanes {
  static constexpr int count = 24;
  alignas(64) double corner[4][3][count];
  alignas(64) double size[count], quality[count];
};
void judge(TetLanes& lanes, int filled);  // sets `quality` of the first so many

// The qualities around a point at another place, in the order of its star. For one point.
struct Trial {
  std::vector<double> quality;
  std::size_t objector = 0;  // in the star: the last tet that fell below the bar
};

class Stars {
 public:
  Stars(const TetMesh& mesh, const Projector& project, const ImproveOptions& options = {});

  // The tets that are left and their points, in order of first use.
  void extract(TetMesh& mesh) const;

  const std::vector<Tet>& tets() const { return tets_; }
  bool alive(int tet) const { return tets_[tet][0] >= 0; }
  int label(int tet) const { return labels_[tet]; }
  double quality(int tet) const { return quality_[tet]; }
  const std::vector<Vec>& points() const { return points_; }
  const std::vector<int>& star(int point) const { return stars_[point]; }
  double size(int point) const { return sizes_[point]; }
  const Projector& project() const { return project_; }
  bool on_boundary(int point) const { return boundary_[point]; }

  // Quality of a tet that may not exist, and of one whose corner `point` were at `place`.
  double quality_of(const Tet& tet) const;
  double quality_at(const Tet& tet, int point, const Vec& place) const;
  void fill(TetLanes& lanes, int lane, int tet, int point, const Vec& place) const;
  double worst(const std::vector<int>& tets) const;
  double mean(const std::vector<int>& tets) const;

  // Whether a point that is busy, or would be, gets more tets by this change.
  bool crowds(const std::vector<int>& old, const std::vector<std::pair<Tet, int>>& fresh) const;
  bool is_busy(int point, int more = 0) const {
    return static_cast<int>(stars_[point].size()) + more > valence_;
  }

  // The labels that meet at a point, ascending, 0 first on the boundary.
  std::vector<int> labels_at(int point) const;
  // Whether it may move at all: where several labels meet, only points that began on their surface.
  bool movable(int point) const { return movable_[point]; }

  // The tets on an edge in order; no arcs when there are none or they do not form one chain.
  Ring ring(int a, int b) const;
  bool has_edge(int a, int b) const;
  std::vector<int> neighbours(int point) const;  // ascending

  // Counts up with every change to the tets around a point.
  long stamp(int point) const { return stamps_[point]; }
  long now() const { return now_; }

  int insert(const Vec& place, double size);  // a point of no tets yet, inside a material
  void drop_last_point();                     // which no tet may use
  // Whether no quality around `point` falls below `bar`, were it at `place`; and to go there.
  bool try_at(int point, const Vec& place, double bar, Trial& trial) const;
  void move(int point, const Vec& place, const Trial& trial);
  // Takes `old` out and puts the new tets in.
  void replace(const std::vector<int>& old, const std::vector<std::pair<Tet, int>>& fresh);

 private:
  std::vector<Vec> points_;
  std::vector<Tet> tets_;  // first corner -1 when removed
  std::vector<int> labels_;
  std::vector<double> quality_;
  std::vector<std::vector<int>> stars_;
  std::vector<double> sizes_;  // mm
  std::vector<char> boundary_, movable_;
  std::vector<long> stamps_;
  long now_ = 0;
  int valence_;  // tets around a point beyond which changes avoid to go
  const Projector& project_;
};

inline bool holds(const Tet& tet, int point) {
  return tet[0] == point || tet[1] == point || tet[2] == point || tet[3] == point;
}

// How far a surface may give way to a change that mends tets of this quality: the cosine between a
// triangle's normals, and the distance from the surface in parts of the local size, unless it was
// farther before. Facets of a refined mesh are 0.1 of it away too.
struct Leeway {
  double cosine, distance;
};
inline Leeway leeway(double quality) {
  return quality < 0.28 ? Leeway{0.7, 0.15} : Leeway{0.9, 0.05};
}

// A triangle of the boundary or of an interface at some point: its two other corners, and the
// labels on its sides, both ascending.
struct SurfaceFacet {
  std::array<int, 2> ends, labels;
};
std::vector<SurfaceFacet> surface_facets(const Stars& mesh, int point);

// Whether the facets around `point` stay as near to their surfaces as they have to if it goes to
// `contact`.
bool surface_follows(const Stars& mesh, int point, const Contact& contact);

constexpr double no_quality = std::numeric_limits<double>::max();  // of no tets at all

// A change that mends nothing worse than this must not crowd a point.
constexpr double crowding_bar = 0.28;

// The operations. Each makes the change and returns true only when the worst quality of the tets
// that it touches rises (by more than rounding).
bool remove_edge(Stars& mesh, int a, int b);
bool flip_face(Stars& mesh, int tet, int corner);  // the face opposite that corner: two tets to 3
bool smooth(Stars& mesh, int point);
bool collapse_edge(Stars& mesh, int gone, int kept);  // moves `gone` onto `kept`
bool split_edge(Stars& mesh, int a, int b);  // inside one material; the new point is smoothed first

// Takes the point out onto a neighbour that is too close; no quality falls below `floor`, or below
// what it is.
bool thin_out(Stars& mesh, int point, const Thinning& thinning, double floor);

// These raise the mean quality of the tets that they touch, while the worst of them stays above
// `floor` or does not fall.
bool settle(Stars& mesh, int point, double floor);
bool swap_edge(Stars& mesh, int a, int b, double floor);

// Moves the surface of a label (0: the boundary of all) outwards as far as the label lacks volume
// (mm3), everywhere alike, or in a graded mesh by the square of the local size; no quality falls
// below `floor`, or below what it is. Of a label's surface that part moves which it shares with the
// labels `beside`.
void fit_volume(Stars& mesh, int label, const std::vector<int>& beside, double wanted, double floor,
                bool graded);

// These take tets from a busy point, as long as the worst quality they touch stays above `floor`:
// by removing one of its edges, or by a new point beside it that takes over part of its star.
bool relieve(Stars& mesh, int point, double floor);
bool share_star(Stars& mesh, int point, double floor);

}  // namespace viscera
