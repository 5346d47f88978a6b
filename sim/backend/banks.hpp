// Shared memory is in banks, each of which gives one row at a time: of the lanes that load at once,
// those that want rows of the same bank wait for one another. Two things are free: which elements
// of a phase load at once, and which of its vertices an element loads first.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

namespace viscera::sim {

// The role of each of an element's vertices: vertices[roles[i]] is the i-th that it works with.
template <int arity>
using Roles = std::array<std::uint8_t, arity>;
template <int arity>
constexpr Roles<arity> in_order() {
  Roles<arity> roles;
  for (int i = 0; i < arity; ++i) roles[i] = static_cast<std::uint8_t>(i);
  return roles;
}

// Elements by the rows of their vertices, all of which lie in shared memory. `lanes` of them, one
// after the other, load at once: a group. There are as many banks, and row r lies in r % lanes.
template <int arity>
class Banks {
 public:
  using Element = std::array<int, arity>;
  static constexpr int max_lanes = 8;

  Banks(std::span<const Element> elements, int lanes) : lanes_(lanes) {
    for (const Element& rows : elements) {
      auto& banks = bank_.emplace_back();
      for (int i = 0; i < arity; ++i) banks[i] = static_cast<std::uint8_t>(rows[i] % lanes);
    }
  }

  // Elements of a phase change places, until no group wants more than `arity` rows of a bank, or
  // none is found to change with. The same order comes out every time.
  void balance(std::span<int> order) const {
    constexpr int passes = 3, tries = 24;  // twice as many find a fiftieth more
    const int count = static_cast<int>(order.size());
    std::vector<Wanted> wanted((count + lanes_ - 1) / lanes_);
    for (int k = 0; k < count; ++k) add(wanted[k / lanes_], order[k]);
    std::minstd_rand random;
    for (int pass = 0; pass < passes; ++pass) {
      for (int k = 0; k < count; ++k) {
        Wanted& here = wanted[k / lanes_];
        for (int t = 0; t < tries && is_crowded(here, order[k]); ++t) {
          const int other = static_cast<int>(random() % count);
          Wanted& there = wanted[other / lanes_];
          if (&there == &here) continue;
          const int change = remove(here, order[k]) + add(here, order[other]) +
                             remove(there, order[other]) + add(there, order[k]);
          if (change < 0) {
            std::swap(order[k], order[other]);
          } else {
            remove(here, order[other]), add(here, order[k]);
            remove(there, order[k]), add(there, order[other]);
          }
        }
      }
    }
  }

  // The roles of the elements' vertices. Roles colour the edges of a graph, which lead from a
  // group's lanes to banks: two of one colour that meet in a bank would wait for one another. Where
  // no bank is wanted more than `arity` times, none do (König 1916, by alternating paths); one that
  // is wanted more often counts as several.
  void share_out(std::span<const int> order, std::span<Roles<arity>> roles) const {
    const int all = static_cast<int>(order.size());
    for (int begin = 0; begin < all; begin += lanes_) {
      const int count = std::min(all - begin, lanes_);
      Turns turns;
      std::array<int, max_lanes> met{};
      for (int lane = 0; lane < count; ++lane) {
        for (int i = 0; i < arity; ++i) {
          const int bank = bank_[order[begin + lane]][i];
          turns.add(lane, i, bank + max_lanes * (met[bank]++ / arity));
        }
      }
      for (int lane = 0; lane < count; ++lane) {
        std::ranges::copy(turns.vertex[lane], roles[begin + lane].begin());
      }
    }
  }

 private:
  using Wanted = std::array<int, max_lanes>;  // rows of each bank by a group

  // How far the squares of what a bank is wanted beyond `arity` change, when an element comes or
  // goes.
  int add(Wanted& wanted, int element) const {
    int change = 0;
    for (const int bank : bank_[element]) {
      const int over = ++wanted[bank] - arity;
      if (over > 0) change += 2 * over - 1;
    }
    return change;
  }
  int remove(Wanted& wanted, int element) const {
    int change = 0;
    for (const int bank : bank_[element]) {
      const int over = wanted[bank]-- - arity;
      if (over > 0) change -= 2 * over - 1;
    }
    return change;
  }
  bool is_crowded(const Wanted& wanted, int element) const {
    return std::ranges::any_of(bank_[element], [&](int bank) { return wanted[bank] > arity; });
  }

  // A colouring that grows edge by edge.
  struct Turns {
    std::array<std::array<int, arity>, max_lanes> vertex, bank;      // [lanes] in a role, or -1
    std::array<std::array<int, arity>, max_lanes * max_lanes> lane;  // [banks] likewise

    Turns() {
      for (auto& all : vertex) all.fill(-1);
      for (auto& all : lane) all.fill(-1);
    }
    static int free_in(const std::array<int, arity>& all) {
      return static_cast<int>(std::ranges::find(all, -1) - all.begin());
    }
    void add(int of_lane, int i, int of_bank) {
      const int free = free_in(vertex[of_lane]);
      make_free(of_bank, free, free_in(lane[of_bank]));
      put(of_lane, i, of_bank, free);
    }

   private:
    void put(int of_lane, int i, int of_bank, int role) {
      vertex[of_lane][role] = i;
      bank[of_lane][role] = of_bank;
      lane[of_bank][role] = of_lane;
    }
    // The edges of role `from` and `to` that follow one another from the bank, which has none in
    // `to`, change roles.
    void make_free(int of_bank, int from, int to) {
      int next = lane[of_bank][from];
      lane[of_bank][from] = -1;
      while (from != to && next >= 0) {
        const int here = next, i = vertex[here][from];
        const int other = vertex[here][to], other_bank = bank[here][to];
        put(here, i, of_bank, to);
        vertex[here][from] = -1;
        if (other < 0) return;
        next = lane[other_bank][from];
        lane[other_bank][to] = -1;
        put(here, other, other_bank, from);
        of_bank = other_bank;
      }
    }
  };

  int lanes_;
  std::vector<std::array<std::uint8_t, arity>> bank_;  // [elements] of the vertices
};

}  // namespace viscera::sim
