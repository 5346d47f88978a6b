// A run cut into blocks that are solved side by side, each by a team of lanes (a CUDA thread block)
// on its own replicas of the vertices it touches; after a sweep the replicas of a vertex are
// averaged (partition.hpp). Made on the host, laid out as a device reads it.
#pragma once

#include <algorithm>
#include <climits>
#include <map>

#include "sim/backend/banks.hpp"
#include "sim/base/parallel.hpp"
#include "sim/base/row.hpp"
#include "sim/measures/stability.hpp"
#include "sim/model/coloring.hpp"
#include "sim/model/partition.hpp"
#include "sim/solvers/xpbd/linearized.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

inline constexpr std::size_t bank_bytes = 128;  // that shared memory serves at once

// The lanes that sweep, how many elements of an effect a replica of a vertex meets at most, how
// many are of one colour, whether elements may be linearised before a sweep, and whether the block
// is the whole body. Only the middle three decide on results: colours wider than the lanes are cut.
// Measured (docs/results/cuda.md): where a phase costs its latency, few phases matter, and one warp
// needs no barrier but its own; where blocks are large it costs its arithmetic. In a whole body a
// vertex is split only where it meets more elements than there are phases anyway.
inline constexpr int one_warp = 32;
struct BlockTeam {
  int lanes, max_elements;
  int max_in_color = lanes;
  bool linearizes = true;
  bool single_block = false;
};
inline BlockTeam team_for(int tets_per_block, int tets) {
  if (tets_per_block <= 640) return {one_warp, 16};
  if (tets_per_block <= 2500) return {128, 16, 128, false};
  constexpr int lanes = 256, least = 20;
  const bool single_block = tets_per_block >= tets;
  if (single_block)
    return {lanes, std::max(least, (tets + lanes - 1) / lanes), lanes, false, single_block};
  return {512, 20, 512, false};
}

// An element's vertices, counted from its block's first replica; aligned to be copied at once.
template <int arity>
struct alignas(arity > 2 ? 8 : 4) LocalVertices {
  static constexpr int bits = 16;
  std::uint32_t pairs[(arity + 1) / 2] = {};  // taken apart where they are used, not where loaded
  SIM_HD int operator[](int i) const {
    return static_cast<int>(pairs[i / 2] >> (i % 2 * bits) & 0xffffu);
  }
  void set(int i, int replica) {
    pairs[i / 2] |= static_cast<std::uint32_t>(replica) << (i % 2 * bits);
  }
};

// Constant data of an element, likewise.
template <class Rest>
struct alignas(16) AlignedRest {
  Rest rest;
};

// Which elements of the program stand one after the other, and how each counts its vertices.
template <int arity>
struct Placement {
  std::vector<int> element_of;
  std::vector<Roles<arity>> roles;
};

// Whether an element knows its vertices by the gradients of their shape functions only, the rows of
// rest_inverse: then it may count them in any order.
template <class Rest>
concept is_renumberable = requires(Rest rest) {
  rest.rest_inverse;
};

// Such an element with its vertices in other roles.
template <class T>
Mat3<T> renumbered(const Mat3<T>& rest_inverse, const Roles<4>& roles) {
  const Mat3<T> rows = transpose(rest_inverse);
  const auto& [b1, b2, b3] = rows.col;
  const Vec3<T> gradients[4] = {-(b1 + b2 + b3), b1, b2, b3};
  return transpose(Mat3<T>{{gradients[roles[1]], gradients[roles[2]], gradients[roles[3]]}});
}

// The elements of one effect, block by block, within a block phase by phase. The elements of a
// phase share no vertex and are no more than the lanes.
template <class Effect, class T>
struct BlockElements : Placement<Effect::arity> {
  using Placement<Effect::arity>::element_of, Placement<Effect::arity>::roles;
  std::vector<LocalVertices<Effect::arity>> vertices;
  std::vector<AlignedRest<typename Effect::template Rest<T>>> rest;
  std::vector<int> phase_begin = {0};  // [phases + 1] first element
  std::vector<int> block_phase = {0};  // [blocks + 1] first phase

