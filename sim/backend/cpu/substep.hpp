// A thread's part of a substep (step/substep.hpp) on the CPU. Each thread has its range of vertices
// and its part of every colour, or its blocks: what two threads change between two barriers is
// disjoint, so that any number of them gives the same bits.
#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <optional>
#include <span>
#include <vector>

#include "sim/backend/cpu/elements.hpp"
#include "sim/backend/cpu/regions.hpp"
#include "sim/backend/cpu/self_contact.hpp"
#include "sim/backend/cpu/viscous_step.hpp"
#include "sim/backend/cpu/volume_bound.hpp"
#include "sim/step/substep.hpp"

namespace viscera::sim {

// What one effect keeps on the CPU beside its Prepared data.
template <class Effect, class T, EffectKind kind = Effect::kind>
struct OnCpu {
  OnCpu(const Prepared<Effect, T>&, const ElementLayout<T>&) {}
  void retune(const Prepared<Effect, T>&) {}
};
template <class Effect, class T>
struct OnCpu<Effect, T, EffectKind::element> : CpuElements<Effect, T> {
  using CpuElements<Effect, T>::CpuElements;
};
template <class Effect, class T>
struct OnCpu<Effect, T, EffectKind::region> : CpuRegions<Effect, T> {
  using CpuRegions<Effect, T>::CpuRegions;
};
template <class Effect, class T>
struct OnCpu<Effect, T, EffectKind::self_contact> : CpuSelfContact<T> {
  using CpuSelfContact<T>::CpuSelfContact;
};
template <class Effect, class T>
struct OnCpu<Effect, T, EffectKind::contact> {
  std::vector<Vec3<T>> correction;  // [n] m, in this substep; 0: not in contact

  OnCpu(const Prepared<Effect, T>&, const ElementLayout<T>& layout) : correction(layout.vertices) {}
  void retune(const Prepared<Effect, T>&) {}
};

// What all threads work on.
template <class T>
struct CpuBody {
  template <class Effect>
  using Slot = OnCpu<Effect, T>;
  static constexpr std::size_t step_part = Effects::size;  // what is not one effect's
  using Seconds = std::array<double, Effects::size + 1>;

  CpuBody(const Model& model, const Scene& scene, const SolverOptions& given, int threads)
      : program(program_for<T>(model, scene, given)),
        options(given),
        rule(program.rule),
        layout(model, program, given),
        constants(SweepConstants<T>::of(given)),
        team(threads),
        volume_bound({model, scene, given.method}, team.most(),
                     static_cast<int>(model.vertex_count())),
        n(layout.vertices),
        u(n),
        d(n),
        v(n) {
    set_mobility({0, n}, rule.acts);
    // Damping may have to be solved for on replicas where it need not on the vertices.
    if (damps_replicas()) program.retune(program_for<T>(model, scene, given, replica_counts()));
    // Multipliers of several iterations, and the projections of PBD, are no forces to carry on.
    const bool has_duals = arithmetic_of(options, 0) == Arithmetic::xpbd_only;
    if (layout.blocks) replicas.emplace(layout.blocks->split(), has_duals);
    prepare_damping();
    Effects::for_each([&]<class Effect, std::size_t i>() {
      for (const auto& effect : std::get<i>(program.effects)) {
        std::get<i>(own).emplace_back(effect, layout);
      }
    });
    if (layout.holds) held.resize(n), added.resize(n);
    const std::vector<Vec3<double>> still(n);
    last = program.added_before({still, still});
  }

