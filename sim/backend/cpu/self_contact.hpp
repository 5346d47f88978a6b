// Self-contact on the CPU. Pairs are looked for side by side and solved one after the other, in the
// order of their triangles and vertices: any number of threads gives the same bits. Candidates stay
// valid while no vertex has moved too far for their margin, apart from what all have moved alike;
// which pairs touch is decided anew in every substep and does not depend on when the candidates
// were found. They are kept by their distance, so that a substep looks at the nearest alone.
#pragma once

#include <algorithm>

#include "sim/backend/cpu/elements.hpp"
#include "sim/backend/self_contact_step.hpp"
#include "sim/base/team.hpp"

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
        found_at_(rest_.size()) {}

  template <class Effect>
  void retune(const Prepared<Effect, T>& prepared) {
    friction_ = prepared.params.friction;
  }

  // By all of the team, after the elements: holds surfaces apart, and resists their slide.
  void separate(Team& team, int rank, const std::vector<Row<T>>& u, std::vector<Row<T>>& d) {
    const Body body = body_of(u, d);
    if (rank == 0) {
      own_.resize(team.size());
      moved_.resize(team.size());
      // Others are not shared out among these threads.
      if (candidates_.size() != static_cast<std::size_t>(team.size())) margin_ = 0.0;
      candidates_.resize(team.size());
    }
    team.barrier();
    const Moved moved = look_for_candidates(team, rank, body);
    const double reach = contact_reach(thickness_, moved.now);
    const double reached_then = reach + 2.0 * moved.since;
    own_[rank].clear();
    for (const auto& [then, triangle, vertex] : candidates_[rank]) {
      if (then > reached_then) break;
      TouchingPair contact{vertex, triangle, {}, 0.0};
      if (!touch(body, vertex, triangle, thickness_, reach, contact.over)) continue;
      prepare(body, thickness_, contact);
      own_[rank].push_back(contact);
    }
    std::ranges::sort(own_[rank], {}, [](const TouchingPair& pair) {
      return std::pair(pair.triangle, pair.vertex);
    });
    team.barrier();
    if (rank == 0) {
      contacts_.clear();
      for (const auto& part : own_) contacts_.insert(contacts_.end(), part.begin(), part.end());
      for (int sweep = 0; sweep < contact_sweeps; ++sweep) {
        for (auto& contact : contacts_) keep_apart(body, contact, sweep);
      }
      for (const auto& contact : contacts_) resist_slide(body, contact, friction_);
    }
    team.barrier();
  }

  // Vertices that were held off a triangle in the last substep.
  std::size_t count() const { return count_held(contacts_); }

 private:
  struct Body {
    const Triangle* triangles;
    Neighbours neighbours;
    const Vec3<double>* rest;
    const Row<T>* u;
    Row<T>* d;

    Vec3<double> start(int v) const { return rest[v] + cast<double>(u[v].v); }
    Vec3<double> motion(int v) const { return cast<double>(d[v].v); }
    double mobility(int v) const { return static_cast<double>(d[v].w); }
    void move(int v, const Vec3<double>& by) const { d[v].v += cast<T>(by); }
  };

  Body body_of(const std::vector<Row<T>>& u, std::vector<Row<T>>& d) const {
    const Neighbours neighbours{pairs_.neighbours().data(), pairs_.neighbours_begin().data()};
    return {pairs_.triangles().data(), neighbours, rest_.data(), u.data(), d.data()};
  }

  struct Candidate {
    double distance;  // m, when it was found
    int triangle, vertex;
    auto operator<=>(const Candidate&) const = default;
  };
  struct Moved {
    double since = 0.0;  // from where candidates were found, less what all have moved alike, m
    double now = 0.0;    // in this substep
  };

  // Returns the most that vertices have moved.
  Moved look_for_candidates(Team& team, int rank, const Body& body) {
    const auto& vertices = pairs_.vertices();
    const Range mine = part_of({0, static_cast<int>(vertices.size())}, rank, team.size());
    // All distances are as they were where all have moved as the first one has.
    const int first = vertices.front();
    const Vec3<double> alike = body.start(first) - found_at_[first];
    Moved own;
    for (int k = mine.begin; k < mine.end; ++k) {
      const int v = vertices[k];
      starts_[v] = body.start(v);
      own.since = std::max(own.since, norm(starts_[v] - found_at_[v] - alike));
      own.now = std::max(own.now, norm(body.motion(v)));
    }
    moved_[rank] = own;
    team.barrier();
    Moved all;
    for (const auto& part : moved_) {
      all.since = std::max(all.since, part.since);
      all.now = std::max(all.now, part.now);
    }
    if (are_known(thickness_, margin_, all.since, all.now)) return all;
    team.barrier();  // all have read the margin
    if (rank == 0) {
      margin_ = margin_of_candidates(thickness_, all.now);
      found_at_ = starts_;
      pairs_.place(found_at_, thickness_ + margin_);
    }
    team.barrier();
    const Range all_triangles = {0, static_cast<int>(pairs_.triangles().size())};
    const Range triangles = part_of(all_triangles, rank, team.size());
    auto& found = candidates_[rank];
    found.clear();
    std::vector<int> near;
    for (int t = triangles.begin; t < triangles.end; ++t) {
      pairs_.find(found_at_, t, near);
      const auto& [a, b, c] = pairs_.triangles()[t];
      const auto& at = found_at_;
      for (const int v : near) {
        const double distance = norm(at[v] - nearest_on_triangle(at[v], at[a], at[b], at[c]));
        if (distance <= thickness_ + margin_) found.push_back({distance, t, v});
      }
    }
    std::ranges::sort(found);
    team.barrier();
    return {0.0, all.now};
  }

  SurfacePairs pairs_;
  std::vector<Vec3<double>> rest_;
  double thickness_, friction_;
  double margin_ = 0.0;                 // m; 0: candidates were never looked for
  std::vector<Vec3<double>> starts_;    // [n] of the surface's vertices, in this substep, m
  std::vector<Vec3<double>> found_at_;  // [n] where candidates were found, m
  std::vector<std::vector<Candidate>> candidates_;  // [threads] of its triangles
  std::vector<Moved> moved_;                        // [threads]
  std::vector<std::vector<TouchingPair>> own_;      // [threads] of its triangles
  std::vector<TouchingPair> contacts_;              // of this substep
};

}  // namespace viscera::sim
