// The bound on compression (solvers/xpbd/volume_bound.hpp) on the CPU. The tets that are near it
// are looked for side by side and corrected by one thread, in their order: the list is short, the
// result depends on the order, and any number of threads gives the same bits.
#pragma once

#include <algorithm>
#include <numeric>
#include <span>
#include <vector>

#include "sim/base/range.hpp"
#include "sim/base/row.hpp"
#include "sim/base/team.hpp"
#include "sim/solvers/xpbd/volume_bound.hpp"

namespace viscera::sim {

template <class T>
class CpuVolumeBound {
 public:
  using Rows = std::vector<Row<T>>;  // u in m; d in m, and beside it dt^2 / m, s2/kg

  CpuVolumeBound(BoundedTets<T> tets, int threads, int vertices)
      : tets_(std::move(tets)),
        found_(threads),
        corrections_(vertices),
        group_of_(vertices, -1),
        members_(vertices),
        around_begin_(vertices + 1),
        around_(4 * tets_.vertices.size()) {
    for (const Tet& tet : tets_.vertices) {
      for (const int v : tet) ++around_begin_[v + 1];
    }
    std::partial_sum(around_begin_.begin(), around_begin_.end(), around_begin_.begin());
    auto next = around_begin_;
    for (int t = 0; t < static_cast<int>(tets_.vertices.size()); ++t) {
      for (const int v : tets_.vertices[t]) around_[next[v]++] = t;
    }
  }

  void begin_at(const State& state) { acts_ = tets_.begins_at(state); }
  bool acts() const { return acts_; }

  // By all of the team, before anything else of a substep, the n-th of its frame.
  void begin_substep(Team& team, int rank, int n, const Rows& u, const Rows& d) {
    if (n % VolumeBound::scan_every == 0) watch(team, rank, false, u, d);
  }

  // By all of the team, after friction.
  void apply(Team& team, int rank, bool last_of_frame, const Rows& u, Rows& d) {
    if (tets_.vertices.empty()) return;
    if (last_of_frame) watch(team, rank, true, u, d);
    if (watched_.empty() && corrected_.empty() && !last_of_frame) return;
    team.barrier();
    if (rank == 0) {
      for (const int v : corrected_) corrections_[v] = {};
      corrected_.clear();
      if (acts_) {
        repeat_over_watched(VolumeBound::pushes, u, d, [](auto& tet) { return tet.push(); });
        repeat_over_watched(VolumeBound::halts, u, d, [](auto& tet) { return tet.halt(); });
        join_those_left(u, d);
      }
      if (last_of_frame) {
        acts_ = VolumeBound::goes_on(acts_, watched_.size(), tets_.vertices.size());
      }
    }
    team.barrier();
  }

  // [n] m, by which vertices were moved in this substep; none if it is empty.
  std::span<const Vec3<T>> corrections() const {
    return corrected_.empty() ? std::span<const Vec3<T>>() : std::span(corrections_);
  }

 private:
  // Lists the tets that are near the bound by where the substep begins, and where what the last one
  // did would lead them by the next time; or with `moved` by where this one has led to.
  void watch(Team& team, int rank, bool moved, const Rows& u, const Rows& d) {
    if (tets_.vertices.empty()) return;
    team.barrier();
    const Range mine = part_of({0, static_cast<int>(tets_.vertices.size())}, rank, team.size());
    auto& found = found_[rank];
    found.clear();
    for (int t = mine.begin; t < mine.end; ++t) {
      MovingTet<T> tet = moving_tet(t, u, d);
      const auto is_near = [](T strain) { return strain < T(VolumeBound::watched - 1.0); };
      if (moved) {
        if (is_near(tet.strain_after())) found.push_back(t);
        continue;
      }
      for (auto& way : tet.d) way = T(VolumeBound::scan_every) * way;
      if (is_near(tet.strain_before()) || is_near(tet.strain_after())) found.push_back(t);
    }
    team.barrier();
    if (rank == 0) {
      watched_.clear();
      for (int r = 0; r < team.size(); ++r) {
        watched_.insert(watched_.end(), found_[r].begin(), found_[r].end());
      }
    }
    team.barrier();
  }

  // Until correct(tet) would change none, at most so many times. Which tets a pass is for is found
  // first, as on a device, where they are tested side by side.
  template <class Correct>
  void repeat_over_watched(int at_most, const Rows& u, Rows& d, Correct&& correct) {
    for (int pass = 0; pass < at_most; ++pass) {
      wrong_.clear();
      for (const int t : watched_) {
        MovingTet<T> tet = moving_tet(t, u, d);
        if (correct(tet)) wrong_.push_back(t);
      }
      if (wrong_.empty()) return;
      for (const int t : wrong_) {
        MovingTet<T> tet = moving_tet(t, u, d);
        if (!correct(tet)) continue;
        for (int i = 0; i < 4; ++i) move(tets_.vertices[t][i], tet.d[i], d);
      }
    }
  }

  void join_those_left(const Rows& u, Rows& d) {
    if (corrected_.empty()) return;
    JoinedVertices<T> joined{group_of_.data(), members_.data()};
    for (bool any = true; any;) {
      any = false;
      wrong_ = watched_;
      for (const int v : corrected_) {
        for (const int t : tets_around(v)) wrong_.push_back(t);
      }
      std::erase_if(wrong_, [&](int t) { return !moving_tet(t, u, d).falls(); });
      std::ranges::sort(wrong_);  // some twice, which joins nothing
      for (const int t : wrong_) any = joined.join(tets_.vertices[t]) || any;
      joined.lead([&d](int v) { return d[v]; }, [&](int v, const Vec3<T>& to) { move(v, to, d); });
    }
    joined.part();
  }

  std::span<const int> tets_around(int v) const {
    return {around_.data() + around_begin_[v], around_.data() + around_begin_[v + 1]};
  }

  void move(int v, const Vec3<T>& to, Rows& d) {
    if (!touches(corrections_[v])) corrected_.push_back(v);
    corrections_[v] += to - d[v].v;
    d[v].v = to;
  }

  MovingTet<T> moving_tet(int t, const Rows& u, const Rows& d) const {
    MovingTet<T> tet{.rest_inverse = tets_.rest_inverse[t]};
    for (int i = 0; i < 4; ++i) {
      const int v = tets_.vertices[t][i];
      tet.u[i] = u[v].v;
      tet.d[i] = d[v].v;
      tet.w[i] = d[v].w;
    }
    return tet;
  }

  BoundedTets<T> tets_;
  std::vector<std::vector<int>> found_;  // [threads] near the bound, of each thread's part
  std::vector<int> watched_;             // all of them, in order
  std::vector<int> wrong_;               // those of them that a pass corrects
  std::vector<Vec3<T>> corrections_;     // [n] m, those of the substep
  std::vector<int> corrected_;           // the vertices that have one, some twice
  std::vector<int> group_of_, members_;  // [n] of JoinedVertices
  std::vector<int> around_begin_;        // [n + 1] into
  std::vector<int> around_;              // the tets of each vertex
  bool acts_ = true;
};

}  // namespace viscera::sim
