// The XPBD substep on CPU threads (TBB). Loops run over vertices or over the elements of one
// colour, which touch disjoint data: any number of threads gives the same bits.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>

#include "sim/backend/backend.hpp"
#include "sim/backend/cpu_sweep.hpp"

namespace viscera::sim {
namespace {

// body(begin, end) over parts of the range. Below the grain the hand-over costs more than the work.
template <class Body>
void parallel_ranges(int begin, int end, Body&& body, int grain = 64) {
  if (end - begin <= grain) return body(begin, end);
  tbb::parallel_for(tbb::blocked_range<int>(begin, end, grain),
                    [&](const auto& range) { body(range.begin(), range.end()); });
}

template <class Body>
void parallel_loop(int begin, int end, Body&& body) {
  constexpr int grain = 1024;
  const auto loop = [&body](int first, int last) {
    for (int i = first; i < last; ++i) body(i);
  };
  parallel_ranges(begin, end, loop, grain);
}

// With the widest instructions that this machine has; the results do not depend on it.
template <class T>
SweepTable<T> best_sweeps() {
  std::tuple<SweepTable<float>, SweepTable<double>> tables{};
  auto& [table32, table64] = tables;
#if defined(VISCERA_AVX2)
  if (__builtin_cpu_supports("avx2")) {
    fill_sweeps_avx2(table32, table64);
    return std::get<SweepTable<T>>(tables);
  }
#endif
  fill_sweeps_baseline(table32, table64);
  return std::get<SweepTable<T>>(tables);
}

// What one effect keeps on the CPU beside its Prepared data.
template <class Effect, class T, EffectKind kind = Effect::kind>
struct OnCpu {
  OnCpu(const Prepared<Effect, T>&, int) {}
};
template <class Effect, class T>
struct OnCpu<Effect, T, EffectKind::element> {
  PackedElements<Effect, T> packed;

  OnCpu(const Prepared<Effect, T>& elements, int vertices) : packed(elements, vertices) {}
};
template <class Effect, class T>
struct OnCpu<Effect, T, EffectKind::contact> {
  std::vector<T> depth;  // [n] m, corrected in this substep; 0: not in contact

  OnCpu(const Prepared<Effect, T>&, int vertices) : depth(vertices) {}
};

template <class T>
class XpbdCpu final : public Solver {
 public:
  XpbdCpu(const Model& model, const Scene& scene, int threads)
      : program_(model, scene),
        arena_(threads > 0 ? threads : tbb::task_arena::automatic),
        n_(static_cast<int>(model.vertex_count())),
        u_(n_ + 1),
        v_(n_),
        d_(n_ + 1) {
    program_.inverse_mass.push_back(T(0));  // of the spare vertex
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if (const auto& effect = std::get<i>(program_.effects)) {
        std::get<i>(own_).emplace(*effect, n_);
      }
    });
  }

  void advance_frame() override {
    arena_.execute([this] {
      for (int substep = 0; substep < program_.substeps; ++substep) {
        begin();
        apply_forces();
        push_contacts();
        solve_elements();
        rub_contacts();
        end();
      }
    });
  }

  State state() const override {
    State state{cast_all<double>(u_), cast_all<double>(v_)};
    state.u.pop_back();  // the spare vertex
    return state;
  }
  void set_state(const State& state) override {
    u_ = cast_all<T>(state.u);
    u_.emplace_back();
    v_ = cast_all<T>(state.v);
  }
  std::size_t contact_count() const override {
    std::size_t count = 0;
    for_each_slot<EffectKind::contact>(own_, [&count]<class Effect>(const auto& own) {
      count += std::ranges::count_if(own.depth, [](T depth) { return depth > T(0); });
    });
    return count;
  }
  std::string device() const override {
    return "cpu, " + std::to_string(arena_.max_concurrency()) + " threads";
  }

 private:
  void begin() {
    parallel_loop(
        0, n_, [&](int i) { d_[i] = begin_vertex(program_.inverse_mass[i], v_[i], program_.dt); });
  }

  void apply_forces() {
    const T dt2 = program_.dt * program_.dt;
    program_.template for_each_active<EffectKind::force>([&]<class Effect>(const auto& effect) {
      parallel_loop(0, n_, [&](int i) {
        if (program_.inverse_mass[i] > T(0)) {
          d_[i] += dt2 * Effect::acceleration(effect.device, program_.rest[i], u_[i], v_[i]);
        }
      });
    });
  }

  void solve_elements() {
    const SweepFields<T> fields{program_.inverse_mass.data(), u_.data(), d_.data(), program_.dt};
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Effect::kind == EffectKind::element) {
        if (const auto& own = std::get<i>(own_)) sweep_colors(own->packed, sweeps_[i], fields);
      }
    });
  }

  template <class Elements>
  void sweep_colors(const Elements& elements, Sweep<T> sweep, const SweepFields<T>& fields) {
    for (std::size_t color = 0; color + 1 < elements.color_begin.size(); ++color) {
      parallel_ranges(
          elements.color_begin[color], elements.color_begin[color + 1],
          [&](int begin, int end) { sweep(elements.groups.data(), begin, end, fields); });
    }
  }

  void push_contacts() {
    for_each_contact([&]<class Effect>(const auto& device, std::vector<T>& depth) {
      parallel_loop(0, n_, [&](int i) {
        depth[i] = program_.inverse_mass[i] > T(0)
                       ? Effect::push(device, program_.rest[i], u_[i], d_[i])
                       : T(0);
      });
    });
  }

  void rub_contacts() {
    for_each_contact([&]<class Effect>(const auto& device, const std::vector<T>& depth) {
      parallel_loop(0, n_, [&](int i) {
        if (depth[i] > T(0)) Effect::rub(device, depth[i], d_[i]);
      });
    });
  }

  // function.operator()<Effect>(device, depth) for every contact effect that is on.
  template <class Function>
  void for_each_contact(Function&& function) {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Effect::kind == EffectKind::contact) {
        if (const auto& effect = std::get<i>(program_.effects)) {
          function.template operator()<Effect>(effect->device, std::get<i>(own_)->depth);
        }
      }
    });
  }

  void end() {
    parallel_loop(0, n_, [&](int i) { end_vertex(d_[i], program_.dt, u_[i], v_[i]); });
  }

  template <class Effect>
  using Slot = OnCpu<Effect, T>;

  XpbdProgram<T> program_;
  Effects::Slots<Slot> own_;
  SweepTable<T> sweeps_ = best_sweeps<T>();
  tbb::task_arena arena_;
  int n_;
  std::vector<Vec3<T>> u_, v_, d_;  // m, m/s, m over the substep; u and d with a spare vertex
};

}  // namespace

std::unique_ptr<Solver> make_xpbd_cpu(const Model& model, const Scene& scene, Precision precision,
                                      int threads) {
  check_scene(scene);
  if (precision == Precision::fp64) return std::make_unique<XpbdCpu<double>>(model, scene, threads);
  return std::make_unique<XpbdCpu<float>>(model, scene, threads);
}

}  // namespace viscera::sim
