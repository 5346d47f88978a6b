// The CUDA backend's step on the host, one block, vertex and element after the other: the same
// layout and the same functions, without threads. It stands in for a device where there is none.
#pragma once

#include <memory>

#include "sim/backend/block_layout.hpp"
#include "sim/backend/block_step.hpp"
#include "sim/solvers/solver.hpp"

namespace viscera::sim {

template <class T>
class HostBlocks final : public Solver {
 public:
  static constexpr std::size_t ample = std::size_t{1} << 40;  // bytes for a block's work

  HostBlocks(const Model& model, const Scene& scene, int tets_per_block, bool linearized)
      : HostBlocks(model, scene, tets_per_block, linearized, team_for(tets_per_block)) {}
  HostBlocks(const Model& model, const Scene& scene, int tets_per_block, bool linearized, Team team,
             std::size_t room = ample)
      : program_(model, scene),
        layout_(model, program_, tets_per_block, team),
        linearized_(linearized),
        room_(room),
        v_(layout_.copy_count()),
        u_(layout_.copy_count()),
        d_(layout_.copy_count()) {
    scene_.dt = static_cast<T>(program_.dt);
    const BlockCopies<T> copies = layout_.copies(program_);
    rest_ = copies.rest;
    leader_ = copies.leader;
    for (int copy = 0; copy < layout_.copy_count(); ++copy) {
      u_[copy].w = copies.inverse_mass[copy];
      d_[copy].w = copies.mobility[copy];
    }
    Effects::for_each([&]<class Effect, std::size_t i>() {
      for (const auto& effect : std::get<i>(program_.effects)) view<Effect, i>(effect);
      auto& views = static_cast<BlockViews<Effect, T>&>(scene_.effects);
      views = {std::get<i>(views_).data(), static_cast<int>(std::get<i>(views_).size())};
      if constexpr (Effect::kind == EffectKind::contact) scene_.contacts += views.count;
    });
    corrections_.resize(scene_.contacts * layout_.copy_count());
  }

  void advance_frame() override {
    for (int substep = 0; substep < program_.substeps; ++substep) {
      const Step<T> step = program_.step(step_++);
      for (int block = 0; block < layout_.block_count(); ++block) {
        const auto x = vertices(block);
        for (int i = 0; i < x.count; ++i) begin_copy(member_, step, x, i);
        for_each_view<EffectKind::element>(
            member_, [&]<class Effect>(const auto& view, int) { sweep<Effect>(view, block, x); });
      }
      const std::vector<Row<T>> swept = d_;
      for (int block = 0; block < layout_.block_count(); ++block) {
        const auto x = vertices(block);
        const int first = layout_.copies_in(block).begin;
        for (int i = 0; i < x.count; ++i) {
          finish_copy(member_, step, x, i, average(swept, layout_.vertex_of(first + i)));
        }
      }
    }
  }

  State state() const override {
    State state{std::vector<Vec3<double>>(program_.rest.size()),
                std::vector<Vec3<double>>(program_.rest.size()), step_};
    for (std::size_t i = 0; i < state.u.size(); ++i) {
      const int copy = layout_.copies_of(static_cast<int>(i))[0];
      state.u[i] = cast<double>(u_[copy].v);
      state.v[i] = cast<double>(v_[copy]);
    }
    return state;
  }
  void set_state(const State& state) override {
    for (int copy = 0; copy < layout_.copy_count(); ++copy) {
      u_[copy].v = cast<T>(state.u[layout_.vertex_of(copy)]);
      v_[copy] = cast<T>(state.v[layout_.vertex_of(copy)]);
    }
    step_ = state.step;
  }
  void retune(const Model& model, const Scene& scene) override {
    program_.retune({model, scene});
    Effects::for_each([&]<class Effect, std::size_t i>() {
      const auto& effects = std::get<i>(program_.effects);
      for (std::size_t k = 0; k < effects.size(); ++k) {
        if constexpr (Effect::kind == EffectKind::element) {
          auto& own = *std::get<i>(own_)[k];
          std::ranges::copy(layout_.rest_of(effects[k], own.element_of), own.rest.begin());
        } else if constexpr (requires { effects[k].device; }) {
          std::get<i>(views_)[k].device = effects[k].device;
        }
      }
    });
  }
  std::size_t contact_count() const override { return 0; }
  std::string device() const override { return "host stand-in"; }

