// A run cut into blocks that are solved side by side, each by a team of lanes (a CUDA thread block)
// on its own copies of the vertices it touches; after a sweep the copies of a vertex are averaged
// (partition.hpp). Made on the host, laid out as a device reads it.
#pragma once

#include "sim/coloring.hpp"
#include "sim/partition.hpp"
#include "sim/solvers/program.hpp"

namespace viscera::sim {

// An element's vertices, counted from its block's first copy; aligned to be loaded at once.
template <int arity>
struct alignas(arity % 4 == 0   ? 8
               : arity % 2 == 0 ? 4
                                : 2) LocalVertices {
  std::uint16_t index[arity];
  SIM_HD int operator[](int i) const { return index[i]; }
};

// Constant data of an element, likewise.
template <class Rest>
struct alignas(16) AlignedRest {
  Rest rest;
};

// The elements of one effect, block by block, within a block phase by phase. The elements of a
// phase share no vertex and are no more than the lanes.
template <class Effect, class T>
struct BlockElements {
  std::vector<LocalVertices<Effect::arity>> vertices;
  std::vector<AlignedRest<typename Effect::template Rest<T>>> rest;
  std::vector<int> element_of;         // in the order of the program
  std::vector<int> phase_begin = {0};  // [phases + 1]
  std::vector<int> block_phase = {0};  // [blocks + 1] first phase

  int block_begin(int block) const { return phase_begin[block_phase[block]]; }
};

class BlockLayout {
 public:
  template <class T>
  BlockLayout(const Model& model, const Program<T>& program, int tets_per_block, int lanes)
      : blocks_(model, tets_per_block),
        split_(blocks_.count(), model.vertex_count()),
        lanes_(lanes) {
    std::vector<char> touched(model.vertex_count());
    for_each_slot<EffectKind::element>(program.effects, [&]<class Effect>(const auto& effect) {
      for (const auto& vertices : effect.vertices) {
        split_.touch(blocks_.block_of(vertices), vertices);
        for (const int v : vertices) touched[v] = 1;
      }
    });
    for (int v = 0; v < static_cast<int>(touched.size()); ++v) {
      const std::array<int, 1> alone{v};
      if (!touched[v]) split_.touch(blocks_.block_of(alone), alone);
    }
    split_.number_copies();
  }

  int block_count() const { return blocks_.count(); }
  int lanes() const { return lanes_; }
  int copy_count() const { return split_.count(); }
  int vertex_of(int copy) const { return split_.vertex_of(copy); }
  std::span<const int> copies_of(int vertex) const { return split_.copies_of(vertex); }
  Range copies_in(int block) const { return split_.range_of({block, block + 1}); }

  template <class Effect, class T>
  BlockElements<Effect, T> lay_out(const Prepared<Effect, T>& effect) const {
    std::vector<std::vector<int>> members(block_count());
    for (std::size_t e = 0; e < effect.vertices.size(); ++e) {
      members[blocks_.block_of(effect.vertices[e])].push_back(static_cast<int>(e));
    }
    BlockElements<Effect, T> result;
    for (int block = 0; block < block_count(); ++block) {
      append(effect, block, members[block], result);
      result.block_phase.push_back(static_cast<int>(result.phase_begin.size()) - 1);
    }
    return result;
  }

 private:
  template <class Effect, class T>
  void append(const Prepared<Effect, T>& effect, int block, const std::vector<int>& members,
              BlockElements<Effect, T>& to) const {
    const Range copies = copies_in(block);
    std::vector<std::array<int, Effect::arity>> local;
    for (const int e : members) {
      auto& element = local.emplace_back(effect.vertices[e]);
      for (int& v : element) v = split_.copy_of(block, v) - copies.begin;
    }
    const Coloring coloring = color_elements<Effect::arity>(
        std::span<const std::array<int, Effect::arity>>(local), copies.end - copies.begin);
    for (int color = 0; color < coloring.color_count(); ++color) {
      for (int at = coloring.color_begin[color]; at < coloring.color_begin[color + 1]; ++at) {
        const int e = coloring.order[at];
        to.element_of.push_back(members[e]);
        auto& vertices = to.vertices.emplace_back();
        int most = 1;  // copies
        for (int i = 0; i < Effect::arity; ++i) {
          vertices.index[i] = static_cast<std::uint16_t>(local[e][i]);
          most = std::max(most, static_cast<int>(copies_of(effect.vertices[members[e]][i]).size()));
        }
        auto& rest = to.rest.emplace_back(effect.rest[members[e]]).rest;
        if constexpr (requires { Effect::lighten(rest, T(1)); }) {
          Effect::lighten(rest, static_cast<T>(most));
        }
        const int size = static_cast<int>(to.rest.size());
        const bool full = size - to.phase_begin.back() == lanes_;
        if (full || at + 1 == coloring.color_begin[color + 1]) to.phase_begin.push_back(size);
      }
    }
  }

  Blocks blocks_;
  SplitVertices split_;
  int lanes_;
};

}  // namespace viscera::sim