  int element_count() const { return static_cast<int>(element_of.size()); }
  int elements_in_phase() const { return element_count() - phase_begin.back(); }

  void end_phase() {
    if (elements_in_phase() > 0) phase_begin.push_back(element_count());
  }
  void end_block() { block_phase.push_back(static_cast<int>(phase_begin.size()) - 1); }
  void append_block(const BlockElements& block) {
    const int first = element_count();
    vertices.insert(vertices.end(), block.vertices.begin(), block.vertices.end());
    element_of.insert(element_of.end(), block.element_of.begin(), block.element_of.end());
    roles.insert(roles.end(), block.roles.begin(), block.roles.end());
    for (std::size_t phase = 1; phase < block.phase_begin.size(); ++phase) {
      phase_begin.push_back(first + block.phase_begin[phase]);
    }
    end_block();
  }

  Range phases_of(int block) const { return {block_phase[block], block_phase[block + 1]}; }
  // Of the fullest block.
  int max_elements() const {
    return most(
        [this](Range phases) { return phase_begin[phases.end] - phase_begin[phases.begin]; });
  }
  int max_phases() const {
    return most([](Range phases) { return phases.end - phases.begin; });
  }

 private:
  template <class Count>
  int most(Count&& count) const {
    int result = 0;
    for (int block = 0; block + 1 < static_cast<int>(block_phase.size()); ++block) {
      result = std::max(result, count(phases_of(block)));
    }
    return result;
  }
};

// Tets as blocks have them, each in the first one that touches all of its vertices.
struct BlockTets {
  std::vector<int> begin = {0};           // [blocks + 1] first tet
  std::vector<int> tets;                  // in the order of the blocks, then of the mesh
  std::vector<LocalVertices<4>> corners;  // [tets] counted from the block's first local vertex

  int most() const {
    int result = 0;
    for (std::size_t block = 1; block < begin.size(); ++block) {
      result = std::max(result, begin[block] - begin[block - 1]);
    }
    return result;
  }
};

// A vertex as one block has it: one or several replicas, each with its share of the mass.
struct LocalVertex {
  int vertex;
  Range replicas;  // counted from the block's first
};
struct ReplicaRange {  // the same as a device has it
  std::uint16_t begin, count;
};

// Constant data of the local vertices, in the order of the layout.
template <class T>
struct LocalConstants {
  std::vector<Vec3<T>> rest;    // m
  std::vector<T> inverse_mass;  // 1/kg, the vertex's
  std::vector<T> mobility;      // s2/kg, of a replica
  std::vector<T> share;         // of a replica in the average over all of the vertex
  std::vector<ReplicaRange> replicas;
  std::vector<int> leader;  // which motion effect leads it, or -1; empty where there is none
};

class BlockLayout {
 public:
  // A busy vertex has several replicas in one block, none of which meets more than
  // team.max_elements of an effect, since every element that a replica meets is a phase of its own.
  template <class T>
  BlockLayout(const Model& model, const Program<T>& program, int tets_per_block, BlockTeam team)
      : blocks_(model, tets_per_block), split_(blocks_.count(), model.vertex_count()), team_(team) {
    std::vector<char> touched(model.vertex_count());
    std::vector<std::map<int, int>> parts(block_count());  // of the vertices with more than one
    for_each_slot<EffectKind::element>(program.effects, [&]<class Effect>(const auto& effect) {
      ElementCounts counts(model.vertex_count());
      const auto members = members_of(effect);
      for (int block = 0; block < block_count(); ++block) {
        counts.count(effect, members[block]);
        for (const int v : counts.vertices) {
          touched[v] = 1;
          const int wanted = parts_of(counts.of[v]);
          if (wanted > 1) parts[block][v] = std::max(parts[block][v], wanted);
        }
        split_.touch(block, counts.vertices);
      }
    });
    for (int block = 0; block < block_count(); ++block) {
      for (const auto& [vertex, wanted] : parts[block]) {
        for (int k = 1; k < wanted; ++k) split_.touch_again(block, vertex);
      }
    }
    for (int v = 0; v < static_cast<int>(touched.size()); ++v) {
      const std::array<int, 1> alone{v};
      if (!touched[v]) split_.touch(blocks_.block_of(alone), alone);
    }
    split_.number_replicas();
    number_locals();
  }

