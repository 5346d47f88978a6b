// The elements of one effect on the CPU, laid out for a scheme: by colour, by block, or with a
// place for every impulse that its vertices gather.
#pragma once

#include <numeric>
#include <optional>

#include "sim/backend/cpu_sweep.hpp"
#include "sim/partition.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

// What all effects of a run share.
struct ElementLayout {
  int vertices;
  Scheme scheme;
  bool iterates;                 // several iterations a substep: multipliers are kept
  bool holds;                    // elements hold their forces (held_forces.hpp)
  bool solves_damping;           // rate forces are summed by vertex, and not lowered
  std::optional<Blocks> blocks;  // block Gauss-Seidel only
  std::optional<SplitVertices> split;

  template <class T>
  ElementLayout(const Model& model, const Program<T>& program, const SolverOptions& options)
      : vertices(static_cast<int>(model.vertex_count())),
        scheme(options.method == Method::tled ? Scheme::gauss_seidel : options.scheme),
        iterates(sim::iterates(options)),
        holds(options.method == Method::xpbd && options.hold > 0.0),
        solves_damping(program.viscous_step) {
    if (scheme != Scheme::block_gauss_seidel) return;
    constexpr int own_choice = 400;
    blocks.emplace(model, options.block_tets > 0 ? options.block_tets : own_choice);
    split.emplace(blocks->count(), model.vertex_count());
    for_each_slot<EffectKind::element>(program.effects, [&]<class Effect>(const auto& effect) {
      if (!is_constraint<Effect>) return;
      for (const auto& vertices_of : effect.vertices) {
        split->touch(blocks->block_of(vertices_of), vertices_of);
      }
    });
    split->number_copies();
  }
};

template <class Effect, class T>
struct CpuElements {
  using Packed = PackedElements<Effect, T>;
  Packed packed;
  std::vector<Vec3<T>> impulses;  // Jacobi only: [groups * arity * W] N

  CpuElements(const Prepared<Effect, T>& elements, const ElementLayout& layout)
      : elements_(elements.vertices.size()) {
    const Scheme scheme = scheme_in(layout);
    if (scheme == Scheme::block_gauss_seidel) {
      lay_out_blocks(elements, layout);
    } else {
      std::vector<int> all(elements.vertices.size());
      std::iota(all.begin(), all.end(), 0);
      packed.append(all, elements.vertices, {0, layout.vertices}, elements.rest);
    }
    const std::size_t lanes = packed.groups.size() * Packed::width;
    if (layout.iterates) packed.kept.resize(lanes * Effect::rows);
    if (layout.holds) packed.kept.resize(lanes * held_by<Effect>);
    packed.memory.resize(lanes * Packed::memory_size);
    if (scheme == Scheme::jacobi) lay_out_slots(layout);
  }

  void retune(const Prepared<Effect, T>& elements) {
    for (std::size_t at = 0; at < packed.element_of.size(); ++at) {
      packed.put_rest(at, elements.rest[packed.element_of[at]]);
    }
  }

  bool in_blocks() const { return !block_colors_.empty(); }
  bool gathers() const { return !impulses.empty(); }

  // The colours of blocks [begin, end), block after block.
  std::span<const Range> colors_of(Range blocks) const {
    return {packed.colors.data() + block_colors_[blocks.begin],
            packed.colors.data() + block_colors_[blocks.end]};
  }
  // Where the impulses on a vertex are.
  std::span<const int> slots_of(int vertex) const {
    return {slots_.data() + slots_begin_[vertex], slots_.data() + slots_begin_[vertex + 1]};
  }

  // Appends what every element remembers, in the order of the elements.
  void save_memory(std::vector<double>& all) const {
    save<Packed::memory_size>(packed.memory, all);
  }
  // Takes its own from the front; an empty one stands for zeros.
  void load_memory(std::span<const double>& all) { load<Packed::memory_size>(packed.memory, all); }
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

