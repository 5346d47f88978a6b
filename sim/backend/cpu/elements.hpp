// The elements of one effect on the CPU, laid out for a scheme: by colour, by block, or with a
// place for every impulse that its vertices gather.
#pragma once

#include <numeric>
#include <optional>

#include "sim/backend/block_layout.hpp"
#include "sim/backend/cpu/parts.hpp"
#include "sim/backend/cpu/sweep.hpp"
#include "sim/model/coloring.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

// What all effects of a run share.
template <class T>
struct ElementLayout {
  int vertices;
  Scheme scheme;
  bool iterates;        // several iterations a substep: multipliers are kept
  bool holds;           // elements hold their forces (held_forces.hpp)
  bool solves_damping;  // rate forces are summed by vertex, and not lowered
  const Program<T>& program;
  std::optional<BlockLayout> blocks;  // block Gauss-Seidel only

  ElementLayout(const Model& model, const Program<T>& of, const SolverOptions& options)
      : vertices(static_cast<int>(model.vertex_count())),
        scheme(options.method == Method::tled ? Scheme::gauss_seidel : options.scheme),
        iterates(sim::iterates(options)),
        holds(options.method == Method::xpbd && options.hold > 0.0),
        solves_damping(of.viscous_step),
        program(of) {
    if (scheme != Scheme::block_gauss_seidel) return;
    constexpr int own_choice = 400;
    const int tets_per_block = options.block_tets > 0 ? options.block_tets : own_choice;
    BlockTeam team = team_for(tets_per_block, static_cast<int>(model.tet_count()));
    team.linearizes = false;
    if (holds) team.max_elements = 1 << 20;  // no vertex is split within a block (below)
    blocks.emplace(model, program, tets_per_block, team);
  }
};

template <class Elements>
bool have_vertices_below(const Elements& elements, int vertex_count) {
  return std::ranges::all_of(elements, [vertex_count](const auto& element) {
    return std::ranges::all_of(element,
                               [vertex_count](int v) { return 0 <= v && v < vertex_count; });
  });
}

// Colours for some of the elements, ascending, whose vertices `vertices_of` numbers from 0.
template <std::size_t arity, class VerticesOf>
Coloring color_those(std::span<const int> which, const VerticesOf& vertices_of, int vertex_count) {
  std::vector<std::array<int, arity>> those;
  for (const int e : which) those.push_back(vertices_of(e));
  Coloring coloring = color_elements<arity>(those, vertex_count);
  for (int& e : coloring.order) e = which[e];
  return coloring;
}

// Appends the elements of a colouring, colour by colour.
template <class Effect, class T, class VerticesOf>
void append_colors(Coloring coloring, const VerticesOf& vertices_of,
                   PackedElements<Effect, T>& packed) {
  std::vector<typename PackedElements<Effect, T>::Vertices> vertices;
  for (int color = 0; color < coloring.color_count(); ++color) {
    const std::span<const int> members = coloring.of_color(color);
    vertices.clear();
    for (const int e : members) vertices.push_back(vertices_of(e));
    packed.append_color(members, vertices);
  }
}

template <class Effect, class T>
struct CpuElements {
  using Packed = PackedElements<Effect, T>;
  Packed packed;
  std::vector<Vec3<T>> impulses;  // Jacobi only: [groups * arity * W] N

  CpuElements(const Prepared<Effect, T>& elements, const ElementLayout<T>& layout)
      : layout_(&layout), elements_(elements.vertices.size()) {
    const Scheme scheme = scheme_in(layout);
    if (scheme == Scheme::block_gauss_seidel) {
      lay_out_blocks(elements);
    } else {
      lay_out_parts(elements);
      packed.set_rest(elements.rest);
    }
    VISCERA_ASSERT(have_vertices_below(elements.vertices, layout.vertices),
                   "an element without vertices 0 to " << layout.vertices - 1);
    const std::size_t lanes = packed.groups.size() * Packed::width;
    if (layout.iterates) packed.kept.resize(lanes * Effect::rows);
    if (layout.holds) packed.kept.resize(lanes * held_by<Effect>);
    packed.history.resize(lanes * Packed::history_size);
    if (scheme == Scheme::jacobi) lay_out_slots();
  }

  void retune(const Prepared<Effect, T>& elements) {
    in_blocks() ? set_rest_in_blocks(elements) : packed.set_rest(elements.rest);
  }

