// XPBD, PBD and TLED on a team of CPU threads. Each thread has its range of vertices and its part
// of every colour (or its blocks), which touch disjoint data: any number of threads gives the same
// bits. advance_frame() is the loop; read it first.
#include "sim/backend/cpu.hpp"

#include <algorithm>
#include <chrono>
#include <optional>

#include "sim/backend/cpu_regions.hpp"
#include "sim/backend/cpu_self_contact.hpp"
#include "sim/backend/cpu_viscous_step.hpp"
#include "sim/backend/cpu_volume_bound.hpp"
#include "sim/backend/pace.hpp"

namespace viscera::sim {
namespace {

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

int thread_count(int asked, const Model& model) {
  if (asked > 0) return asked;
  constexpr int worth_a_thread = 1500;  // tets: below, barriers cost more than a thread brings
  const int useful = 1 + static_cast<int>(model.tet_count()) / worth_a_thread;
  return std::clamp(static_cast<int>(std::thread::hardware_concurrency()), 1, useful);
}

using Clock = std::chrono::steady_clock;

template <class T>
class CpuSolver final : public Solver {
 public:
  CpuSolver(const Model& model, const Scene& scene, const SolverOptions& options)
      : program_(program_for<T>(model, scene, options)),
        options_(options),
        rule_(program_.rule),
        layout_(model, program_, options),
        constants_(SweepConstants<T>::of(options)),
        team_(thread_count(options.threads, model)),
        paced_((options.threads == 0 || options.spares_threads) && team_.most() > 1),
        volume_bound_({model, scene, options.method}, team_.most(),
                      static_cast<int>(model.vertex_count())),
        n_(layout_.vertices),
        u_(n_),
        d_(n_),
        v_(n_) {
    set_mobility({0, n_}, rule_.acts);
    Effects::for_each([&]<class Effect, std::size_t i>() {
      for (const auto& effect : std::get<i>(program_.effects)) {
        std::get<i>(own_).emplace_back(effect, layout_);
      }
    });
    if (layout_.holds) held_.resize(n_), added_.resize(n_);
    prepare_damping();
    const std::vector<Vec3<double>> still(n_);
    last_ = program_.added_before({still, still});
    // Multipliers of several iterations, and the projections of PBD, are no forces to carry on.
    const bool carries = arithmetic_of(options, 0) == Arithmetic::xpbd_only;
    if (layout_.blocks) copies_.emplace(layout_.blocks->split(), carries);
  }

  void advance_frame() override {
    rule_ = volume_bound_.acts() ? program_.rule : program_.rule.to_first_order();
    set_mobility({0, n_}, rule_.acts);
    for (int left = program_.substeps; left > 0;) {
      options_.pause_point();
      const Pace::Stretch stretch =
          paced_ ? pace_.next(left) : Pace::Stretch{std::min(left, Pace::longest), false};
      const auto begin = Clock::now();
      const auto work = [this, stretch](int rank) { run_substeps(stretch.substeps, rank); };
      if (stretch.alone) {
        team_.run_alone(work);
      } else {
        team_.run(work);
      }
      pace_.took(stretch, std::chrono::duration<double>(Clock::now() - begin).count());
      step_ += stretch.substeps;
      left -= stretch.substeps;
    }
  }