  void prepare_damping() {
    layout.solves_damping = static_cast<bool>(program.viscous_step);
    viscous_step.reset();
    if (program.viscous_step) viscous_step.emplace(program.inverse_mass);
    if (replicas) replicas->damp(damps_replicas() && !layout.solves_damping);
  }
  // Whether rate forces act on replicas of the vertices, unless damping is solved for.
  bool damps_replicas() const {
    bool any = false;
    for_each_slot<EffectKind::element>(
        program.effects, [&any]<class Effect>(const auto&) { any = any || is_rate_force<Effect>; });
    return any && layout.blocks && !layout.holds;
  }
  // [n] of each vertex, or none.
  std::vector<int> replica_counts() const {
    return damps_replicas() ? layout.blocks->split().replica_counts() : std::vector<int>{};
  }
  // Of the frame that begins: to first order where the bound on compression does not act.
  void choose_rule() {
    rule = volume_bound.acts() ? program.rule : program.rule.to_first_order();
    set_mobility({0, n}, rule.acts);
  }
  void set_mobility(Range range, T acts) {
    for (int i = range.begin; i < range.end; ++i) d[i].w = program.inverse_mass[i] * (acts * acts);
  }

  Program<T> program;
  SolverOptions options;
  TimeRule<T> rule;  // of the frame at hand
  ElementLayout<T> layout;
  SweepConstants<T> constants;
  Effects::Slots<Slot> own;
  std::optional<VertexReplicas<T>> replicas;  // block Gauss-Seidel only
  SweepTable<T> sweeps = best_sweeps<T>();
  Team team;
  CpuVolumeBound<T> volume_bound;
  std::optional<CpuViscousStep<T>> viscous_step;  // where damping is solved for
  Seconds seconds{};                              // by effect, of the first thread
  int n;
  std::uint64_t step = 0;    // substeps done before advance_frame() last paused
  std::vector<Row<T>> u, d;  // m; m over the substep, and g^2 / m, s2/kg
  std::vector<Vec3<T>> v;    // m/s
  std::vector<Added<T>> last;
  // Where forces are held, m over the substep: they, and what the last sweep has added to them.
  std::vector<Vec3<T>> held, added;
};

template <class T>
class CpuSubstep {
 public:
  using Number = T;

  CpuSubstep(CpuBody<T>& body, int rank)
      : body_(body),
        rank_(rank),
        mine_(part_of({0, body.n}, rank, body.team.size())),
        last_lap_(Clock::now()) {}

  // The substep that follows `done` ones.
  void run(std::uint64_t done) {
    done_ = done;
    substep(*this);
    took(CpuBody<T>::step_part);
  }

  const TimeRule<T>& rule() const { return body_.rule; }
  const TimeRule<T>& usual_rule() const { return body_.program.rule; }

  void find_compressed() {
    body_.volume_bound.begin_substep(body_.team, rank_, of_frame(), body_.u, body_.d);
  }
  void solve_damping() {
    if (!body_.viscous_step || !body_.program.viscous_step.is_due(done_)) return;
    const T tau = static_cast<T>(body_.program.viscous_step.tau());
    const auto decay = [&](Arithmetic arithmetic, const auto& velocity, auto& out) {
      body_.team.barrier();
      for (int i = mine_.begin; i < mine_.end; ++i) {
        body_.d[i].v = usual_rule().acts * velocity[i];
        out[i] = {};
      }
      body_.team.barrier();
      for_each_rate_force([&]<class Effect>(auto& own) {
        fill_impulses(own, sweep_of<Effect>(arithmetic));
        for (int i = mine_.begin; i < mine_.end; ++i) {
          out[i] += (tau * body_.program.inverse_mass[i]) * impulse_on(own, i);
        }
      });
    };
    body_.viscous_step->apply(body_.team, rank_, usual_rule(), body_.v, body_.last, decay);
    took(Effects::index_of<Viscosity>());
  }

  // They differ where the frame goes by another rule.
  void act_over(T acts) {
    if (rule().acts != usual_rule().acts) body_.set_mobility(mine_, acts);
  }

  template <class VertexStep>
  void for_each_vertex(const VertexStep& step) {
    const Vertices x = vertices();
    for (int i = mine_.begin; i < mine_.end; ++i) step(x, i);
  }
  template <class Motion, class VertexStep>
  void for_each_led(const Motion& motion, const VertexStep& step) {
    const Vertices x = vertices();
    for (const int i : motion.vertices) {
      if (i >= mine_.begin && i < mine_.end) step(x, i);
    }
  }
  template <class VertexStep>
  void end(const VertexStep& step) {
    for_each_vertex(step);
  }

