// Self-contact on the CPU. Pairs are looked for side by side and solved one after the other, in the
// order of their triangles and vertices: any number of threads gives the same bits. Candidates stay
// valid while no vertex has moved too far for their margin; which pairs touch is decided anew in
// every substep and does not depend on when the candidates were found.
#pragma once

#include <algorithm>

#include "sim/backend/cpu/elements.hpp"
#include "sim/backend/cpu/team.hpp"
#include "sim/backend/self_contact_step.hpp"

namespace viscera::sim {

template <class T>
class CpuSelfContact {
 public:
  template <class Effect>
  CpuSelfContact(const Prepared<Effect, T>& prepared, const ElementLayout<T>&)
      : pairs_(prepared.pairs),
        rest_(prepared.rest),
        thickness_(prepared.params.thickness),
        friction_(prepared.params.friction),
        starts_(rest_.size()),
        found_at_(rest_.size()),
        candidates_(pairs_.triangles().size()) {}

  template <class Effect>
  void retune(const Prepared<Effect, T>& prepared) {
    friction_ = prepared.params.friction;
  }

  // By all of the team, before the elements: leads d out.
  void push(Team& team, int rank, const std::vector<Row<T>>& u, std::vector<Row<T>>& d) {
    separate(team, rank, thickness_, contacts_, u, d);
  }

  // By all of the team, after the elements: friction, and what must be kept in any case.
  void rub(Team& team, int rank, const std::vector<Row<T>>& u, std::vector<Row<T>>& d) {
    if (rank == 0) {
      for (const auto& contact : contacts_) resist_slide(body_of(u, d), contact, friction_);
    }
    team.barrier();
    separate(team, rank, 0.5 * thickness_, last_, u, d);
  }

  // Vertices that were held off a triangle in the last substep.
  std::size_t count() const { return count_held(contacts_); }

 private:
  struct Body {
    const Triangle* triangles;
    const Vec3<double>* rest;
    const Row<T>* u;
    Row<T>* d;

    Vec3<double> start(int v) const { return rest[v] + cast<double>(u[v].v); }
    Vec3<double> motion(int v) const { return cast<double>(d[v].v); }
    double mobility(int v) const { return static_cast<double>(d[v].w); }
    void move(int v, const Vec3<double>& by) const { d[v].v += cast<T>(by); }
  };

  // Finds what comes nearer than `distance`, into `contacts`, and moves it apart.
  void separate(Team& team, int rank, double distance, std::vector<TouchingPair>& contacts,
                const std::vector<Row<T>>& u, std::vector<Row<T>>& d) {
    const Body body = body_of(u, d);
    if (rank == 0) {
      own_.resize(team.size());
      moved_.resize(team.size());
    }
    team.barrier();
    const double reach = contact_reach(thickness_, look_for_candidates(team, rank, body));
    const Range mine = part_of(all_triangles(), rank, team.size());
    own_[rank].clear();
    for (int t = mine.begin; t < mine.end; ++t) {
      if (candidates_[t].empty()) continue;
      const auto& [a, b, c] = pairs_.triangles()[t];
      const Bounds box(starts_[a], starts_[b], starts_[c], reach);
      for (const int vertex : candidates_[t]) {
        if (!box.holds(starts_[vertex])) continue;
        TouchingPair contact{vertex, t, {}, 0.0};
        if (touch(pair_of(body, vertex, t), distance, contact.over)) own_[rank].push_back(contact);
      }
    }
    team.barrier();
    if (rank == 0) {
      contacts.clear();
      for (const auto& part : own_) contacts.insert(contacts.end(), part.begin(), part.end());
      for (int sweep = 0; sweep < contact_sweeps; ++sweep) {
        for (auto& contact : contacts) keep_apart(body, contact, distance);
      }
    }
    team.barrier();
  }

  Range all_triangles() const { return {0, static_cast<int>(candidates_.size())}; }

  Body body_of(const std::vector<Row<T>>& u, std::vector<Row<T>>& d) const {
    return {pairs_.triangles().data(), rest_.data(), u.data(), d.data()};
  }

  // Returns the most that a vertex moves in this substep, m.
  double look_for_candidates(Team& team, int rank, const Body& body) {
    const auto& vertices = pairs_.vertices();
    const Range mine = part_of({0, static_cast<int>(vertices.size())}, rank, team.size());
    Moved own;
    for (int k = mine.begin; k < mine.end; ++k) {
      const int v = vertices[k];
      starts_[v] = body.start(v);
      own.since = std::max(own.since, norm(starts_[v] - found_at_[v]));
      own.now = std::max(own.now, norm(body.motion(v)));
    }
    moved_[rank] = own;
    team.barrier();
    Moved all;
    for (const auto& part : moved_) {
      all.since = std::max(all.since, part.since);
      all.now = std::max(all.now, part.now);
    }
    // What may touch now, vertex and triangle both having moved, was found then.
    const bool known = contact_reach(thickness_, all.now) + 2.0 * all.since <= thickness_ + margin_;
    if (margin_ > 0.0 && known) return all.now;
    team.barrier();  // all have read the margin
    if (rank == 0) {
      margin_ = std::max(2.0 * thickness_, 8.0 * all.now);
      found_at_ = starts_;
      pairs_.place(found_at_, thickness_ + margin_);
    }
    team.barrier();
    const Range triangles = part_of(all_triangles(), rank, team.size());
    for (int t = triangles.begin; t < triangles.end; ++t) {
      pairs_.find(found_at_, t, candidates_[t]);
    }
    team.barrier();
    return all.now;
  }

  struct Moved {
    double since = 0.0;  // from where candidates were found, m
    double now = 0.0;    // in this substep
  };

  SurfacePairs pairs_;
  std::vector<Vec3<double>> rest_;
  double thickness_, friction_;
  double margin_ = 0.0;                         // m; 0: candidates were never looked for
  std::vector<Vec3<double>> starts_;            // [n] of the surface's vertices, in this substep, m
  std::vector<Vec3<double>> found_at_;          // [n] where candidates were found, m
  std::vector<std::vector<int>> candidates_;    // [triangles] vertices, ascending
  std::vector<Moved> moved_;                    // [threads]
  std::vector<std::vector<TouchingPair>> own_;  // [threads] of its triangles
  std::vector<TouchingPair> contacts_, last_;   // of this substep, before and after the elements
};

}  // namespace viscera::sim