  State state() const override {
    State state{{}, cast_all<double>(v_), step_};
    for (int i = 0; i < n_; ++i) state.u.push_back(cast<double>(u_[i].v));
    save_memory(own_, state);
    if (layout_.holds) save_held(own_, held_, state);
    if (copies_) copies_->save(state);
    if (program_.rule.share > T(0)) program_.save_added(last_, state);
    return state;
  }
  void set_state(const State& state) override {
    for (int i = 0; i < n_; ++i) u_[i].v = cast<T>(state.u[i]);
    v_ = cast_all<T>(state.v);
    last_ = program_.added_before(state);
    step_ = state.step;
    volume_bound_.begin_at(state);
    load_memory(own_, state);
    if (layout_.holds) {
      held_ = load_held<decltype(own_), T>(own_, state, n_, program_.held_numbers());
    }
    if (copies_) copies_->load(state);
  }
  void retune(const Model& model, const Scene& scene) override {
    check_scene(scene);
    program_.retune(program_for<T>(model, scene, options_));
    const bool relaid = layout_.solves_damping != static_cast<bool>(program_.viscous_step);
    if (relaid) prepare_damping();
    Effects::for_each([&]<class Effect, std::size_t i>() {
      retune_all<Effect>(std::get<i>(own_), std::get<i>(program_.effects), layout_, relaid);
    });
  }
  void steer(const Scene& scene) override {
    check_scene(scene);
    program_.steer(scene);
  }
  std::size_t contact_count() const override {
    std::size_t count = 0;
    for_each_slot<EffectKind::contact>(own_, [&count]<class Effect>(const auto& own) {
      count += std::ranges::count_if(own.correction, touches<T>);
    });
    for_each_slot<EffectKind::self_contact>(
        own_, [&count]<class Effect>(const auto& own) { count += own.count(); });
    return count;
  }
  bool solves_damping() const override { return static_cast<bool>(program_.viscous_step); }
  int damping_passes() const override { return program_.viscous_step.passes; }
  double unsettled_force() const override {
    double sum = 0.0;
    for (int i = 0; i < static_cast<int>(added_.size()); ++i) {
      if (d_[i].w > T(0)) sum += norm(cast<double>(added_[i])) / static_cast<double>(d_[i].w);
    }
    return sum;
  }
  std::string device() const override {
    return "cpu, " + std::to_string(team_.most()) + " threads";
  }
  std::vector<std::pair<std::string, double>> seconds() const override {
    std::vector<std::pair<std::string, double>> named = {{"step", seconds_[step_part]}};
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if (seconds_[i] > 0.0) named.emplace_back(Effect::name, seconds_[i]);
    });
    return named;
  }

 private:
  void prepare_damping() {
    layout_.solves_damping = static_cast<bool>(program_.viscous_step);
    viscous_step_.reset();
    if (program_.viscous_step) viscous_step_.emplace(program_.inverse_mass);
  }

  static constexpr int shared_groups = 4;  // a thread's least part of a colour that is shared out
  static constexpr std::size_t step_part = Effects::size;  // what is not one effect's
  using Seconds = std::array<double, Effects::size + 1>;

  // Adds the time since its last call to a part; for one thread, the others have no Seconds.
  class Lap {
   public:
    explicit Lap(Seconds* seconds) : seconds_(seconds) {}
    void took(std::size_t part) {
      if (!seconds_) return;
      const auto now = Clock::now();
      (*seconds_)[part] += std::chrono::duration<double>(now - last_).count();
      last_ = now;
    }

   private:
    Seconds* seconds_;
    Clock::time_point last_ = Clock::now();
  };

  void run_substeps(int count, int rank) {
    const Range mine = part_of({0, n_}, rank, team_.size());
    Lap lap(rank == 0 ? &seconds_ : nullptr);
    for (int substep = 0; substep < count; ++substep) {
      const Step<T> step = program_.step(step_ + substep);
      const int of_frame = static_cast<int>((step_ + substep) % program_.substeps);
      volume_bound_.begin_substep(team_, rank, of_frame, u_, d_);
      if (viscous_step_) solve_damping(rank, mine, step_ + substep, lap);
      begin(mine);
      if (!viscous_step_) damp(rank, mine, lap);
      go_further_on(mine);
      apply_forces(mine);
      apply_motions(mine, step);
      lap.took(step_part);
      for_each_self_contact([&](auto& own, std::size_t effect) {
        team_.barrier();
        own.push(team_, rank, u_, d_);
        lap.took(effect);
      });
      push_contacts(mine, step);
      lap.took(step_part);
      team_.barrier();
      if (layout_.holds) hold_forces(mine);
      for (int i = 0; i < options_.iterations; ++i) solve_elements(rank, mine, i, lap);
      if (layout_.holds) renew_held(mine);
      for_each_self_contact([&](auto& own, std::size_t effect) {
        own.rub(team_, rank, u_, d_);
        lap.took(effect);
      });
      rub_contacts(mine, step);
      volume_bound_.apply(team_, rank, of_frame + 1 == program_.substeps, u_, d_);
      stop_contacts(mine, step);
      end(mine);
      lap.took(step_part);
    }
  }

