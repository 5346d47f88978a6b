// The regions of one effect on the CPU. Sums over a region are taken in chunks of a fixed size and
// these in order, so that any number of threads gives the same bits.
#pragma once

#include "sim/backend/cpu_elements.hpp"
#include "sim/backend/team.hpp"
#include "sim/best_rotation.hpp"

namespace viscera::sim {

template <class Effect, class T>
class CpuRegions {
 public:
  CpuRegions(const Prepared<Effect, T>& prepared, const ElementLayout& layout)
      : data_(prepared.regions),
        squared_phase_(prepared.squared_phase),
        fits_(data_.regions.size()),
        region_of_(data_.members.size()) {
    for (std::size_t r = 0; r < data_.regions.size(); ++r) {
      const auto& [begin, end, mass, inertia, shear] = data_.regions[r];
      for (int m = begin; m < end; ++m) region_of_[m] = static_cast<int>(r);
      chunk_begin_.push_back(static_cast<int>(chunks_.size()));
      for (int m = begin; m < end; m += chunk_size) {
        chunks_.push_back({m, std::min(m + chunk_size, end)});
      }
    }
    chunk_begin_.push_back(static_cast<int>(chunks_.size()));
    sums_.resize(chunks_.size());
    if (layout.iterates) pulled_.resize(data_.members.size());
  }

  void retune(const Prepared<Effect, T>& prepared) { squared_phase_ = prepared.squared_phase; }

  // One iteration, by all of the team; the vertices in `mine` are this thread's.
  void solve(Arithmetic arithmetic, double pbd_stiffness, Team& team, int rank, Range mine,
             const std::vector<Row<T>>& u, std::vector<Row<T>>& d) {
    const bool at_start = arithmetic == Arithmetic::force;
    const auto moved = [&](int vertex) {
      const Vec3<double> w = cast<double>(u[vertex].v);
      return at_start ? w : w + cast<double>(d[vertex].v);
    };
    const Range chunks = part_of({0, static_cast<int>(chunks_.size())}, rank, team.size());
    for (int c = chunks.begin; c < chunks.end; ++c) sum_chunk(c, moved);
    team.barrier();
    const Range regions = part_of({0, static_cast<int>(fits_.size())}, rank, team.size());
    for (int r = regions.begin; r < regions.end; ++r) fit(r);
    team.barrier();
    for (int i = mine.begin; i < mine.end; ++i) {
      if (!(d[i].w > T(0))) continue;
      const Vec3<double> w = moved(i);
      Vec3<double> sum;
      for (int k = data_.begin[i]; k < data_.begin[i + 1]; ++k) {
        const int m = data_.of_vertex[k];
        sum += data_.members[m].share * pull(m, w, arithmetic, pbd_stiffness);
      }
      d[i].v += cast<T>(sum);
    }
    team.barrier();
  }

 private:
  static constexpr int chunk_size = 256;  // members

  struct Sums {
    Vec3<double> first;    // sum m w
    Mat3<double> mixed{};  // sum m w r^T
  };
  struct Fit {
    Vec3<double> shift;  // c_w
    Quaternion<double> rotation;
  };

  template <class Moved>
  void sum_chunk(int chunk, const Moved& moved) {
    Sums sums{};
    for (int m = chunks_[chunk].begin; m < chunks_[chunk].end; ++m) {
      const auto& [vertex, mass, share, r] = data_.members[m];
      const Vec3<double> mw = mass * moved(vertex);
      sums.first += mw;
      sums.mixed.col[0] += r.x * mw;
      sums.mixed.col[1] += r.y * mw;
      sums.mixed.col[2] += r.z * mw;
    }
    sums_[chunk] = sums;
  }

  void fit(int region) {
    Vec3<double> first;
    Mat3<double> matrix = data_.regions[region].inertia;
    for (int c = chunk_begin_[region]; c < chunk_begin_[region + 1]; ++c) {
      first += sums_[c].first;
      for (int k = 0; k < 3; ++k) matrix.col[k] += sums_[c].mixed.col[k];
    }
    fits_[region] = {(1.0 / data_.regions[region].mass) * first, best_rotation(matrix)};
  }

  // What the iteration adds to the displacement of a member's copy. With o = omega^2 dt^2 and l
  // what it added so far in this substep, XPBD's equation 18 reads dl = -(o C + l) / (1 + o).
  Vec3<double> pull(int member, const Vec3<double>& w, Arithmetic arithmetic,
                    double pbd_stiffness) {
    const Fit& goal = fits_[region_of_[member]];
    const Vec3<double> error = (w - goal.shift) - turn(goal.rotation, data_.members[member].arm);
    const double o = squared_phase_[region_of_[member]];
    if (arithmetic == Arithmetic::pbd) return -pbd_stiffness * error;
    if (arithmetic == Arithmetic::force) return -o * error;
    if (arithmetic == Arithmetic::xpbd_only) return -o / (1.0 + o) * error;
    Vec3<double>& so_far = pulled_[member];
    if (arithmetic == Arithmetic::xpbd_first) so_far = {};
    const Vec3<double> more = -1.0 / (1.0 + o) * (o * error + so_far);
    so_far += more;
    return more;
  }

  Regions data_;
  std::vector<double> squared_phase_;  // [regions] omega^2 dt^2
  std::vector<Fit> fits_;              // [regions]
  std::vector<int> region_of_;         // [members]
  std::vector<Range> chunks_;          // of members
  std::vector<int> chunk_begin_;       // [regions + 1]
  std::vector<Sums> sums_;             // [chunks]
  std::vector<Vec3<double>> pulled_;   // [members], where a substep has several iterations, m
};

}  // namespace viscera::sim
