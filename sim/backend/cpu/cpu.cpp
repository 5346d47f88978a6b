// XPBD, PBD and TLED on a team of CPU threads. advance_frame() is the loop; what a thread does in a
// substep is in cpu/substep.hpp.
#include "sim/backend/cpu/cpu.hpp"

#include <algorithm>
#include <chrono>

#include "sim/backend/cpu/pace.hpp"
#include "sim/backend/cpu/substep.hpp"

namespace viscera::sim {
namespace {

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
      : body_(model, scene, options, thread_count(options.threads, model)),
        paced_((options.threads == 0 || options.spares_threads) && body_.team.most() > 1) {}

  void advance_frame() override {
    body_.choose_rule();
    if (body_.layout.holds) {
      body_.held = body_.program.held_by_vertex(body_.own, body_.rule.acts);
    }
    for (int left = body_.program.substeps; left > 0;) {
      body_.options.pause_point();
      const Pace::Stretch stretch =
          paced_ ? pace_.next(left) : Pace::Stretch{std::min(left, Pace::longest), false};
      const auto begin = Clock::now();
      const auto work = [this, stretch](int rank) {
        CpuSubstep<T> part(body_, rank);
        for (int k = 0; k < stretch.substeps; ++k) part.run(body_.step + k);
      };
      if (stretch.alone) {
        body_.team.run_alone(work);
      } else {
        body_.team.run(work);
      }
      pace_.took(stretch, std::chrono::duration<double>(Clock::now() - begin).count());
      body_.step += stretch.substeps;
      left -= stretch.substeps;
    }
  }

  State state() const override {
    State state{{}, cast_all<double>(body_.v), body_.step};
    for (int i = 0; i < body_.n; ++i) state.u.push_back(cast<double>(body_.u[i].v));
    save_history(body_.own, state);
    if (body_.layout.holds) save_held(body_.own, state);
    if (body_.replicas) body_.replicas->save(state);
    if (body_.program.rule.share > T(0)) body_.program.save_added(body_.last, state);
    return state;
  }
  void set_state(const State& state) override {
    VISCERA_ASSERT(state.u.size() == body_.u.size() && state.v.size() == body_.u.size(),
                   state.u.size() << " and " << state.v.size() << " of " << body_.u.size());
    for (int i = 0; i < body_.n; ++i) body_.u[i].v = cast<T>(state.u[i]);
    body_.v = cast_all<T>(state.v);
    body_.last = body_.program.added_before(state);
    body_.step = state.step;
    body_.volume_bound.begin_at(state);
    load_history(body_.own, state);
    if (body_.layout.holds) load_held(body_.own, state, body_.program.held_numbers());
    if (body_.replicas) body_.replicas->load(state);
  }
  void retune(const Model& model, const Scene& scene) override {
    check_scene(scene);
    body_.program.retune(program_for<T>(model, scene, body_.options, body_.replica_counts()));
    const bool relaid =
        body_.layout.solves_damping != static_cast<bool>(body_.program.viscous_step);
    if (relaid) body_.prepare_damping();
    Effects::for_each([&]<class Effect, std::size_t i>() {
      retune_all<Effect>(std::get<i>(body_.own), std::get<i>(body_.program.effects), body_.layout,
                         relaid);
    });
  }
  void steer(const Scene& scene) override {
    check_scene(scene);
    body_.program.steer(scene);
  }
  std::size_t contact_count() const override {
    std::size_t count = 0;
    for_each_slot<EffectKind::contact>(body_.own, [&count]<class Effect>(const auto& own) {
      count += std::ranges::count_if(own.correction, touches<T>);
    });
    for_each_slot<EffectKind::self_contact>(
        body_.own, [&count]<class Effect>(const auto& own) { count += own.count(); });
    return count;
  }
  ActingDamping damping() const override {
    const ViscousStep& step = body_.program.viscous_step;
    return {static_cast<bool>(step), step.passes, body_.replica_counts()};
  }
  double unsettled_force() const override {
    double sum = 0.0;
    for (int i = 0; i < static_cast<int>(body_.added.size()); ++i) {
      if (body_.d[i].w > T(0))
        sum += norm(cast<double>(body_.added[i])) / static_cast<double>(body_.d[i].w);
    }
    return sum;
  }
  std::string device() const override {
    return "cpu, " + std::to_string(body_.team.most()) + " threads";
  }
  std::vector<std::pair<std::string, double>> seconds() const override {
    std::vector<std::pair<std::string, double>> named = {
        {"step", body_.seconds[CpuBody<T>::step_part]}};
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if (body_.seconds[i] > 0.0) named.emplace_back(Effect::name, body_.seconds[i]);
    });
    return named;
  }

 private:
  CpuBody<T> body_;
  Pace pace_;
  bool paced_;  // one thread may do in place of several
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