  void set_mobility(Range mine, T acts) {
    for (int i = mine.begin; i < mine.end; ++i) {
      d_[i].w = program_.inverse_mass[i] * (acts * acts);
    }
  }
  // Rate forces are prepared for the usual rule, and act over its time.
  void begin(Range mine) {
    const TimeRule<T>& usual = program_.rule;
    if (rule_.acts != usual.acts) set_mobility(mine, usual.acts);
    for (int i = mine.begin; i < mine.end; ++i) {
      d_[i].v = d_[i].w > T(0) ? usual.acts * rule_.velocity(v_[i], last_[i]) : Vec3<T>{};
    }
  }
  void go_further_on(Range mine) {
    const TimeRule<T>& usual = program_.rule;
    if (usual.share == T(0)) return;
    const T longer = rule_.acts / usual.acts;
    if (rule_.acts != usual.acts) set_mobility(mine, rule_.acts);
    for (int i = mine.begin; i < mine.end; ++i) {
      if (d_[i].w > T(0)) d_[i].v = longer * d_[i].v + rule_.share * last_[i].u;
    }
  }

  // Rate forces act on g v alone. Later d holds what gravity and contact add in this substep,
  // which even at rest is not zero, and not the same for vertices that are held and for those that
  // are not.
  void damp(int rank, Range mine, Lap& lap) {
    if (!has_rate_forces()) return;
    begin_motions(mine);
    team_.barrier();
    if (damps_copies()) copies_->take(copies_of(rank), u_, d_);
    for_each_rate_force([&]<class Effect>(auto& own) {
      const Sweep<T> sweep = sweep_of<Effect>(Arithmetic::xpbd_only);
      for (int pass = 0; pass < program_.viscous_step.passes; ++pass) {
        own.in_blocks() ? sweep_own_blocks(own, sweep, rank) : sweep_colors(own, sweep, rank);
      }
      lap.took(Effects::index_of<Effect>());
    });
    if (!damps_copies()) return;
    copies_->give_those_alone(copies_of(rank), d_);
    team_.barrier();
  }
  template <class Function>
  void for_each_rate_force(Function&& function) {
    for_each_slot<EffectKind::element>(own_, [&]<class Effect>(auto& own) {
      if constexpr (is_rate_force<Effect>) function.template operator()<Effect>(own);
    });
  }
  bool has_rate_forces() {
    bool result = false;
    for_each_rate_force([&result]<class Effect>(const auto&) { result = true; });
    return result;
  }
  // Whether they act on the copies of the vertices.
  bool damps_copies() const { return copies_ && !layout_.holds && !layout_.solves_damping; }
  // The same implicitly, and less often.
  void solve_damping(int rank, Range mine, std::uint64_t step, Lap& lap) {
    if (!program_.viscous_step.is_due(step)) return;
    const T tau = static_cast<T>(program_.viscous_step.tau());
    const auto decay = [&](Arithmetic arithmetic, const auto& velocity, auto& out) {
      team_.barrier();
      for (int i = mine.begin; i < mine.end; ++i) {
        d_[i].v = program_.rule.acts * velocity[i];
        out[i] = {};
      }
      team_.barrier();
      for_each_slot<EffectKind::element>(own_, [&]<class Effect>(auto& own) {
        if constexpr (is_rate_force<Effect>) {
          fill_impulses(own, sweep_of<Effect>(arithmetic), rank);
          for (int i = mine.begin; i < mine.end; ++i) {
            out[i] += (tau * program_.inverse_mass[i]) * impulse_on(own, i);
          }
        }
      });
    };
    viscous_step_->apply(team_, rank, program_.rule, v_, last_, decay);
    lap.took(Effects::index_of<Viscosity>());
  }
  // Vertices that are led have a velocity too.
  void begin_motions(Range mine) {
    for_each_slot<EffectKind::motion>(program_.effects, [&]<class Effect>(const auto& effect) {
      for (const int i : effect.vertices) {
        if (i >= mine.begin && i < mine.end) d_[i].v = program_.rule.acts * v_[i];
      }
    });
  }