  static Scheme scheme_in(const ElementLayout& layout) {
    if (is_rate_force<Effect> && layout.solves_damping) return Scheme::jacobi;
    // A force is taken in full: its stability is that of one element after the other.
    return is_constraint<Effect> ? layout.scheme : Scheme::gauss_seidel;
  }

  void lay_out_blocks(const Prepared<Effect, T>& elements, const ElementLayout& layout) {
    std::vector<std::vector<int>> members(layout.blocks->count());
    for (std::size_t e = 0; e < elements.vertices.size(); ++e) {
      members[layout.blocks->block_of(elements.vertices[e])].push_back(static_cast<int>(e));
    }
    for (int block = 0; block < layout.blocks->count(); ++block) {
      block_colors_.push_back(static_cast<int>(packed.colors.size()));
      std::vector<typename Packed::Vertices> copies;
      for (const int e : members[block]) {
        auto& element = copies.emplace_back(elements.vertices[e]);
        for (int& v : element) v = layout.split->copy_of(block, v);
      }
      packed.append(members[block], copies, layout.split->range_of({block, block + 1}),
                    elements.rest);
    }
    block_colors_.push_back(static_cast<int>(packed.colors.size()));
  }

  void lay_out_slots(const ElementLayout& layout) {
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
    slots_begin_.assign(layout.vertices + 1, 0);
    for_each_impulse([this](int vertex, int) { ++slots_begin_[vertex + 1]; });
    std::partial_sum(slots_begin_.begin(), slots_begin_.end(), slots_begin_.begin());
    slots_.resize(slots_begin_.back());
    auto next = slots_begin_;
    for_each_impulse([&](int vertex, int slot) { slots_[next[vertex]++] = slot; });
  }

  std::vector<int> block_colors_;  // [blocks + 1], block Gauss-Seidel only
  std::vector<int> slots_, slots_begin_;
  std::size_t elements_;
};

// The copies of the vertices that blocks work on.
template <class T>
class VertexCopies {
 public:
  // With `carries` false they begin every sweep where their vertex is.
  VertexCopies(const SplitVertices& split, bool carries)
      : split_(split),
        carries_(carries),
        u_(split.count()),
        d_(split.count()),
        carried_(split.count()) {}

  void take(Range copies, const std::vector<Row<T>>& u, const std::vector<Row<T>>& d) {
    for (int copy = copies.begin; copy < copies.end; ++copy) {
      const int v = split_.vertex_of(copy);
      u_[copy] = u[v];
      d_[copy] = {d[v].v + before_sweep(carried_[copy]),
                  static_cast<T>(split_.copies_of(v).size()) * d[v].w};
    }
  }
  void use(SweepFields<T>& fields) {
    fields.u = u_.data();
    fields.d = d_.data();
  }
  void average(Range vertices, std::vector<Row<T>>& d) {
    for (int v = vertices.begin; v < vertices.end; ++v) {
      const auto copies = split_.copies_of(v);
      if (copies.empty()) continue;
      const auto moved = [&](int copy) { return d_[copy].v - d[v].v; };
      Vec3<T> mean;
      for (const int copy : copies) mean += moved(copy);
      mean = (T(1) / static_cast<T>(copies.size())) * mean;
      if (carries_) {
        for (const int copy : copies)
          carried_[copy] = carried_on(carried_[copy], moved(copy), mean);
      }
      d[v].v += mean;
    }
  }

  void save(State& state) const { state.carried = cast_all<double>(carried_); }
  void load(const State& state) { carried_ = state.carried_by<T>(carried_.size()); }

 private:
  const SplitVertices& split_;
  bool carries_;
  std::vector<Row<T>> u_, d_;
  std::vector<Vec3<T>> carried_;  // [copies] m
};

// With the widest instructions that this machine has; the results do not depend on it.
template <class T>
const SweepTable<T>& best_sweeps() {
  static const SweepTables tables = runnable_sweeps().back();
  return std::get<SweepTable<T>>(tables);
}

}  // namespace viscera::sim