  template <EffectKind kind, class Function>
  void for_each_effect(Function&& function) {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Effect::kind == kind) {
        const auto& prepared = std::get<i>(body_.program.effects);
        for (std::size_t k = 0; k < prepared.size(); ++k) {
          auto& own = std::get<i>(body_.own)[k];
          if constexpr (kind == EffectKind::contact) {
            const Contact<Effect> contact{prepared[k].device, own.correction.data()};
            function.template operator()<Effect>(contact);
          } else if constexpr (kind == EffectKind::self_contact) {
            function.template operator()<Effect>(own);
          } else {
            function.template operator()<Effect>(prepared[k]);
          }
        }
      }
    });
  }

  bool sweeps_rate_forces() {
    bool any = false;
    for_each_rate_force([&any]<class Effect>(const auto&) { any = true; });
    return any && !body_.viscous_step;
  }
  void sweep_rate_forces() {
    body_.team.barrier();
    const bool in_replicas = damps_in_replicas();
    if (in_replicas) {
      body_.replicas->take(own_replicas(), body_.u, body_.d);
      body_.replicas->offset_for_rates(own_replicas());
    }
    for_each_rate_force([&]<class Effect>(auto& own) {
      const Sweep<T> sweep = sweep_of<Effect>(Arithmetic::xpbd_only);
      for (int pass = 0; pass < body_.program.viscous_step.passes; ++pass) {
        own.in_blocks() ? sweep_own_blocks(own, sweep) : sweep_colors(own, sweep);
      }
      took(Effects::index_of<Effect>());
    });
    if (!in_replicas) return;
    body_.replicas->give_those_alone(own_replicas(), body_.d);
    body_.team.barrier();
  }

  bool holds_forces() const { return body_.layout.holds; }
  Vec3<T>* held() { return body_.held.data(); }
  Vec3<T>* added() { return body_.added.data(); }
  T renewed() const { return body_.constants.renewed; }

  void apply_loads() {
    took(CpuBody<T>::step_part);
    body_.team.barrier();
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Effect::kind == EffectKind::element && !is_rate_force<Effect> &&
                    !is_constraint<Effect>) {
        for (auto& own : std::get<i>(body_.own)) {
          sweep_colors(own, sweep_of<Effect>(Arithmetic::xpbd_only));
          took(i);
        }
      }
    });
  }

  int iterations() const { return body_.options.iterations; }
  // Forces (rows = 0) act once a substep.
  void solve_elements(int iteration) {
    if (iteration == 0) {
      took(CpuBody<T>::step_part);
      body_.team.barrier();
    }
    const Arithmetic arithmetic = arithmetic_of(body_.options, iteration);
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Effect::kind == EffectKind::element && !is_rate_force<Effect>) {
        for (auto& own : std::get<i>(body_.own)) {
          if (!is_constraint<Effect> && (iteration > 0 || holds_forces())) continue;
          if (own.in_blocks()) continue;
          const Sweep<T> sweep = sweep_of<Effect>(arithmetic);
          own.gathers() ? gather_impulses(own, sweep) : sweep_colors(own, sweep);
          took(i);
        }
      } else if constexpr (Effect::kind == EffectKind::region) {
        for (auto& own : std::get<i>(body_.own)) {
          own.solve(arithmetic, body_.options.stiffness, body_.team, rank_, mine_, body_.u,
                    body_.d);
          took(i);
        }
      }
    });
    if (body_.replicas) sweep_blocks(arithmetic, iteration);
  }

  template <class Effect>
  void separate(OnCpu<Effect, T, EffectKind::self_contact>& own) {
    took(CpuBody<T>::step_part);
    body_.team.barrier();
    own.separate(body_.team, rank_, body_.u, body_.d);
    took(Effects::index_of<Effect>());
  }

  void bound_compression() {
    const bool is_last = of_frame() + 1 == body_.program.substeps;
    body_.volume_bound.apply(body_.team, rank_, is_last, body_.u, body_.d);
  }
  const Vec3<T>* bound_corrections() const {
    const auto corrections = body_.volume_bound.corrections();
    return corrections.empty() ? nullptr : corrections.data();
  }

 private:
  using Clock = std::chrono::steady_clock;

  template <class Effect>
  struct Contact {
    const typename Effect::template Device<T>& device;
    Vec3<T>* correction;  // [n] m
  };

  // As vertex_steps.hpp sees them.
  struct Vertices {
    const Vec3<T>* rest_;
    Row<T>*u_, *d_;
    Vec3<T>* v_;
    Added<T>* last_;
    Step<T> step_;

    bool is_free(int i) const { return d_[i].w > T(0); }
    const Vec3<T>& rest(int i) const { return rest_[i]; }
    Vec3<T>& u(int i) const { return u_[i].v; }
    Vec3<T>& d(int i) const { return d_[i].v; }
    Vec3<T>& v(int i) const { return v_[i]; }
    Added<T>& last(int i) const { return last_[i]; }
    const Step<T>& step() const { return step_; }
  };
  Vertices vertices() {
    return {body_.program.rest.data(), body_.u.data(),           body_.d.data(), body_.v.data(),
            body_.last.data(),         body_.program.step(done_)};
  }

  int of_frame() const { return static_cast<int>(done_ % body_.program.substeps); }

  // Adds the time since its last call to a part, by the first thread.
  void took(std::size_t part) {
    if (rank_ != 0) return;
    const auto now = Clock::now();
    body_.seconds[part] += std::chrono::duration<double>(now - last_lap_).count();
    last_lap_ = now;
  }

  template <class Function>
  void for_each_rate_force(Function&& function) {
    for_each_slot<EffectKind::element>(body_.own, [&]<class Effect>(auto& own) {
      if constexpr (is_rate_force<Effect>) function.template operator()<Effect>(own);
    });
  }
  template <class Effect>
  Sweep<T> sweep_of(Arithmetic arithmetic) const {
    return body_.sweeps[static_cast<int>(arithmetic)][Effects::index_of<Effect>()];
  }
  template <class Elements>
  SweepFields<T> fields_of(Elements& own) {
    return {body_.u.data(), body_.d.data(), body_.constants, own.packed.kept.data(),
            own.packed.history.data()};
  }

  // A thread has some of a stage's parts, or shares one with others.
  template <class Elements>
  void sweep_colors(Elements& own, Sweep<T> sweep) {
    const int threads = body_.team.size();
    for (const std::vector<Range>& stage : own.stages()) {
      const auto parts = static_cast<int>(stage.size());
      if (parts >= threads) {
        const Range those = part_of({0, parts}, rank_, threads);
        for (int part = those.begin; part < those.end; ++part) sweep_part(own, sweep, stage[part]);
      } else {
        int part = 0;
        while (part_of({0, threads}, part, parts).end <= rank_) ++part;
        share_part(own, sweep, stage[part], part_of({0, threads}, part, parts));
      }
      body_.team.barrier();
    }
  }
  template <class Elements>
  void sweep_part(Elements& own, Sweep<T> sweep, Range part) {
    if (part.begin == part.end) return;
    const auto& colors = own.packed.colors;
    sweep(own.packed.groups.data(), {colors[part.begin].begin, colors[part.end - 1].end},
          fields_of(own));
  }
  // Colour by colour among the threads of these ranks.
  template <class Elements>
  void share_part(Elements& own, Sweep<T> sweep, Range part, Range ranks) {
    const SweepFields<T> fields = fields_of(own);
    const std::span<const Range> colors(own.packed.colors.data() + part.begin,
                                        own.packed.colors.data() + part.end);
    const int threads = ranks.end - ranks.begin, place = rank_ - ranks.begin;
    // The last colours hold a few elements each: one thread takes them without waiting in between.
    const auto tail = std::ranges::find_if(colors, [threads](Range color) {
      return color.end - color.begin < shared_groups * threads;
    });
    for (auto color = colors.begin(); color != tail; ++color) {
      sweep(own.packed.groups.data(), part_of(*color, place, threads), fields);
      body_.team.barrier(ranks);
    }
    if (place == 0 && tail != colors.end()) {
      sweep(own.packed.groups.data(), {tail->begin, colors.back().end}, fields);
    }
    body_.team.forget();
  }

  // Jacobi: all elements from the same d, then each vertex sums what is its own, in a fixed order.
  template <class Elements>
  void gather_impulses(Elements& own, Sweep<T> sweep) {
    fill_impulses(own, sweep);
    for (int i = mine_.begin; i < mine_.end; ++i) {
      body_.d[i].v += body_.d[i].w * impulse_on(own, i);
    }
    body_.team.barrier();
  }
  template <class Elements>
  void fill_impulses(Elements& own, Sweep<T> sweep) {
    SweepFields<T> fields = fields_of(own);
    fields.impulses = own.impulses.data();
    const Range all{0, static_cast<int>(own.packed.groups.size())};
    sweep(own.packed.groups.data(), part_of(all, rank_, body_.team.size()), fields);
    body_.team.barrier();
  }
  template <class Elements>
  static Vec3<T> impulse_on(const Elements& own, int vertex) {
    Vec3<T> sum;
    for (const int slot : own.slots_of(vertex)) sum += own.impulses[slot];
    return sum;
  }

  // Each thread has its blocks.
  Range own_blocks() const {
    return part_of({0, body_.layout.blocks->block_count()}, rank_, body_.team.size());
  }
  Range own_replicas() const { return body_.layout.blocks->split().range_of(own_blocks()); }

  template <class Elements>
  void sweep_own_blocks(Elements& own, Sweep<T> sweep) {
    SweepFields<T> fields = fields_of(own);
    body_.replicas->use(fields);
    for (const Range color : own.colors_of(own_blocks())) {
      sweep(own.packed.groups.data(), color, fields);
    }
  }

  // Effect after effect, on the blocks' replicas of the vertices.
  void sweep_blocks(Arithmetic arithmetic, int iteration) {
    const Range replicas = own_replicas();
    if (iteration == 0 && body_.replicas->damped()) {
      lead_replicas(replicas);
    } else {
      body_.replicas->take(replicas, body_.u, body_.d);
    }
    const auto sweep_those = [&](bool constraints) {
      Effects::for_each([&]<class Effect, std::size_t i>() {
        if constexpr (Effect::kind == EffectKind::element && !is_rate_force<Effect>) {
          if (is_constraint<Effect> != constraints) return;
          for (auto& own : std::get<i>(body_.own)) {
            if (!own.in_blocks()) continue;
            sweep_own_blocks(own, sweep_of<Effect>(arithmetic));
            took(i);
          }
        }
      });
    };
    if (iteration == 0) sweep_those(false);
    body_.replicas->offset(replicas);
    sweep_those(true);
    body_.team.barrier();
    body_.replicas->average(mine_, body_.d);
    body_.team.barrier();
    took(CpuBody<T>::step_part);
  }
  bool damps_in_replicas() const { return body_.replicas && body_.replicas->damped(); }
  // Replicas that rate forces have led apart get what forces, motions and contacts have done.
  void lead_replicas(Range replicas) {
    const T scale = rule().acts / usual_rule().acts;
    body_.replicas->lead(replicas, body_.d, [&](int v, Vec3<T>& damped, Vec3<T>& rate_dual) {
      damped = scale * damped - rule().acts * rule().velocity(body_.v[v], body_.last[v]);
      const auto stop_along = [&](const Vec3<T>& correction) {
        if (!touches(correction)) return;
        take_back_along(correction, damped);
        take_back_along(correction, rate_dual);
      };
      for_each_effect<EffectKind::contact>(
          [&]<class Effect>(const auto& contact) { stop_along(contact.correction[v]); });
    });
  }

  static constexpr int shared_groups = 2;  // a thread's least part of a colour that is shared out

  CpuBody<T>& body_;
  int rank_;
  Range mine_;
  std::uint64_t done_ = 0;
  Clock::time_point last_lap_;
};

}  // namespace viscera::sim