  void apply_forces(Range mine) {
    const T acts2 = rule_.acts * rule_.acts;
    for_each_slot<EffectKind::force>(program_.effects, [&]<class Effect>(const auto& effect) {
      for (int i = mine.begin; i < mine.end; ++i) {
        if (!(d_[i].w > T(0))) continue;
        d_[i].v += acts2 * Effect::acceleration(effect.device, program_.rest[i],
                                                rule_.place(u_[i].v, last_[i]),
                                                rule_.velocity(v_[i], last_[i]));
      }
    });
  }

  void apply_motions(Range mine, const Step<T>& step) {
    for_each_slot<EffectKind::motion>(program_.effects, [&]<class Effect>(const auto& effect) {
      for (const int i : effect.vertices) {
        if (i < mine.begin || i >= mine.end) continue;
        d_[i].v =
            Effect::target(effect.device, program_.rest[i], static_cast<T>(step.time)) - u_[i].v;
      }
    });
  }

  // The forces that the elements hold, before a sweep, which adds to them, and what it has added.
  void hold_forces(Range mine) {
    for (int i = mine.begin; i < mine.end; ++i) {
      if (!(d_[i].w > T(0))) continue;
      d_[i].v += held_[i];
      added_[i] = d_[i].v;
    }
    team_.barrier();
  }
  void renew_held(Range mine) {
    for (int i = mine.begin; i < mine.end; ++i) {
      if (!(d_[i].w > T(0))) continue;
      added_[i] = d_[i].v - added_[i];
      held_[i] += constants_.renewed * added_[i];
    }
  }