 private:
  template <class Effect>
  using View = BlockView<Effect, T>;
  template <class Effect, class U = T>
  struct ElementsOf {};
  template <class Effect, class U>
  requires(Effect::kind == EffectKind::element) struct ElementsOf<Effect, U>
      : BlockElements<Effect, U> {
    std::vector<U> memory;
  };
  template <class Effect>
  using Own = std::unique_ptr<ElementsOf<Effect>>;

  template <class Effect, std::size_t i>
  void view(const Prepared<Effect, T>& effect) {
    if constexpr (Effect::kind == EffectKind::element) {
      auto& own = std::get<i>(own_).emplace_back(
          new ElementsOf<Effect>{layout_.lay_out(effect, work_room<Effect, T>(room_)), {}});
      own->memory.resize(own->rest.size() * memory_of<Effect>);
      std::get<i>(views_).push_back({own->vertices.data(), own->rest.data(),
                                     own->phase_begin.data(), own->piece_phase.data(),
                                     own->block_piece.data(), own->memory.data()});
    } else if constexpr (requires { effect.device; }) {
      std::get<i>(views_).push_back({effect.device});
    }
  }

  BlockVertices<T> vertices(int block) {
    const Range copies = layout_.copies_in(block);
    const int first = copies.begin;
    return {u_.data() + first,    d_.data() + first,
            v_.data() + first,    corrections_.data() + scene_.contacts * first,
            rest_.data() + first, leader_.empty() ? nullptr : leader_.data() + first,
            copies.end - first};
  }

  template <class Effect>
  void sweep(const BlockView<Effect, T>& view, int block, const BlockVertices<T>& x) {
    for (int piece = view.block_piece[block]; piece < view.block_piece[block + 1]; ++piece) {
      sweep_piece(view, view.phase_begin[view.piece_phase[piece]],
                  view.phase_begin[view.piece_phase[piece + 1]], x);
    }
  }

  template <class Effect>
  void sweep_piece(const BlockView<Effect, T>& view, int begin, int end,
                   const BlockVertices<T>& x) {
    const auto memory = [&view](int e) { return view.memory + e * memory_of<Effect>; };
    if constexpr (is_linearizable<Effect>) {
      if (linearized_) {
        std::vector<LinearizedElement<Effect, T>> linearized(end - begin);
        for (int e = begin; e < end; ++e) {
          linearize_element<Effect>(x, view.vertices[e], view.rest[e].rest, memory(e),
                                    linearized[e - begin]);
        }
        for (const auto& element : linearized) {
          solve_linearized(x, element, Rows<T, Effect::arity>(x, element.vertices));
        }
        return;
      }
    }
    for (int e = begin; e < end; ++e) {
      solve_element<Effect>(x, view.vertices[e], view.rest[e].rest, memory(e));
    }
  }

  Vec3<T> average(const std::vector<Row<T>>& swept, int vertex) const {
    const auto copies = layout_.copies_of(vertex);
    if (copies.size() == 1) return swept[copies[0]].v;
    Vec3<T> sum;
    for (const int copy : copies) sum += swept[copy].v;
    return (T(1) / static_cast<T>(copies.size())) * sum;
  }

  Program<T> program_;
  BlockLayout layout_;
  bool linearized_;
  std::size_t room_;
  BlockScene<T> scene_;
  MemberScene<T> member_{scene_, 0};
  Effects::Slots<View> views_;
  Effects::Slots<Own> own_;
  std::uint64_t step_ = 0;
  std::vector<Vec3<T>> rest_, v_, corrections_;
  std::vector<Row<T>> u_, d_;
  std::vector<int> leader_;
};

}  // namespace viscera::sim
