#include "stages/tetmesh/improve/improve.hpp"

#include <algorithm>
#include <numeric>

#include "pipeline/base/log.hpp"
#include "stages/tetmesh/improve/improve_stars.hpp"

namespace viscera {
namespace {

constexpr int edge_ends[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

// The first rounds work on all tets below the goal; later ones, when little is left to gain there,
// on the worse ones alone, and without relief of busy points, which would undo their work.
constexpr int broad_rounds = 4;
constexpr double late_goal = 0.8;  // as a part of the goal

// Raising the mean: tets below `fair` have their edges swapped, points whose tets are better than
// `good` on average (those of the inner lattice are) stay where they are.
constexpr double fair = 0.7, good = 0.8;
constexpr int swapping_sweeps = 3, settling_sweeps = 5, sharing_sweep = 2;
constexpr int last_rounds = 12;

constexpr int thinning_sweeps = 3;
constexpr double thinning_floor = 0.2;

// What busy points lose tets for may be a little worse than `poor`: 18 deg.
constexpr double sharing_floor = 0.26;
constexpr int sharing_rounds = 3;  // one point's relief may be another's chance

class Improver {
 public:
  Improver(Stars& mesh, const ImproveOptions& options)
      : mesh_(mesh), options_(options), goal_(options.goal), tried_(mesh.tets().size(), -1) {}

  Improved run() {
    result_.worst_before = worst();
    if (options_.thinning) thin_out_all();
    settle_all();
    smooth_all();
    for (int round = 0; round < options_.rounds; ++round) {
      log::check_interrupt();
      if (options_.progress) options_.progress(0.8 * round / options_.rounds);
      if (round < broad_rounds) {
        relieve_busy(options_.poor);
      } else {
        goal_ = late_goal * options_.goal;
      }
      if (!work_on_worst() && round >= broad_rounds) break;
    }
    if (options_.progress) options_.progress(0.8);
    raise_mean();
    last_resort();
    if (mesh_.project()) fit_volumes();
    result_.worst_after = worst();
    return result_;
  }

 private:
  // Tets below the goal, worst first.
  std::vector<int> bad_tets() const {
    std::vector<int> bad;
    for (std::size_t t = 0; t < mesh_.tets().size(); ++t)
      if (mesh_.alive(static_cast<int>(t)) && mesh_.quality(static_cast<int>(t)) < goal_)
        bad.push_back(static_cast<int>(t));
    std::stable_sort(bad.begin(), bad.end(),
                     [&](int a, int b) { return mesh_.quality(a) < mesh_.quality(b); });
    return bad;
  }

  double worst() const {
    const auto bad = bad_tets();
    return bad.empty() ? goal_ : mesh_.quality(bad.front());
  }

  // Near curves where materials meet, and in wedges between them, refinement ends far below the
  // size that was asked for: what the surfaces do not need is taken out again.
  void thin_out_all() {
    std::size_t gone = 1;
    for (int sweep = 0; sweep < thinning_sweeps && gone > 0; ++sweep) {
      gone = 0;
      for (std::size_t p = 0; p < mesh_.points().size(); ++p)
        gone += !mesh_.star(static_cast<int>(p)).empty() &&
                thin_out(mesh_, static_cast<int>(p), *options_.thinning, thinning_floor);
      result_.thinned += gone;
    }
  }

  void smooth_all() {
    for (std::size_t p = 0; p < mesh_.points().size(); ++p) {
      const int point = static_cast<int>(p);
      if (!mesh_.star(point).empty() && mesh_.worst(mesh_.star(point)) < goal_)
        result_.moves += smooth(mesh_, point);
    }
  }

  bool work_on_worst() {
    bool changed = false;
    for (const int tet : bad_tets()) {
      // Its place may have been taken by a better tet meanwhile.
      if (!mesh_.alive(tet) || mesh_.quality(tet) >= goal_ || is_stuck(tet)) continue;
      if (improve_tet(tet)) {
        changed = true;
      } else {
        tried_.resize(mesh_.tets().size(), -1);
        tried_[tet] = mesh_.now();
      }
    }
    return changed;
  }

  // Nothing around it has changed since everything was tried in vain.
  bool is_stuck(int tet) const {
    if (static_cast<std::size_t>(tet) >= tried_.size() || tried_[tet] < 0) return false;
    const Tet& corners = mesh_.tets()[tet];
    return std::all_of(corners.begin(), corners.end(),
                       [&](int corner) { return mesh_.stamp(corner) <= tried_[tet]; });
  }

  // Room is made for a tet that nothing else helps by moving what stands around it.
  bool smooth_around(const Tet& corners) {
    std::vector<int> points;
    for (const int corner : corners) {
      const auto near = mesh_.neighbours(corner);
      points.insert(points.end(), near.begin(), near.end());
    }
    std::sort(points.begin(), points.end());
    points.erase(std::unique(points.begin(), points.end()), points.end());
    bool moved = false;
    for (const int point : points) moved |= smooth(mesh_, point);
    result_.moves += moved;
    return moved;
  }

  bool improve_tet(int tet) {
    const Tet corners = mesh_.tets()[tet];
    for (const auto& ends : edge_ends)
      if (remove_edge(mesh_, corners[ends[0]], corners[ends[1]])) {
        ++result_.edges_removed;
        return true;
      }
    for (int corner = 0; corner < 4; ++corner)
      if (flip_face(mesh_, tet, corner)) {
        ++result_.faces_flipped;
        return true;
      }
    bool moved = false;
    for (const int corner : corners) moved |= smooth(mesh_, corner);
    result_.moves += moved;
    if (mesh_.quality(tet) >= goal_) return moved;
    for (const auto& ends : edge_ends)
      for (int way = 0; way < 2; ++way)
        if (collapse_edge(mesh_, corners[ends[way]], corners[ends[1 - way]])) {
          ++result_.collapses;
          return true;
        }
    if (moved || mesh_.quality(tet) >= options_.poor) return moved;
    return smooth_around(corners) || split_an_edge(corners);
  }

  bool split_an_edge(const Tet& corners) {
    for (const auto& ends : edge_ends)
      if (split_edge(mesh_, corners[ends[0]], corners[ends[1]])) {
        ++result_.splits;
        return true;
      }
    return false;
  }

  // Busy points lose edges as far as quality allows; the rest of the work then goes on.
  void relieve_busy(double floor) {
    for (std::size_t p = 0; p < mesh_.points().size(); ++p) {
      const int point = static_cast<int>(p);
      while (mesh_.is_busy(point) && relieve(mesh_, point, floor)) ++result_.edges_removed;
    }
  }

  // What is left after that gets a neighbour which takes part of its tets. None of this may make
  // the mesh worse than its worst tet is.
  void share_busy() {
    const double floor = std::min(sharing_floor, worst());
    for (int round = 0; round < sharing_rounds; ++round) {
      relieve_busy(floor);
      for (std::size_t p = 0; p < mesh_.points().size(); ++p)
        while (mesh_.is_busy(static_cast<int>(p)) && share_star(mesh_, static_cast<int>(p), floor))
          ++result_.shared;
    }
  }

  // The worst tets decide the time step, the others the accuracy: once nothing more is gained for
  // the former, edges are swapped and points moved for the mean.
  void raise_mean() {
    for (int sweep = 0; sweep < settling_sweeps; ++sweep) {
      if (sweep < swapping_sweeps) swap_edges();
      if (sweep == sharing_sweep) share_busy();
      log::check_interrupt();
      settle_all();
    }
  }

  // What was stuck may move again once its surroundings have changed.
  void last_resort() {
    goal_ = options_.poor;
    for (int round = 0; round < last_rounds && work_on_worst(); ++round) settle_all();
    share_busy();
    goal_ = options_.goal;
  }

  // The whole first, then labels from small to large, each at the cost of larger ones: the largest
  // receives what is left.
  void fit_volumes() {
    std::vector<std::pair<double, int>> by_size;
    for (const auto& [label, volume] : options_.volumes)
      if (label != 0) by_size.push_back({volume, label});
    std::sort(by_size.begin(), by_size.end());
    std::vector<int> larger;
    for (const auto& [volume, label] : by_size) larger.push_back(label);
    if (const auto whole = options_.volumes.find(0); whole != options_.volumes.end())
      fit_volume(mesh_, 0, {}, whole->second, options_.poor, options_.graded);
    for (const auto& [volume, label] : by_size) {
      larger.erase(larger.begin());
      fit_volume(mesh_, label, larger, volume, options_.poor, options_.graded);
    }
  }

  void swap_edges() {
    for (std::size_t t = 0; t < mesh_.tets().size(); ++t)
      if (mesh_.alive(static_cast<int>(t)) && mesh_.quality(static_cast<int>(t)) < fair)
        swap_an_edge(mesh_.tets()[t]);
  }

  void swap_an_edge(const Tet& corners) {
    for (const auto& ends : edge_ends)
      if (swap_edge(mesh_, corners[ends[0]], corners[ends[1]], options_.goal)) {
        ++result_.edges_removed;
        return;
      }
  }

  // A point around which nothing has changed since it would not settle is left alone.
  void settle_all() {
    settled_.resize(mesh_.points().size(), -1);
    for (std::size_t p = 0; p < settled_.size(); ++p) {
      const int point = static_cast<int>(p);
      if (mesh_.star(point).empty() || mesh_.stamp(point) <= settled_[p] ||
          mesh_.mean(mesh_.star(point)) >= good) {
        continue;
      }
      const bool moved = settle(mesh_, point, options_.goal);
      result_.moves += moved;
      settled_[p] = moved ? -1 : mesh_.now();
    }
  }

  Stars& mesh_;
  const ImproveOptions& options_;
  double goal_;
  std::vector<long> tried_;    // the mesh's count of changes when a tet was given up,
  std::vector<long> settled_;  // and when a point would not settle
  Improved result_;
};

}  // namespace

Improved improve(TetMesh& mesh, const Projector& project, const ImproveOptions& options) {
  Stars stars(mesh, project, options);
  const Improved result = Improver(stars, options).run();
  stars.extract(mesh);
  return result;
}

}  // namespace viscera