  int block_count() const { return blocks_.count(); }
  const BlockTeam& team() const { return team_; }
  const SplitVertices& split() const { return split_; }
  std::span<const int> replicas_of(int vertex) const { return split_.replicas_of(vertex); }
  Range replicas_in(int block) const { return split_.range_of({block, block + 1}); }
  // Those of vertices with several, here or elsewhere: the first of the block's.
  Range replicated_in(int block) const { return split_.replicated_in(block); }

  // Block by block; in a block first those that others have too.
  std::span<const LocalVertex> locals() const { return locals_; }
  Range locals_in(int block) const { return {local_begin_[block], local_begin_[block + 1]}; }
  Range shared_in(int block) const { return {local_begin_[block], shared_end_[block]}; }
  // Of one vertex, in the order of their blocks.
  const std::vector<int>& locals_of(int vertex) const { return locals_of_[vertex]; }

  // A tet that no block touches as a whole is left out: none of a body whose elements are tets, or
  // domains of whole tets.
  BlockTets tets_in_blocks(std::span<const Tet> tets) const {
    std::vector<std::vector<int>> members(block_count());
    for (std::size_t t = 0; t < tets.size(); ++t) {
      for (const int local : locals_of(tets[t][0])) {
        const int block = block_of_local(local);
        const auto touches = [&](int v) { return local_in(block, v) >= 0; };
        if (!std::ranges::all_of(tets[t], touches)) continue;
        members[block].push_back(static_cast<int>(t));
        break;
      }
    }
    BlockTets result;
    for (int block = 0; block < block_count(); ++block) {
      for (const int t : members[block]) {
        LocalVertices<4>& corners = result.corners.emplace_back();
        for (int i = 0; i < 4; ++i) {
          corners.set(i, local_in(block, tets[t][i]) - local_begin_[block]);
        }
        result.tets.push_back(t);
      }
      result.begin.push_back(static_cast<int>(result.tets.size()));
    }
    return result;
  }

  template <class T>
  LocalConstants<T> constants(const Program<T>& program) const {
    LocalConstants<T> result;
    for (const LocalVertex& local : locals_) {
      result.rest.push_back(program.rest[local.vertex]);
      result.inverse_mass.push_back(program.inverse_mass[local.vertex]);
      result.mobility.push_back(mobility_of(program, local.vertex));
      result.share.push_back(T(1) / static_cast<T>(replicas_of(local.vertex).size()));
      const auto [begin, end] = local.replicas;
      result.replicas.push_back(
          {static_cast<std::uint16_t>(begin), static_cast<std::uint16_t>(end - begin)});
    }
    int motions = 0;
    for_each_slot<EffectKind::motion>(program.effects, [&]<class Effect>(const auto& motion) {
      result.leader.resize(locals_.size(), -1);
      for (const int vertex : motion.vertices) {
        for (const int local : locals_of(vertex)) result.leader[local] = motions;
      }
      ++motions;
    });
    return result;
  }

  template <class Effect, class T>
  BlockElements<Effect, T> lay_out(const Prepared<Effect, T>& effect, const Program<T>& program,
                                   bool linearizes) const {
    const auto members = members_of(effect);
    std::vector<BlockElements<Effect, T>> blocks(block_count());
    parallel_ranges(blocks.size(), [&](std::size_t begin, std::size_t end) {
      ElementCounts counts(split_.vertex_count());
      for (std::size_t block = begin; block < end; ++block) {
        counts.count(effect, members[block]);
        append(effect, static_cast<int>(block), members[block], counts, blocks[block]);
      }
    });
    BlockElements<Effect, T> result;
    for (const auto& block : blocks) result.append_block(block);
    result.rest = rest_of(effect, program, result, linearizes);
    return result;
  }

