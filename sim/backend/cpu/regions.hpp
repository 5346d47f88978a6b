// The regions of one effect on the CPU. Sums over a region are taken in chunks of a fixed size and
// these in order, so that any number of threads gives the same bits.
#pragma once

#include "sim/backend/cpu/elements.hpp"
#include "sim/backend/region_step.hpp"
#include "sim/base/team.hpp"

namespace viscera::sim {

template <class Effect, class T>
class CpuRegions {
 public:
  CpuRegions(const Prepared<Effect, T>& prepared, const ElementLayout<T>& layout)
      : data_(prepared.regions),
        squared_phase_(prepared.squared_phase),
        fits_(data_.regions.size()),
        region_of_(regions_of_members(data_)) {
    for (const auto& region : data_.regions) {
      chunk_begin_.push_back(static_cast<int>(chunks_.size()));
      for (int m = region.begin; m < region.end; m += chunk_size) {
        chunks_.push_back({m, std::min(m + chunk_size, region.end)});
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
    const auto moved = [&](int v) { return seen_by_regions(u[v].v, d[v].v, arithmetic); };
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
        const int r = region_of_[m];
        const RegionMember& member = data_.members[m];
        sum += member.share * pull_member(fits_[r], member, w, squared_phase_[r], arithmetic,
                                          pbd_stiffness, pulled_.empty() ? nullptr : &pulled_[m]);
      }
      d[i].v += cast<T>(sum);
    }
    team.barrier();
  }

 private:
  static constexpr int chunk_size = 256;  // members

  template <class Moved>
  void sum_chunk(int chunk, const Moved& moved) {
    RegionSums sums;
    for (int m = chunks_[chunk].begin; m < chunks_[chunk].end; ++m) {
      sums.add(data_.members[m], moved(data_.members[m].vertex));
    }
    sums_[chunk] = sums;
  }

  void fit(int region) {
    RegionSums all = RegionFit::begin(data_.regions[region]);
    for (int c = chunk_begin_[region]; c < chunk_begin_[region + 1]; ++c) all += sums_[c];
    fits_[region] = {data_.regions[region], all};
  }

  Regions data_;
  std::vector<double> squared_phase_;  // [regions] omega^2 dt^2
  std::vector<RegionFit> fits_;        // [regions]
  std::vector<int> region_of_;         // [members]
  std::vector<Range> chunks_;          // of members
  std::vector<int> chunk_begin_;       // [regions + 1]
  std::vector<RegionSums> sums_;       // [chunks]
  std::vector<Vec3<double>> pulled_;   // [members], where a substep has several iterations, m
};

}  // namespace viscera::sim