  // One iteration over all elements. Forces (rows = 0) act once a substep.
  void solve_elements(int rank, Range mine, int iteration, Lap& lap) {
    const Arithmetic arithmetic = arithmetic_of(options_, iteration);
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Effect::kind == EffectKind::element && !is_rate_force<Effect>) {
        for (auto& own : std::get<i>(own_)) {
          if (!is_constraint<Effect> && iteration > 0) continue;
          if (own.in_blocks()) continue;
          const Sweep<T> sweep = sweep_of<Effect>(arithmetic);
          if (own.gathers()) {
            gather_impulses(own, sweep, rank, mine);
          } else {
            sweep_colors(own, sweep, rank);
          }
          lap.took(i);
        }
      } else if constexpr (Effect::kind == EffectKind::region) {
        for (auto& own : std::get<i>(own_)) {
          own.solve(arithmetic, options_.stiffness, team_, rank, mine, u_, d_);
          lap.took(i);
        }
      }
    });
    if (copies_) sweep_blocks(arithmetic, iteration, rank, mine, lap);
  }

  template <class Effect>
  Sweep<T> sweep_of(Arithmetic arithmetic) const {
    return sweeps_[static_cast<int>(arithmetic)][Effects::index_of<Effect>()];
  }

  template <class Elements>
  SweepFields<T> fields_of(Elements& own) {
    return {u_.data(), d_.data(), constants_, own.packed.kept.data(), own.packed.memory.data()};
  }

  template <class Elements>
  void sweep_colors(Elements& own, Sweep<T> sweep, int rank) {
    const SweepFields<T> fields = fields_of(own);
    const auto& colors = own.packed.colors;
    // The last colours hold a few elements each: one thread takes them without waiting in between.
    const auto tail = std::ranges::find_if(colors, [this](Range color) {
      return color.end - color.begin < shared_groups * team_.size();
    });
    for (auto color = colors.begin(); color != tail; ++color) {
      sweep(own.packed.groups.data(), part_of(*color, rank, team_.size()), fields);
      team_.barrier();
    }
    if (rank == 0 && tail != colors.end()) {
      sweep(own.packed.groups.data(), {tail->begin, colors.back().end}, fields);
    }
    team_.barrier();
  }

  // Jacobi: all elements from the same d, then each vertex sums what is its own, in a fixed order.
  template <class Elements>
  void gather_impulses(Elements& own, Sweep<T> sweep, int rank, Range mine) {
    fill_impulses(own, sweep, rank);
    for (int i = mine.begin; i < mine.end; ++i) d_[i].v += d_[i].w * impulse_on(own, i);
    team_.barrier();
  }
  template <class Elements>
  void fill_impulses(Elements& own, Sweep<T> sweep, int rank) {
    SweepFields<T> fields = fields_of(own);
    fields.impulses = own.impulses.data();
    const Range all{0, static_cast<int>(own.packed.groups.size())};
    sweep(own.packed.groups.data(), part_of(all, rank, team_.size()), fields);
    team_.barrier();
  }
  template <class Elements>
  static Vec3<T> impulse_on(const Elements& own, int vertex) {
    Vec3<T> sum;
    for (const int slot : own.slots_of(vertex)) sum += own.impulses[slot];
    return sum;
  }

  // Each thread has its blocks.
  Range blocks_of(int rank) const {
    return part_of({0, layout_.blocks->block_count()}, rank, team_.size());
  }
  Range copies_of(int rank) const { return layout_.blocks->split().range_of(blocks_of(rank)); }

  template <class Elements>
  void sweep_own_blocks(Elements& own, Sweep<T> sweep, int rank) {
    SweepFields<T> fields = fields_of(own);
    copies_->use(fields);
    for (const Range color : own.colors_of(blocks_of(rank))) {
      sweep(own.packed.groups.data(), color, fields);
    }
  }

  // Effect after effect, on the blocks' copies of the vertices.
  void sweep_blocks(Arithmetic arithmetic, int iteration, int rank, Range mine, Lap& lap) {
    const Range copies = copies_of(rank);
    if (iteration == 0 && damps_copies() && has_rate_forces()) {
      lead_copies(copies);
    } else {
      copies_->take(copies, u_, d_);
    }
    const auto sweep_those = [&](bool constraints) {
      Effects::for_each([&]<class Effect, std::size_t i>() {
        if constexpr (Effect::kind == EffectKind::element && !is_rate_force<Effect>) {
          if (is_constraint<Effect> != constraints) return;
          for (auto& own : std::get<i>(own_)) {
            if (!own.in_blocks()) continue;
            sweep_own_blocks(own, sweep_of<Effect>(arithmetic), rank);
            lap.took(i);
          }
        }
      });
    };
    if (iteration == 0) sweep_those(false);
    copies_->offset(copies);
    sweep_those(true);
    team_.barrier();
    copies_->average(mine, d_);
    team_.barrier();
    lap.took(step_part);
  }
  // Copies that rate forces have led apart get what forces, motions and contacts have done.
  void lead_copies(Range copies) {
    const T acts = program_.rule.acts;
    copies_->lead(copies, d_, [&](int v, Vec3<T>& damped) {
      const Vec3<T> inertial = acts * v_[v];
      for_each_contact([&]<class Effect>(const auto&, const std::vector<Vec3<T>>& correction) {
        if (touches(correction[v])) take_back_along(correction[v], inertial, damped);
      });
      damped += d_[v].v - inertial;
    });
  }

  // function(own, index of the effect)
  template <class Function>
  void for_each_self_contact(Function&& function) {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Effect::kind == EffectKind::self_contact) {
        for (auto& own : std::get<i>(own_)) function(own, i);
      }
    });
  }

  void push_contacts(Range mine, const Step<T>& step) {
    for_each_contact([&]<class Effect>(const auto& device, std::vector<Vec3<T>>& correction) {
      for (int i = mine.begin; i < mine.end; ++i) {
        correction[i] = {};
        if (!(d_[i].w > T(0))) continue;
        correction[i] = Effect::push(device, step, program_.rest[i], u_[i].v, d_[i].v);
        d_[i].v += correction[i];
      }
    });
  }

  void rub_contacts(Range mine, const Step<T>& step) {
    for_each_contact([&]<class Effect>(const auto& device, const std::vector<Vec3<T>>& correction) {
      for (int i = mine.begin; i < mine.end; ++i) {
        if (touches(correction[i])) Effect::rub(device, step, correction[i], v_[i], d_[i].v);
      }
    });
  }
  // The last word: no vertex passes through an obstacle.
  void stop_contacts(Range mine, const Step<T>& step) {
    for_each_contact([&]<class Effect>(const auto& device, const auto&) {
      if constexpr (can_stop<Effect, T>) {
        for (int i = mine.begin; i < mine.end; ++i) {
          if (!(d_[i].w > T(0))) continue;
          d_[i].v += Effect::stop(device, step, program_.rest[i], u_[i].v, d_[i].v);
        }
      }
    });
  }

  // function.operator()<Effect>(device, correction) for every contact effect that is on.
  template <class Function>
  void for_each_contact(Function&& function) {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Effect::kind == EffectKind::contact) {
        const auto& effects = std::get<i>(program_.effects);
        for (std::size_t k = 0; k < effects.size(); ++k) {
          function.template operator()<Effect>(effects[k].device, std::get<i>(own_)[k].correction);
        }
      }
    });
  }

  void end(Range mine) {
    for (int i = mine.begin; i < mine.end; ++i) {
      rule_.end(d_[i].w > T(0), d_[i].v, u_[i].v, v_[i], last_[i]);
    }
    if (rule_.share == T(0)) return;
    const auto after_stops = [&](std::span<const Vec3<T>> correction) {
      if (correction.empty()) return;
      for (int i = mine.begin; i < mine.end; ++i) {
        if (touches(correction[i])) rule_.after_stop(correction[i], v_[i], last_[i]);
      }
    };
    for_each_contact([&]<class Effect>(const auto&, const auto& own) { after_stops(own); });
    after_stops(volume_bound_.corrections());
  }

  template <class Effect>
  using Slot = OnCpu<Effect, T>;

  Program<T> program_;
  SolverOptions options_;
  TimeRule<T> rule_;  // of the frame at hand
  ElementLayout<T> layout_;
  SweepConstants<T> constants_;
  Effects::Slots<Slot> own_;
  std::optional<VertexCopies<T>> copies_;  // block Gauss-Seidel only
  SweepTable<T> sweeps_ = best_sweeps<T>();
  Team team_;
  Pace pace_;
  bool paced_;  // one thread may do in place of several
  CpuVolumeBound<T> volume_bound_;
  std::optional<CpuViscousStep<T>> viscous_step_;  // where damping is solved for
  Seconds seconds_{};
  int n_;
  std::uint64_t step_ = 0;
  std::vector<Row<T>> u_, d_;  // m; m over the substep, and dt^2 / m
  std::vector<Vec3<T>> v_;     // m/s
  std::vector<Added<T>> last_;
  // Where forces are held, m over the substep: they, and what the last sweep has added to them.
  std::vector<Vec3<T>> held_, added_;
};

}  // namespace

std::unique_ptr<Solver> make_cpu(const Model& model, const Scene& scene,
                                 const SolverOptions& options) {
  const SolverOptions own = options_for(scene, options);
  if (own.precision == Precision::fp64) {
    return std::make_unique<CpuSolver<double>>(model, scene, own);
  }
  return std::make_unique<CpuSolver<float>>(model, scene, own);
}

}  // namespace viscera::sim