  // Whether to linearise elements before a sweep (solvers/xpbd/linearized.hpp): unless that would
  // soften the body, and the step is one that elements evaluated anew bear. `cs` is that of
  // stability.hpp.
  template <class Effect, class T>
  bool linearizes(const Prepared<Effect, T>& effect, const Program<T>& program, double cs) const {
    if (!team_.linearizes) return false;
    if (cs > cs_limit) return true;
    double softening = 0.0, total = 0.0;
    if constexpr (is_linearized_apart<Effect>) {
      for (std::size_t e = 0; e < effect.rest.size(); ++e) {
        T mobility[Effect::arity];
        mobilities(program, effect.vertices[e], mobility);
        const double volume = Eliminated<Effect>::volume(effect.rest[e]);
        softening +=
            volume * (1.0 / Eliminated<Effect>::relaxation(effect.rest[e], mobility) - 1.0);
        total += volume;
      }
    }
    return softening <= max_softening * total;
  }

  // Constant data of the elements as they are placed.
  template <class Effect, class T>
  auto rest_of(const Prepared<Effect, T>& effect, const Program<T>& program,
               const Placement<Effect::arity>& placed, bool linearizes) const {
    std::vector<AlignedRest<typename Effect::template Rest<T>>> all;
    all.reserve(placed.element_of.size());
    for (std::size_t at = 0; at < placed.element_of.size(); ++at) {
      const int element = placed.element_of[at];
      all.push_back({effect.rest[element]});
      auto& rest = all.back().rest;
      T mobility[Effect::arity];
      mobilities(program, effect.vertices[element], mobility);
      if constexpr (requires { Effect::lighten(rest, mobility); }) Effect::lighten(rest, mobility);
      if constexpr (is_linearized_apart<Effect>) {
        if (!linearizes) Eliminated<Effect>::stiffen(rest, mobility);
      }
      if constexpr (is_renumberable<typename Effect::template Rest<T>>) {
        rest.rest_inverse = renumbered(rest.rest_inverse, placed.roles[at]);
      }
    }
    return all;
  }

 private:
  // Of each replica of a vertex, s2/kg.
  template <class T>
  T mobility_of(const Program<T>& program, int vertex) const {
    const T squared = program.rule.acts * program.rule.acts;
    return static_cast<T>(replicas_of(vertex).size()) * program.inverse_mass[vertex] * squared;
  }
  template <class T, std::size_t arity>
  void mobilities(const Program<T>& program, const std::array<int, arity>& vertices,
                  T (&mobility)[arity]) const {
    for (std::size_t i = 0; i < arity; ++i) mobility[i] = mobility_of(program, vertices[i]);
  }

  int block_of_local(int local) const {
    return static_cast<int>(std::ranges::upper_bound(local_begin_, local) - local_begin_.begin()) -
           1;
  }
  // -1: the block does not touch the vertex.
  int local_in(int block, int vertex) const {
    for (const int local : locals_of(vertex)) {
      if (block_of_local(local) == block) return local;
    }
    return -1;
  }

  // Whether the next place names the same vertex, as in elements with fewer than there are places
  // (model/edge_domains.hpp).
  template <std::size_t arity>
  static bool is_named_again(const std::array<int, arity>& vertices, std::size_t i) {
    return i + 1 < arity && vertices[i] == vertices[i + 1];
  }

  // How many elements of a block each vertex belongs to.
  struct ElementCounts {
    std::vector<int> of, so_far;  // [vertices]
    std::vector<int> vertices;    // of the block

    explicit ElementCounts(std::size_t vertex_count) : of(vertex_count), so_far(vertex_count) {}

    template <class Prepared>
    void count(const Prepared& effect, const std::vector<int>& elements) {
      for (const int v : vertices) of[v] = so_far[v] = 0;
      vertices.clear();
      for (const int e : elements) {
        const auto& own = effect.vertices[e];
        for (std::size_t i = 0; i < own.size(); ++i) {
          if (!is_named_again(own, i) && of[own[i]]++ == 0) vertices.push_back(own[i]);
        }
      }
    }
  };