  bool in_blocks() const { return !block_colors_.empty(); }
  bool gathers() const { return !impulses.empty(); }

  // Stage after stage the colours of each part (parts.hpp), one colour after the other; none in
  // blocks.
  const std::vector<std::vector<Range>>& stages() const { return stages_; }

  // The colours of blocks [begin, end), block after block.
  std::span<const Range> colors_of(Range blocks) const {
    return {packed.colors.data() + block_colors_[blocks.begin],
            packed.colors.data() + block_colors_[blocks.end]};
  }
  // Where the impulses on a vertex are.
  std::span<const int> slots_of(int vertex) const {
    return {slots_.data() + slots_begin_[vertex], slots_.data() + slots_begin_[vertex + 1]};
  }

  // Appends the history of every element, in the order of the elements.
  void save_history(std::vector<double>& all) const {
    save<Packed::history_size>(packed.history, all);
  }
  // Takes its own from the front; an empty one stands for zeros.
  void load_history(std::span<const double>& all) {
    load<Packed::history_size>(packed.history, all);
  }
  // Likewise of the forces that it holds.
  void save_held(std::vector<double>& all) const { save<held_by<Effect>>(packed.kept, all); }
  void load_held(std::span<const double>& all) { load<held_by<Effect>>(packed.kept, all); }

 private:
  template <int size>
  void save(const std::vector<T>& numbers, std::vector<double>& all) const {
    const std::size_t begin = all.size();
    all.resize(begin + elements_ * size);
    for_each_number<size>([&](std::size_t by_element, std::size_t by_lane) {
      all[begin + by_element] = numbers[by_lane];
    });
  }
  template <int size>
  void load(std::vector<T>& numbers, std::span<const double>& all) {
    const bool virgin = all.empty();
    for_each_number<size>([&](std::size_t by_element, std::size_t by_lane) {
      numbers[by_lane] = virgin ? T(0) : static_cast<T>(all[by_element]);
    });
    if (!virgin) all = all.subspan(elements_ * size);
  }
  template <int size, class Function>
  void for_each_number(Function&& function) const {
    constexpr int width = Packed::width;
    for (std::size_t at = 0; at < packed.element_of.size(); ++at) {
      const std::size_t group = at / width, lane = at % width, element = packed.element_of[at];
      for (int k = 0; k < size; ++k) {
        function(element * size + k, (group * size + k) * width + lane);
      }
    }
  }

  // A force is taken in full: its stability is that of one element after the other. In blocks it
  // acts on their replicas of the vertices, but where elements hold what they add to a vertex: what
  // damping adds is no force to hold.
  static Scheme scheme_in(const ElementLayout<T>& layout) {
    if (is_rate_force<Effect> && layout.solves_damping) return Scheme::jacobi;
    if (is_constraint<Effect>) return layout.scheme;
    const bool in_blocks = layout.scheme == Scheme::block_gauss_seidel && !layout.holds;
    return in_blocks ? layout.scheme : Scheme::gauss_seidel;
  }

  void lay_out_parts(const Prepared<Effect, T>& elements) {
    constexpr std::size_t arity = Effect::arity;
    const int count = layout_->vertices;
    const std::span<const std::array<int, arity>> all(elements.vertices);
    const auto vertices_of = [all](int e) { return all[e]; };
    const Coloring whole = color_elements<arity>(all, count);
    const Halving halving = Halving::of(count, whole);
    for (const auto& stage : in_parts(halving, all)) {
      stages_.emplace_back();
      for (const std::vector<int>& part : stage) {
        const auto begin = static_cast<int>(packed.colors.size());
        append_colors(halving.levels == 0 ? whole : color_those<arity>(part, vertices_of, count),
                      vertices_of, packed);
        stages_.back().push_back({begin, static_cast<int>(packed.colors.size())});
      }
    }
  }

