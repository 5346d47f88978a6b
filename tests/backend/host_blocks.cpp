#include "tests/backend/host_blocks.hpp"

#include <deque>

#include "sim/backend/block_step.hpp"
#include "sim/solvers/xpbd/damping_choice.hpp"

namespace viscera::sim {
namespace {

template <class T>
class HostBlocks final : public Solver {
 public:
  HostBlocks(const Model& model, const Scene& scene, int tets_per_block, bool linearized,
             BlockTeam team)
      : program_(model, scene, time_step_of(scene, blocks)),
        layout_(model, program_, tets_per_block, team),
        linearized_(linearized),
        constants_(layout_.constants(program_)),
        bounded_(model, scene, Method::xpbd),
        bounded_in_blocks_(layout_.tets_in_blocks(bounded_.vertices)),
        v_(layout_.locals().size()),
        last_(v_.size()),
        u_(layout_.replicas_in(layout_.block_count() - 1).end),
        d_(u_.size()),
        duals_(u_.size()),
        rate_duals_(u_.size()) {
    take_damping(model, scene);
    for (int block = 0; block < layout_.block_count(); ++block) {
      const int first = layout_.locals_in(block).begin;
      for_each_local(block, [&](const auto& x, int i, int) {
        VertexNow<T>(x, i).for_each_replica([&](int replica) {
          x.u[replica].w = constants_.inverse_mass[first + i];
          x.d[replica].w = constants_.mobility[first + i];
        });
      });
    }
    for_each_slot<EffectKind::contact>(program_.effects,
                                       [this]<class Effect>(const auto&) { ++contacts_; });
    corrections_.resize(contacts_ * layout_.locals().size());
    const double cs = assess(model, scene).cs_max;
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Effect::kind == EffectKind::element) {
        for (const auto& effect : std::get<i>(program_.effects)) {
          const bool linearizes = linearized && layout_.linearizes(effect, program_, cs);
          auto& own = std::get<i>(own_).emplace_back(
              new ElementsOf<Effect>{layout_.lay_out(effect, program_, linearizes), {}});
          own->history.resize(own->rest.size() * history_of<Effect>);
          own->linearizes = linearizes;
        }
      }
    });
    const std::vector<Vec3<double>> still(program_.rest.size());
    set_state({still, still});
  }

  void advance_frame() override {
    for (int substep = 0; substep < program_.substeps; ++substep) {
      const Step<T> step = program_.step(step_++);
      std::vector<ReplicaSum<T>> sums;
      for (int block = 0; block < layout_.block_count(); ++block) {
        const auto x = vertices(block);
        for (int i = 0; i < x.count; ++i) {
          begin_local(scenes_[block], step, x, i, VertexNow<T>(x, i));
        }
        sweep_in_order(
            scenes_[block], [&]<class Effect>(const auto& view) { sweep<Effect>(view, x); },
            [&] {
              for (int i = 0; i < x.count; ++i) load_local(scenes_[block], step, x, i);
            },
            [&] { offset_replicas(x, 0, 1); });
        push_tets(block, x);
        for (int i = 0; i < x.count; ++i) {
          sums.push_back(sum_of_replicas(scenes_[block], x, VertexNow<T>(x, i)));
        }
      }
      for (int block = 0; block < layout_.block_count(); ++block) {
        for_each_local(block, [&](const auto& x, int i, int vertex) {
          ReplicaSum<T> sum;
          for (const int local : layout_.locals_of(vertex)) {
            sum.moved += sums[local].moved;
            sum.by_rates += sums[local].by_rates;
          }
          VertexNow<T> now(x, i);
          finish_local(scenes_[block], step, x, i, sum, now);
        });
      }
    }
  }

  State state() const override {
    State state{std::vector<Vec3<double>>(program_.rest.size()),
                std::vector<Vec3<double>>(program_.rest.size()), step_};
    std::vector<Added<T>> added(program_.rest.size());
    for (int block = 0; block < layout_.block_count(); ++block) {
      const Range locals = layout_.locals_in(block);
      for (int i = locals.begin; i < locals.end; ++i) {
        const int vertex = layout_.locals()[i].vertex;
        const int replica = layout_.replicas_in(block).begin + constants_.replicas[i].begin;
        state.u[vertex] = cast<double>(u_[replica].v);
        state.v[vertex] = cast<double>(v_[i]);
        added[vertex] = last_[i];
      }
    }
    program_.save_added(added, state);
    state.duals = cast_all<double>(duals_);
    const auto of_rates = cast_all<double>(rate_duals_);
    state.duals.insert(state.duals.end(), of_rates.begin(), of_rates.end());
    return state;
  }
  void set_state(const State& state) override {
    bound_acts_ = bounded_.begins_at(state);
    const std::vector<Added<T>> added = program_.added_before(state);
    for (int block = 0; block < layout_.block_count(); ++block) {
      for_each_local(block, [&](const auto& x, int i, int vertex) {
        VertexNow<T>(x, i).for_each_replica(
            [&](int replica) { x.u[replica].v = cast<T>(state.u[vertex]); });
        x.v[i] = cast<T>(state.v[vertex]);
        x.last[i] = added[vertex];
      });
    }
    const auto duals = state.duals_for<T>(2 * duals_.size());
    duals_.assign(duals.begin(), duals.begin() + duals_.size());
    rate_duals_.assign(duals.begin() + duals_.size(), duals.end());
    step_ = state.step;
    make_views();
  }
  void retune(const Model& model, const Scene& scene) override {
    take_damping(model, scene);
    const double cs = assess(model, scene).cs_max;
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Effect::kind == EffectKind::element) {
        const auto& effects = std::get<i>(program_.effects);
        for (std::size_t k = 0; k < effects.size(); ++k) {
          auto& own = *std::get<i>(own_)[k];
          own.linearizes = linearized_ && layout_.linearizes(effects[k], program_, cs);
          std::ranges::copy(layout_.rest_of(effects[k], program_, own, own.linearizes),
                            own.rest.begin());
        }
      }
    });
    make_views();
  }
  void steer(const Scene& scene) override {
    program_.steer(scene);
    make_views();
  }
  std::size_t contact_count() const override { return 0; }
  std::string device() const override { return "host stand-in"; }

 private:
  static inline const SolverOptions blocks{.scheme = Scheme::block_gauss_seidel};

  void take_damping(const Model& model, const Scene& scene) {
    program_.retune({model, scene, program_.time_step,
                     damping_force_for(model, scene, blocks, layout_.split().replica_counts())});
  }

  template <class Effect>
  using View = BlockView<Effect, T>;
  template <class Effect, class U = T>
  struct ElementsOf {};
  template <class Effect, class U>
  requires(Effect::kind == EffectKind::element) struct ElementsOf<Effect, U>
      : BlockElements<Effect, U> {
    Planes<AlignedRest<typename Effect::template Rest<U>>> planes;  // of `rest`
    std::vector<U> history;
    bool linearizes = true;
  };
  template <class Effect>
  using Own = std::unique_ptr<ElementsOf<Effect>>;

  void make_views() {
    views_.assign(layout_.block_count(), {});
    scenes_.assign(layout_.block_count(), {});
    tables_.clear();
    for_each_slot<EffectKind::element>(
        own_, []<class Effect>(auto& own) { own->planes = planes_of(own->rest); });
    for (int block = 0; block < layout_.block_count(); ++block) {
      scenes_[block].rule = bound_acts_ ? program_.rule : program_.rule.to_first_order();
      scenes_[block].usual_acts = program_.rule.acts;
      scenes_[block].rate_passes = program_.viscous_step.passes;
      Effects::for_each([&]<class Effect, std::size_t i>() {
        auto& views = std::get<i>(views_[block]);
        for (std::size_t k = 0; k < std::get<i>(program_.effects).size(); ++k) {
          const auto& effect = std::get<i>(program_.effects)[k];
          if constexpr (Effect::kind == EffectKind::element) {
            auto& own = *std::get<i>(own_)[k];
            EffectView<Effect, T> all{
                own.vertices.data(),    {}, own.history.data(), own.phase_begin.data(),
                own.block_phase.data(), -1, own.linearizes};
            for (std::size_t p = 0; p < own.planes.size(); ++p) {
              all.rest.planes[p] = own.planes[p].data();
            }
            tables_.emplace_back(table_size(own.max_phases()));
            view_of_block(all, block, 0, 1, tables_.back().data(), views.emplace_back());
          } else if constexpr (requires { effect.device; }) {
            views.push_back({effect.device});
          }
        }
        static_cast<Views<BlockView<Effect, T>>&>(scenes_[block].effects) = {
            views.data(), static_cast<int>(views.size())};
      });
    }
  }

  BlockVertices<T> vertices(int block) {
    const int replica = layout_.replicas_in(block).begin;
    const Range locals = layout_.locals_in(block);
    const int first = locals.begin;
    return {u_.data() + replica,
            d_.data() + replica,
            duals_.data() + replica,
            rate_duals_.data() + replica,
            v_.data() + first,
            last_.data() + first,
            corrections_.data() + contacts_ * first,
            constants_.rest.data() + first,
            constants_.replicas.data() + first,
            constants_.share.data() + first,
            constants_.leader.empty() ? nullptr : constants_.leader.data() + first,
            locals.end - first,
            layout_.replicated_in(block).end - replica};
  }
  // function(block's vertices, index among them, vertex)
  template <class Function>
  void for_each_local(int block, Function&& function) {
    const auto x = vertices(block);
    const int first = layout_.locals_in(block).begin;
    for (int i = 0; i < x.count; ++i) function(x, i, layout_.locals()[first + i].vertex);
  }

  // Of all tets, where a device lists those near the bound.
  void push_tets(int block, const BlockVertices<T>& x) {
    if (!bound_acts_) return;
    bool any = true;
    for (int pass = 0; any && pass < VolumeBound::pushes; ++pass) {
      any = false;
      for (int t = bounded_in_blocks_.begin[block]; t < bounded_in_blocks_.begin[block + 1]; ++t) {
        any = push_tet(x, bounded_in_blocks_.corners[t],
                       bounded_.rest_inverse[bounded_in_blocks_.tets[t]]) ||
              any;
      }
    }
  }

  template <class Effect>
  void sweep(const BlockView<Effect, T>& view, const BlockVertices<T>& x) {
    constexpr int arity = Effect::arity;
    const auto history = [&view](int e) { return view.history + e * history_of<Effect>; };
    const int end = view.phase_begin[view.phases];
    if constexpr (is_linearizable<Effect>) {
      if (view.linearizes) {
        std::vector<LinearizedElement<Effect, T>> linearized(end);
        for (int e = 0; e < end; ++e) {
          linearize_element<Effect>(x, view.vertices[e], view.rest[e].rest, history(e),
                                    linearized[e]);
        }
        for (const auto& element : linearized) {
          solve_linearized(x, element, Rows<T, arity>(x.d, element.content.vertices));
        }
        return;
      }
    }
    for (int e = 0; e < end; ++e) {
      Vec3<T> u[arity];
      displacements_at_start(x, view.vertices[e], u);
      solve_element<Effect>(x, view.vertices[e], view.rest[e].rest, history(e), u,
                            Rows<T, arity>(x.d, view.vertices[e]));
    }
  }

  Program<T> program_;
  BlockLayout layout_;
  bool linearized_;
  std::vector<BlockScene<T>> scenes_;        // [blocks]
  std::vector<Effects::Slots<View>> views_;  // [blocks]
  std::deque<std::vector<int>> tables_;      // of the views
  Effects::Slots<Own> own_;
  std::uint64_t step_ = 0;
  int contacts_ = 0;  // contact effects named
  LocalConstants<T> constants_;
  BoundedTets<T> bounded_;
  BlockTets bounded_in_blocks_;
  bool bound_acts_ = true;
  std::vector<Vec3<T>> v_, corrections_;
  std::vector<Added<T>> last_;
  std::vector<Row<T>> u_, d_;
  std::vector<Vec3<T>> duals_, rate_duals_;
};

}  // namespace

template <class T>
std::unique_ptr<Solver> make_host_blocks(const Model& model, const Scene& scene, int tets_per_block,
                                         bool linearized) {
  return make_host_blocks<T>(model, scene, tets_per_block, linearized,
                             team_for(tets_per_block, static_cast<int>(model.tet_count())));
}

template <class T>
std::unique_ptr<Solver> make_host_blocks(const Model& model, const Scene& scene, int tets_per_block,
                                         bool linearized, BlockTeam team) {
  return std::make_unique<HostBlocks<T>>(model, scene, tets_per_block, linearized, team);
}

template std::unique_ptr<Solver> make_host_blocks<float>(const Model&, const Scene&, int, bool);
template std::unique_ptr<Solver> make_host_blocks<double>(const Model&, const Scene&, int, bool);
template std::unique_ptr<Solver> make_host_blocks<float>(const Model&, const Scene&, int, bool,
                                                         BlockTeam);
template std::unique_ptr<Solver> make_host_blocks<double>(const Model&, const Scene&, int, bool,
                                                          BlockTeam);

}  // namespace viscera::sim