  template <class Prepared>
  std::vector<std::vector<int>> members_of(const Prepared& effect) const {
    std::vector<std::vector<int>> members(block_count());
    for (std::size_t e = 0; e < effect.vertices.size(); ++e) {
      members[blocks_.block_of(effect.vertices[e])].push_back(static_cast<int>(e));
    }
    return members;
  }

  template <class Effect, class T>
  void append(const Prepared<Effect, T>& effect, int block, const std::vector<int>& members,
              ElementCounts& counts, BlockElements<Effect, T>& to) const {
    constexpr int arity = Effect::arity;
    const Range replicas = replicas_in(block);
    std::vector<std::array<int, arity>> local;
    for (const int e : members) {
      const auto& own = effect.vertices[e];
      auto& element = local.emplace_back();
      for (std::size_t i = arity; i-- > 0;) {
        const int v = own[i];
        if (is_named_again(own, i)) {
          element[i] = element[i + 1];
          continue;
        }
        // Elements follow one another in space, so each replica has a sector of its vertex.
        const int part = counts.so_far[v]++ * parts_of(counts.of[v]) / counts.of[v];
        element[i] = split_.replica_of(block, v) + part - replicas.begin;
      }
    }
    Coloring coloring = color_with_few<arity>(std::span<const std::array<int, arity>>(local),
                                              replicas.end - replicas.begin, team_.max_in_color);
    const Banks<arity> banks(local, bank_bytes / static_cast<int>(sizeof(Row<T>)));
    for (int color = 0; color < coloring.color_count(); ++color) {
      const auto of_color = coloring.of_color(color);
      banks.balance(of_color);
      std::vector<Roles<arity>> roles(of_color.size(), in_order<arity>());
      if constexpr (is_renumberable<typename Effect::template Rest<T>>) {
        banks.share_out(of_color, roles);
      }
      for (std::size_t at = 0; at < of_color.size(); ++at) {
        if (to.elements_in_phase() == team_.lanes) to.end_phase();
        const int e = of_color[at];
        to.element_of.push_back(members[e]);
        to.roles.push_back(roles[at]);
        auto& vertices = to.vertices.emplace_back();
        for (int i = 0; i < arity; ++i) {
          vertices.set(i, local[e][roles[at][i]]);
        }
      }
      to.end_phase();
    }
  }

  void number_locals() {
    locals_of_.resize(split_.vertex_count());
    for (int block = 0; block < block_count(); ++block) {
      const Range all = replicas_in(block);
      std::vector<LocalVertex> shared, inner;
      for (int first = all.begin, end = first; first < all.end; first = end) {
        const int vertex = split_.vertex_of(first);
        while (end < all.end && split_.vertex_of(end) == vertex) ++end;
        const bool is_inner = static_cast<int>(replicas_of(vertex).size()) == end - first;
        (is_inner ? inner : shared).push_back({vertex, {first - all.begin, end - all.begin}});
      }
      local_begin_.push_back(static_cast<int>(locals_.size()));
      locals_.insert(locals_.end(), shared.begin(), shared.end());
      shared_end_.push_back(static_cast<int>(locals_.size()));
      locals_.insert(locals_.end(), inner.begin(), inner.end());
    }
    local_begin_.push_back(static_cast<int>(locals_.size()));
    for (std::size_t local = 0; local < locals_.size(); ++local) {
      locals_of_[locals_[local].vertex].push_back(static_cast<int>(local));
    }
  }

  int parts_of(int elements) const {
    return (elements + team_.max_elements - 1) / team_.max_elements;
  }

  Blocks blocks_;
  SplitVertices split_;
  BlockTeam team_;
  std::vector<LocalVertex> locals_;
  std::vector<int> local_begin_;             // [blocks + 1]
  std::vector<int> shared_end_;              // [blocks]
  std::vector<std::vector<int>> locals_of_;  // [vertices]
};

}  // namespace viscera::sim