  void lay_out_blocks(const Prepared<Effect, T>& elements) {
    const BlockLayout& blocks = *layout_->blocks;
    const auto placed = blocks.lay_out(elements, layout_->program, true);
    // Each element counts its vertices as everywhere: what it holds goes by their order.
    placement_.element_of = placed.element_of;
    placement_.roles.assign(elements_, in_order<Effect::arity>());
    std::vector<typename Packed::Vertices> vertices;
    for (int block = 0; block < blocks.block_count(); ++block) {
      block_colors_.push_back(static_cast<int>(packed.colors.size()));
      const Range phases = placed.phases_of(block);
      if (layout_->holds) {
        append_in_greedy_order(elements, block, placed, phases);
        continue;
      }
      for (int phase = phases.begin; phase < phases.end; ++phase) {
        const int begin = placed.phase_begin[phase], end = placed.phase_begin[phase + 1];
        vertices.clear();
        for (int e = begin; e < end; ++e) {
          auto& replicas = vertices.emplace_back();
          for (int i = 0; i < Effect::arity; ++i) {
            replicas[placed.roles[e][i]] = blocks.replicas_in(block).begin + placed.vertices[e][i];
          }
        }
        packed.append_color(std::span(placed.element_of).subspan(begin, end - begin), vertices);
      }
    }
    block_colors_.push_back(static_cast<int>(packed.colors.size()));
    set_rest_in_blocks(elements);
  }
  // Forces that are held, which no device has, settle faster in the order of a greedy colouring
  // than in that of the fewest colours: a column whose mass ratio is 1e4 is .6 for 2.2 % off after
  // 4 s.
  void append_in_greedy_order(const Prepared<Effect, T>& elements, int block,
                              const BlockElements<Effect, T>& placed, Range phases) {
    const Range replicas = layout_->blocks->replicas_in(block);
    std::vector<int> members(placed.element_of.begin() + placed.phase_begin[phases.begin],
                             placed.element_of.begin() + placed.phase_begin[phases.end]);
    std::ranges::sort(members);
    // Its vertices as the block's replicas, numbered in the block or among all.
    const auto vertices_from = [&](int begin) {
      return [&, begin](int e) {
        auto vertices = elements.vertices[e];
        for (int& v : vertices) v = layout_->blocks->split().replica_of(block, v) - begin;
        return vertices;
      };
    };
    append_colors(color_those<Effect::arity>(members, vertices_from(replicas.begin),
                                             replicas.end - replicas.begin),
                  vertices_from(0), packed);
  }

  // What one sweep takes from an element's stiffness is given back where there is but one.
  void set_rest_in_blocks(const Prepared<Effect, T>& elements) {
    const bool in_one_sweep = !layout_->iterates && !layout_->holds;
    const auto placed =
        layout_->blocks->rest_of(elements, layout_->program, placement_, !in_one_sweep);
    std::vector<typename Packed::Rest> rest(elements_);
    for (std::size_t at = 0; at < placed.size(); ++at) {
      rest[placement_.element_of[at]] = placed[at].rest;
    }
    packed.set_rest(rest);
  }

  void lay_out_slots() {
    constexpr int width = Packed::width, arity = Effect::arity;
    impulses.resize(packed.groups.size() * arity * width);
    const auto for_each_impulse = [this](auto&& function) {
      for (int at = 0; at < static_cast<int>(packed.element_of.size()); ++at) {
        const int group = at / width, lane = at % width;
        if (lane > 0 && packed.element_of[at] == packed.element_of[at - 1]) continue;  // a filler
        for (int i = 0; i < arity; ++i) {
          function(packed.groups[group].vertices[i][lane], (group * arity + i) * width + lane);
        }
      }
    };
    slots_begin_.assign(layout_->vertices + 1, 0);
    for_each_impulse([this](int vertex, int) { ++slots_begin_[vertex + 1]; });
    std::partial_sum(slots_begin_.begin(), slots_begin_.end(), slots_begin_.begin());
    slots_.resize(slots_begin_.back());
    auto next = slots_begin_;
    for_each_impulse([&](int vertex, int slot) { slots_[next[vertex]++] = slot; });
  }

  const ElementLayout<T>* layout_;
  Placement<Effect::arity> placement_;      // in blocks
  std::vector<int> block_colors_;           // [blocks + 1], in blocks
  std::vector<std::vector<Range>> stages_;  // in colours
  std::vector<int> slots_, slots_begin_;
  std::size_t elements_;
};

// The replicas of the vertices that blocks work on, in a substep's order (block_step.hpp has the
// same for a device).
template <class T>
class VertexReplicas {
 public:
  // With `has_duals` false they begin every sweep where their vertex is.
  VertexReplicas(const SplitVertices& split, bool has_duals)
      : split_(split),
        has_duals_(has_duals),
        u_(split.count()),
        d_(split.count()),
        duals_(split.count()),
        rate_duals_(split.count()) {}

