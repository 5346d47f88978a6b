// Self-contact on the CPU. Pairs are looked for side by side and solved one after the other, in the
// order of their triangles and vertices: any number of threads gives the same bits. Candidates stay
// valid until a vertex has moved half of their margin; which pairs touch is decided anew in every
// substep and does not depend on when the candidates were found.
#pragma once

#include <algorithm>

#include "sim/backend/cpu_elements.hpp"
#include "sim/backend/team.hpp"
#include "sim/effects/self_contact.hpp"

namespace viscera::sim {

template <class T>
class CpuSelfContact {
 public:
  template <class Effect>
  CpuSelfContact(const Prepared<Effect, T>& prepared, const ElementLayout&)
      : pairs_(prepared.pairs),
        rest_(prepared.rest),
        thickness_(prepared.params.thickness),
        friction_(prepared.params.friction),
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
      for (const auto& contact : contacts_) resist_slide(contact, u, d);
    }
    team.barrier();
    separate(team, rank, 0.5 * thickness_, last_, u, d);
  }

  // Vertices that were held off a triangle in the last substep.
  std::size_t count() const {
    std::vector<int> held;
    for (const auto& contact : contacts_) {
      if (contact.pushed > 0.0) held.push_back(contact.vertex);
    }
    std::ranges::sort(held);
    return std::unique(held.begin(), held.end()) - held.begin();
  }

 private:
  struct Contact {
    int vertex, triangle;
    Over over;
    double pushed;  // m
  };

  // Finds what comes nearer than `distance`, into `contacts`, and moves it apart.
  void separate(Team& team, int rank, double distance, std::vector<Contact>& contacts,
                const std::vector<Row<T>>& u, std::vector<Row<T>>& d) {
    constexpr int sweeps = 4;
    if (rank == 0) {
      own_.resize(team.size());
      moved_.resize(team.size());
    }
    team.barrier();
    look_for_candidates(team, rank, u, d);
    const Range mine = part_of(all_triangles(), rank, team.size());
    own_[rank].clear();
    for (int t = mine.begin; t < mine.end; ++t) {
      for (const int vertex : candidates_[t]) {
        Contact contact{vertex, t, {}, 0.0};
        if (touch(pair(contact, u, d), distance, contact.over)) own_[rank].push_back(contact);
      }
    }
    team.barrier();
    if (rank == 0) {
      contacts.clear();
      for (const auto& part : own_) contacts.insert(contacts.end(), part.begin(), part.end());
      for (int sweep = 0; sweep < sweeps; ++sweep) {
        for (auto& contact : contacts) contact.pushed += keep_apart(contact, distance, u, d);
      }
    }
    team.barrier();
  }

  Range all_triangles() const { return {0, static_cast<int>(candidates_.size())}; }

  Vec3<double> start(int vertex, const std::vector<Row<T>>& u) const {
    return rest_[vertex] + cast<double>(u[vertex].v);
  }

  SurfacePair pair(const Contact& contact, const std::vector<Row<T>>& u,
                   const std::vector<Row<T>>& d) const {
    SurfacePair pair;
    pair.x = start(contact.vertex, u);
    pair.dx = cast<double>(d[contact.vertex].v);
    for (int j = 0; j < 3; ++j) {
      const int v = pairs_.triangles()[contact.triangle][j];
      pair.y[j] = start(v, u);
      pair.dy[j] = cast<double>(d[v].v);
    }
    return pair;
  }

  void look_for_candidates(Team& team, int rank, const std::vector<Row<T>>& u,
                           const std::vector<Row<T>>& d) {
    const auto& vertices = pairs_.vertices();
    const Range mine = part_of({0, static_cast<int>(vertices.size())}, rank, team.size());
    Moved own;
    for (int k = mine.begin; k < mine.end; ++k) {
      const Vec3<double> x = start(vertices[k], u), dx = cast<double>(d[vertices[k]].v);
      const Vec3<double> from = x - found_at_[vertices[k]];
      own.since = std::max({own.since, norm(from), norm(from + dx)});
      own.now = std::max(own.now, norm(dx));
    }
    moved_[rank] = own;
    team.barrier();
    Moved all;
    for (const auto& part : moved_) {
      all.since = std::max(all.since, part.since);
      all.now = std::max(all.now, part.now);
    }
    team.barrier();
    if (margin_ > 0.0 && all.since <= 0.5 * margin_) return;
    team.barrier();  // all have read the margin
    if (rank == 0) {
      margin_ = std::max(2.0 * thickness_, 8.0 * all.now);
      for (const int v : vertices) found_at_[v] = start(v, u);
      pairs_.place(found_at_, thickness_ + margin_);
    }
    team.barrier();
    const Range triangles = part_of(all_triangles(), rank, team.size());
    for (int t = triangles.begin; t < triangles.end; ++t) {
      pairs_.find(found_at_, t, candidates_[t]);
    }
    team.barrier();
  }

  // Adds `relative` to the motion of the vertex relative to the triangle, by their inverse masses.
  void share_out(const Contact& contact, const Vec3<double>& relative,
                 std::vector<Row<T>>& d) const {
    const auto& corners = pairs_.triangles()[contact.triangle];
    const auto& b = contact.over.b;
    double mobility = static_cast<double>(d[contact.vertex].w);
    for (int j = 0; j < 3; ++j) mobility += b[j] * b[j] * static_cast<double>(d[corners[j]].w);
    if (!(mobility > 0.0)) return;
    const auto move = [&](int v, double by) {
      d[v].v += cast<T>((by * static_cast<double>(d[v].w) / mobility) * relative);
    };
    move(contact.vertex, 1.0);
    for (int j = 0; j < 3; ++j) move(corners[j], -b[j]);
  }

  // The relative motion over the substep.
  static Vec3<double> slide(const SurfacePair& pair, const Over& over) {
    Vec3<double> relative = pair.dx;
    for (int j = 0; j < 3; ++j) relative -= over.b[j] * pair.dy[j];
    return relative;
  }

  // Returns by how much they were nearer than `distance`, m.
  double keep_apart(const Contact& contact, double distance, const std::vector<Row<T>>& u,
                    std::vector<Row<T>>& d) const {
    const SurfacePair now = pair(contact, u, d);
    Vec3<double> apart = now.x + slide(now, contact.over);
    for (int j = 0; j < 3; ++j) apart -= contact.over.b[j] * now.y[j];
    const double missing = distance - dot(contact.over.normal, apart);
    if (!(missing > 0.0)) return 0.0;
    share_out(contact, missing * contact.over.normal, d);
    return missing;
  }

  void resist_slide(const Contact& contact, const std::vector<Row<T>>& u,
                    std::vector<Row<T>>& d) const {
    const double limit = friction_ * contact.pushed;
    if (!(limit > 0.0)) return;
    const Vec3<double> relative = slide(pair(contact, u, d), contact.over);
    const Vec3<double>& n = contact.over.normal;
    const Vec3<double> along = relative - dot(n, relative) * n;
    const double distance = norm(along);
    share_out(contact, (distance > limit ? -limit / distance : -1.0) * along, d);
  }

  struct Moved {
    double since = 0.0;  // from where candidates were found, m
    double now = 0.0;    // in this substep
  };

  SurfacePairs pairs_;
  std::vector<Vec3<double>> rest_;
  double thickness_, friction_;
  double margin_ = 0.0;                       // m; 0: candidates were never looked for
  std::vector<Vec3<double>> found_at_;        // [n] where candidates were found, m
  std::vector<std::vector<int>> candidates_;  // [triangles] vertices, ascending
  std::vector<Moved> moved_;                  // [threads]
  std::vector<std::vector<Contact>> own_;     // [threads] of its triangles
  std::vector<Contact> contacts_, last_;      // of this substep, before and after the elements
};

}  // namespace viscera::sim
