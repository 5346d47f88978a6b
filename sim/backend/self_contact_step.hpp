// What self-contact does with one pair of a vertex and a triangle, for host and device; equations
// in effects/self_contact.hpp. A Body offers `triangles` and `neighbours`, and of a vertex
// start(v), where it is at the start of the substep (m), motion(v), what it moves over it (m),
// mobility(v), its inverse mass in any unit, and move(v, by).
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "sim/effects/self_contact.hpp"
#include "sim/model/surface_pairs.hpp"

namespace viscera::sim {

struct TouchingPair {
  int vertex, triangle;
  Over over;
  double pushed;  // by how much they were moved apart, m
  // What is the same in all sweeps (prepare): the vertex and the corners, how much of a motion of
  // the vertex relative to the triangle each makes, by inverse masses, and n . (x - sum b y), m.
  int at[4];
  double share[4];  // 0: not moved, as pairs of one round may have it in common
  double apart;
  double least;  // m, how far apart the substep is to end
  double held;   // m, how far in any case: no nearer than it began
};

constexpr int contact_sweeps = 4;  // over all pairs that touch

// How far from a triangle, at the start, a vertex may be that touches it in a substep in which no
// vertex moves more than `motion`: nearer than the thickness when they meet, or at the end under
// the triangle by the thickness and what both have moved. Where a triangle turns over in a substep
// this decides what touches.
SIM_HD double contact_reach(double thickness, double motion) {
  return thickness + 4.0 * motion;
}

// Candidates are the vertices nearer than thickness + margin to a triangle where they were found.
// While `are_known`, whatever touches is among them: `since` is the most that a vertex has moved
// from there, apart from what all have moved alike, and `now` the most in this substep, m.
SIM_HD double margin_of_candidates(double thickness, double now) {
  return thickness > 8.0 * now ? thickness : 8.0 * now;
}
SIM_HD bool are_known(double thickness, double margin, double since, double now) {
  return margin > 0.0 && contact_reach(thickness, now) + 2.0 * since <= thickness + margin;
}

template <class Body>
SIM_HD SurfacePair pair_of(const Body& body, int vertex, int triangle) {
  SurfacePair pair;
  pair.x = body.start(vertex);
  pair.dx = body.motion(vertex);
  for (int j = 0; j < 3; ++j) {
    const int v = body.triangles[triangle][j];
    pair.y[j] = body.start(v);
    pair.dy[j] = body.motion(v);
  }
  return pair;
}

// Whether the vertex ends the substep nearer than `thickness` to an edge or a corner of the
// triangle, outside of the prisms over all triangles that meet there; then `contact` says where.
template <class Body>
SIM_HD bool touch_beside(const Body& body, const SurfacePair& pair, int triangle, double thickness,
                         Over& contact) {
  const Vec3<double> x = pair.x + pair.dx;
  Vec3<double> y[3];
  for (int j = 0; j < 3; ++j) y[j] = pair.y[j] + pair.dy[j];
  const OnTriangle nearest = nearest_with_weights(x, y[0], y[1], y[2]);
  const Vec3<double> away = x - nearest.point;
  const double distance = norm(away);
  if (!(distance > 0.0 && distance < thickness)) return false;
  if (!(dot(cross(y[1] - y[0], y[2] - y[0]), away) > 0.0)) return false;  // from inside
  int ends[2] = {-1, -1}, count = 0;
  for (int j = 0; j < 3; ++j) {
    if (nearest.b[j] == 0.0) continue;
    if (count == 2) return false;  // over the triangle
    ends[count++] = body.triangles[triangle][j];
  }
  const bool outside = body.neighbours.all_of(ends[0], [&](int v) {
    if (count == 2 && !body.neighbours.has(ends[1], v)) return true;
    return dot(away, body.start(v) + body.motion(v) - nearest.point) <= 0.0;
  });
  if (outside) {
    contact = {distance, (1.0 / distance) * away, {nearest.b[0], nearest.b[1], nearest.b[2]}};
  }
  return outside;
}

template <class Body>
SIM_HD bool touch(const Body& body, int vertex, int triangle, double thickness, double reach,
                  Over& contact) {
  const SurfacePair pair = pair_of(body, vertex, triangle);
  return touch(pair, thickness, reach, contact) ||
         touch_beside(body, pair, triangle, thickness, contact);
}

template <class Body>
SIM_HD void prepare(const Body& body, double thickness, TouchingPair& contact) {
  const double* const b = contact.over.b;
  Vec3<double> apart = body.start(contact.vertex);
  double mobility = body.mobility(contact.vertex);
  contact.at[0] = contact.vertex;
  for (int j = 0; j < 3; ++j) {
    const int v = contact.at[j + 1] = body.triangles[contact.triangle][j];
    apart -= b[j] * body.start(v);
    mobility += b[j] * b[j] * body.mobility(v);
  }
  contact.apart = dot(contact.over.normal, apart);
  contact.least = least_distance(contact.apart, thickness);
  contact.held = contact.apart < thickness ? contact.apart : thickness;
  for (int k = 0; k < 4; ++k) {
    const double of_motion = k == 0 ? 1.0 : -b[k - 1];
    contact.share[k] = mobility > 0.0 ? of_motion * body.mobility(contact.at[k]) / mobility : 0.0;
  }
}

// How the vertex moves over the substep, relative to the triangle.
template <class Body>
SIM_HD Vec3<double> slide(const Body& body, const TouchingPair& contact) {
  Vec3<double> relative = body.motion(contact.at[0]);
  for (int j = 0; j < 3; ++j) relative -= contact.over.b[j] * body.motion(contact.at[j + 1]);
  return relative;
}

// Adds `relative` to it.
template <class Body>
SIM_HD void share_out(const Body& body, const TouchingPair& contact, const Vec3<double>& relative) {
  for (int k = 0; k < 4; ++k) {
    if (contact.share[k] != 0.0) body.move(contact.at[k], contact.share[k] * relative);
  }
}

template <class Body>
SIM_HD void keep_apart(const Body& body, TouchingPair& contact, int sweep) {
  const Vec3<double>& n = contact.over.normal;
  // Last that which all pairs can have at once: what leads one apart may have led another together.
  const double distance = sweep + 1 < contact_sweeps ? contact.least : contact.held;
  const double missing = distance - (contact.apart + dot(n, slide(body, contact)));
  if (!(missing > 0.0)) return;
  share_out(body, contact, missing * n);
  contact.pushed += missing;
}

template <class Body>
SIM_HD void resist_slide(const Body& body, const TouchingPair& contact, double friction) {
  const double limit = friction * contact.pushed;
  if (!(limit > 0.0)) return;
  const Vec3<double> relative = slide(body, contact);
  const Vec3<double>& n = contact.over.normal;
  const Vec3<double> along = relative - dot(n, relative) * n;
  const double distance = norm(along);
  share_out(body, contact, (distance > limit ? -limit / distance : -1.0) * along);
}

// Vertices that were held off a triangle.
inline std::size_t count_held(std::span<const TouchingPair> contacts) {
  std::vector<int> held;
  for (const auto& contact : contacts) {
    if (contact.pushed > 0.0) held.push_back(contact.vertex);
  }
  std::ranges::sort(held);
  return std::unique(held.begin(), held.end()) - held.begin();
}

// Who claims a vertex: in a later round and of an earlier pair the less.
using Claim = std::int64_t;
constexpr Claim unclaimed = INT64_MAX;

SIM_HD Claim claim_of(int pair, int round) {
  return pair - (static_cast<Claim>(round) << 32);
}

// Moves pairs apart, one after the other as far as anyone can tell, and returns in how many rounds.
// In a round each pair that still waits claims the vertices that it moves; the earliest claim
// holds, and who holds all of its own is solved. The pairs of a round share no vertex that moves,
// and of two that do the earlier comes first: the result is that of the list in its order, to the
// bit (Blelloch et al., "Internally deterministic parallel algorithms can be fast", PPoPP 2012:
// deterministic reservations). round_of [count] tells the round of each; holder [vertices] is
// `unclaimed` before and after. A Team offers for_each(count, work), work(k) in any order and all
// done on return; any(count, work), whether one of them is true; and lower(a, b), a = min(a, b).
template <class Team, class Body>
SIM_HD int keep_all_apart(const Team& team, const Body& body, TouchingPair* contacts, int count,
                          int* round_of, Claim* holder) {
  constexpr int waits = -1;
  const auto for_each_moved = [contacts](int c, const auto& function) {
    for (int k = 0; k < 4; ++k) {
      if (contacts[c].share[k] != 0.0) function(contacts[c].at[k]);
    }
  };
  team.for_each(count, [&](int c) { round_of[c] = waits; });
  int rounds = 0;
  for (bool left = count > 0; left; ++rounds) {
    team.for_each(count, [&](int c) {
      if (round_of[c] != waits) return;
      for_each_moved(c, [&](int v) { team.lower(holder[v], claim_of(c, rounds)); });
    });
    left = team.any(count, [&](int c) {
      if (round_of[c] != waits) return false;
      bool holds_all = true;
      for_each_moved(c, [&](int v) { holds_all = holds_all && holder[v] == claim_of(c, rounds); });
      if (!holds_all) return true;
      round_of[c] = rounds;
      keep_apart(body, contacts[c], 0);
      return false;
    });
  }
  team.for_each(count, [&](int c) { for_each_moved(c, [&](int v) { holder[v] = unclaimed; }); });
  for (int sweep = 1; sweep < contact_sweeps; ++sweep) {
    for (int round = 0; round < rounds; ++round) {
      team.for_each(count, [&](int c) {
        if (round_of[c] == round) keep_apart(body, contacts[c], sweep);
      });
    }
  }
  return rounds;
}

// Friction, in the same order.
template <class Team, class Body>
SIM_HD void resist_all_slides(const Team& team, const Body& body, const TouchingPair* contacts,
                              int count, double friction, const int* round_of, int rounds) {
  for (int round = 0; round < rounds; ++round) {
    team.for_each(count, [&](int c) {
      if (round_of[c] == round) resist_slide(body, contacts[c], friction);
    });
  }
}

}  // namespace viscera::sim