  // Whether rate forces act on them.
  bool damped() const { return damped_; }
  void damp(bool damped) {
    damped_ = damped;
    rate_duals_.assign(rate_duals_.size(), {});
  }

  // All where their vertices are.
  void take(Range replicas, const std::vector<Row<T>>& u, const std::vector<Row<T>>& d) {
    for (int replica = replicas.begin; replica < replicas.end; ++replica) {
      const int v = split_.vertex_of(replica);
      u_[replica] = u[v];
      d_[replica] = {d[v].v, static_cast<T>(split_.replicas_of(v).size()) * d[v].w};
    }
  }
  // Before rate forces, and before the constraints.
  void offset_for_rates(Range replicas) { offset(replicas, rate_duals_); }
  void offset(Range replicas) { offset(replicas, duals_); }
  // After rate forces: of vertices with several replicas no block knows all.
  void give_those_alone(Range replicas, std::vector<Row<T>>& d) const {
    for (int replica = replicas.begin; replica < replicas.end; ++replica) {
      const int v = split_.vertex_of(replica);
      if (is_alone(v)) d[v].v = d_[replica].v;
    }
  }
  // After forces, motions and contacts, which lead a vertex to d: its replicas get that and what
  // rate forces have done to each. beyond_vertex(v, d of the replica, its dual variable of the rate
  // forces) counts d from where the vertex would be without damping, and takes from both what an
  // obstacle undoes.
  template <class BeyondVertex>
  void lead(Range replicas, const std::vector<Row<T>>& d, BeyondVertex&& beyond_vertex) {
    for (int replica = replicas.begin; replica < replicas.end; ++replica) {
      const int v = split_.vertex_of(replica);
      if (is_alone(v)) {
        d_[replica].v = d[v].v;
        continue;
      }
      beyond_vertex(v, d_[replica].v, rate_duals_[replica]);
      d_[replica].v = d[v].v + done_by_rates(d_[replica].v, rate_duals_[replica], duals_[replica]);
    }
  }
  void use(SweepFields<T>& fields) {
    fields.u = u_.data();
    fields.d = d_.data();
  }
  void average(Range vertices, std::vector<Row<T>>& d) {
    for (int v = vertices.begin; v < vertices.end; ++v) {
      const auto replicas = split_.replicas_of(v);
      const T share = T(1) / static_cast<T>(replicas.size());
      const auto moved = [&](int replica) { return d_[replica].v - d[v].v; };
      Vec3<T> mean, by_rates;
      for (const int replica : replicas) {
        mean += moved(replica);
        by_rates += rate_duals_[replica];
      }
      mean = share * mean;
      by_rates = share * by_rates;
      for (const int replica : replicas) {
        next_duals(moved(replica), mean, by_rates, rate_duals_[replica], duals_[replica]);
        if (!has_duals_) duals_[replica] = rate_duals_[replica] = {};
      }
      d[v].v += mean;
    }
  }

  // The dual variables of the elements, and those of the rate forces where there are any.
  void save(State& state) const {
    state.duals = cast_all<double>(duals_);
    if (!damped_) return;
    const auto of_rates = cast_all<double>(rate_duals_);
    state.duals.insert(state.duals.end(), of_rates.begin(), of_rates.end());
  }
  void load(const State& state) {
    const std::size_t count = split_.count();
    const auto all = state.duals_for<T>(damped_ ? 2 * count : count);
    duals_.assign(all.begin(), all.begin() + count);
    if (damped_) rate_duals_.assign(all.begin() + count, all.end());
  }

 private:
  bool is_alone(int vertex) const { return split_.replicas_of(vertex).size() == 1; }
  void offset(Range replicas, const std::vector<Vec3<T>>& duals) {
    for (int replica = replicas.begin; replica < replicas.end; ++replica) {
      d_[replica].v += before_sweep(duals[replica]);
    }
  }

  const SplitVertices& split_;
  bool has_duals_, damped_ = false;
  std::vector<Row<T>> u_, d_;
  std::vector<Vec3<T>> duals_, rate_duals_;  // [replicas] m
};

// With the widest instructions that this machine has; the results do not depend on it.
template <class T>
const SweepTable<T>& best_sweeps() {
  static const SweepTables tables = runnable_sweeps().back();
  return std::get<SweepTable<T>>(tables);
}

}  // namespace viscera::sim
