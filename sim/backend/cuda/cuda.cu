// XPBD, PBD and TLED on a CUDA device: the same effects as the CPU, one kernel per pass and per
// colour, captured once as a graph and launched as one. Elements of a colour touch disjoint
// vertices, and where all are solved from the same state (Jacobi, TLED) each vertex gathers its own
// in a fixed order, so two runs on one device give the same bits.
#include <cuda_runtime.h>

#include <algorithm>
#include <optional>
#include <type_traits>

#include "sim/backend/cuda/blocks.hpp"
#include "sim/backend/cuda/cuda.hpp"
#include "sim/backend/cuda/effects.cuh"
#include "sim/backend/cuda/kernels.cuh"
#include "sim/backend/cuda/memory.cuh"
#include "sim/backend/cuda/viscous_step.cuh"
#include "sim/backend/cuda/volume_bound.cuh"
#include "sim/solvers/across_devices.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {
namespace {

template <class T>
class CudaSolver final : public Solver {
 public:
  CudaSolver(const Model& model, const Scene& scene, const SolverOptions& options, std::string name)
      : CudaSolver(program_for<T>(model, scene, options),
                   BoundedTets<T>(model, scene, options.method), options, std::move(name)) {}

  void advance_frame() override {
    const bool smooth = program_.rule.share == T(0) || volume_bound_.acts();
    const Graph& graph = smooth ? graph_ : graph_to_first_order_;
    if (layout_.holds) {
      const TimeRule<T> rule = smooth ? program_.rule : program_.rule.to_first_order();
      held_.upload(program_.held_by_vertex(effects_, rule.acts));
    }
    for (int substep = 0; substep < substeps_; ++substep, ++step_) {
      options_.pause_point();
      if (program_.viscous_step.is_due(step_)) viscous_step_->apply(stream_);
      graph.launch(stream_, "launching a substep");
    }
    stream_.finish("running a frame");
    for_each_active<EffectKind::self_contact>(
        [&]<class Effect>(const auto& effect) { effect.check_room(); });
  }
  State motion() const override {
    return {cast_all<double>(u_.download()), cast_all<double>(v_.download()), done_.download()[0]};
  }
  std::optional<DeviceMotion> motion_on_device() override {
    return DeviceMotion{.u = u_.get(),
                        .v = v_.get(),
                        .vertices = static_cast<std::size_t>(n_),
                        .bytes = sizeof(T),
                        .device = current_device()};
  }
  State state() const override {
    State state = motion();
    save_history(effects_, state);
    if (layout_.holds) save_held(effects_, state);
    if (program_.rule.share > T(0)) program_.save_added(last_.download(), state);
    return state;
  }
  void set_state(const State& state) override {
    u_.upload(cast_all<T>(state.u));
    v_.upload(cast_all<T>(state.v));
    last_.upload(program_.added_before(state));
    done_.upload({state.step});
    step_ = state.step;
    volume_bound_.begin_at(state);
    load_history(effects_, state);
    if (layout_.holds) load_held(effects_, state, program_.held_numbers());
    for_each_slot<EffectKind::self_contact>(effects_,
                                            [&]<class Effect>(auto& effect) { effect.forget(); });
  }
  void retune(const Model& model, const Scene& scene) override {
    check_scene(scene);
    program_.retune(program_for<T>(model, scene, options_));
    const bool relaid = layout_.solves_damping != static_cast<bool>(program_.viscous_step);
    if (relaid) prepare_damping();
    Effects::for_each([&]<class Effect, std::size_t i>() {
      retune_all<Effect>(std::get<i>(effects_), std::get<i>(program_.effects), layout_, relaid);
    });
    capture();
  }
  void steer(const Scene& scene) override {
    check_scene(scene);
    program_.steer(scene);
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (is_steered<Effect>) {
        const auto& effects = std::get<i>(program_.effects);
        for (std::size_t k = 0; k < effects.size(); ++k) {
          std::get<i>(effects_)[k].retune(effects[k]);
        }
      }
    });
    capture();
  }
  std::size_t contact_count() const override {
    std::size_t count = 0;
    for_each_active<EffectKind::contact>([&count]<class Effect>(const auto& effect) {
      count += std::ranges::count_if(effect.correction.download(), touches<T>);
    });
    for_each_active<EffectKind::self_contact>(
        [&count]<class Effect>(const auto& effect) { count += effect.count(); });
    return count;
  }
  ActingDamping damping() const override {
    return {static_cast<bool>(program_.viscous_step), program_.viscous_step.passes};
  }
  double unsettled_force() const override {
    if (!layout_.holds) return 0.0;
    const auto added = added_.download();
    double sum = 0.0;
    for (int i = 0; i < n_; ++i) {
      const T w = program_.inverse_mass[i];
      const double acts = program_.acts_s;
      if (w > T(0)) sum += norm(cast<double>(added[i])) / (static_cast<double>(w) * acts * acts);
    }
    return sum;
  }
  std::string device() const override { return "cuda, " + name_; }
  bool off_host() const override { return true; }
  SubstepWork substep_work() const override {
    // At the start and the end of a substep, and by each force: w, u, v, d and what was added.
    double bytes = n_ * (4.0 * sizeof(T) + 10.0 * sizeof(Vec3<T>) + 5.0 * sizeof(Added<T>));
    for_each_active<EffectKind::element>([&]<class Effect>(const auto& effect) {
      const double of_vertex = sizeof(T) + 3.0 * sizeof(Vec3<T>);
      bytes += static_cast<double>(effect.coloring.order.size()) *
               (sizeof(effect.vertices.get()[0]) + sizeof(effect.rest.get()[0]) +
                2.0 * history_of<Effect> * sizeof(T) + Effect::arity * of_vertex);
    });
    return {.global_bytes = bytes, .launches = static_cast<int>(graph_.size())};
  }

 private:
  template <class Effect>
  using Slot = OnDevice<Effect, T>;

  CudaSolver(Program<T>&& program, const BoundedTets<T>& bounded, const SolverOptions& options,
             std::string name)
      : name_(std::move(name)),
        options_(options),
        constants_(SweepConstants<T>::of(options)),
        program_(std::move(program)),
        n_(static_cast<int>(program_.rest.size())),
        dt_(program_.dt),
        substeps_(program_.substeps),
        layout_{n_, options.method == Method::tled || options.scheme == Scheme::jacobi,
                iterates(options), options.method == Method::xpbd && options.hold > 0.0,
                static_cast<bool>(program_.viscous_step)},
        rest_((require_memory(program_, layout_, bounded), program_.rest)),
        inverse_mass_(program_.inverse_mass),
        u_(n_),
        v_(n_),
        d_(n_),
        last_(n_),
        volume_bound_(bounded, n_),
        done_(1) {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      for (const auto& host : std::get<i>(program_.effects)) {
        std::get<i>(effects_).emplace_back(host, layout_);
      }
    });
    if (layout_.holds) held_ = DeviceArray<Vec3<T>>(n_), added_ = DeviceArray<Vec3<T>>(n_);
    prepare_damping();
    const std::vector<Vec3<double>> still(n_);
    last_.upload(program_.added_before({still, still}));
    capture();
  }

  void prepare_damping() {
    layout_.solves_damping = static_cast<bool>(program_.viscous_step);
    viscous_step_.reset();
    if (program_.viscous_step) viscous_step_.emplace(n_, inverse_mass_.get());
  }

  static void require_memory(const Program<T>& program, const DeviceLayout& layout,
                             const BoundedTets<T>& bounded) {
    const std::size_t n = program.rest.size();
    std::size_t bytes = n * (4 * sizeof(Vec3<T>) + sizeof(Added<T>) + 2 * sizeof(T)) +
                        CudaVolumeBound<T>::bytes(bounded, n);
    if (layout.holds) bytes += n * 2 * sizeof(Vec3<T>);
    if (layout.solves_damping) bytes += CudaViscousStep<T>::bytes(n);
    for_each_slot<EffectKind::element>(program.effects, [&]<class Effect>(const auto& effect) {
      const std::size_t kept = history_of<Effect> + Slot<Effect>::kept_by(layout);
      const bool gathers = is_rate_force<Effect> ? layout.solves_damping : layout.gathers;
      const std::size_t gathered = gathers ? sizeof(Vec3<T>) + sizeof(int) : 0;
      bytes += effect.rest.size() * (sizeof(effect.rest[0]) + sizeof(effect.vertices[0]) +
                                     kept * sizeof(T) + gathered * Effect::arity);
    });
    for_each_slot<EffectKind::region>(program.effects, [&]<class Effect>(const auto& effect) {
      bytes += CudaRegions<T>::bytes(effect.regions, layout.iterates);
    });
    for_each_slot<EffectKind::contact>(
        program.effects, [&]<class Effect>(const auto&) { bytes += n * sizeof(Vec3<T>); });
    for_each_slot<EffectKind::self_contact>(program.effects, [&]<class Effect>(const auto& effect) {
      bytes += CudaSelfContact<T>::bytes(effect.pairs, n);
    });
    require_device_memory(bytes);
  }

  // What travels as a kernel argument is part of the graph.
  void capture() {
    graph_ = substep_by(program_.rule);
    if (program_.rule.share > T(0)) {
      graph_to_first_order_ = substep_by(program_.rule.to_first_order());
    }
    if (!viscous_step_) return;
    const auto enqueue_decay = [this](Arithmetic arithmetic, const Vec3<T>* velocity,
                                      Vec3<T>* out) {
      move_by<T>
          <<<blocks(n_), block_size, 0, stream_>>>(n_, velocity, program_.rule.acts, d_.get());
      for_each_active<EffectKind::element>([&]<class Effect>(const auto& own) {
        if constexpr (is_rate_force<Effect>) {
          if (arithmetic == Arithmetic::in_full) {
            enqueue_elements<Effect, Arithmetic::in_full>(own, 0, own.coloring.color_begin.back(),
                                                          program_.rule.acts);
          } else {
            enqueue_elements<Effect, Arithmetic::resisted>(own, 0, own.coloring.color_begin.back(),
                                                           program_.rule.acts);
          }
          add_decay<T><<<blocks(n_), block_size, 0, stream_>>>(
              n_, own.slots_begin.get(), own.slots.get(), own.impulses.get(), inverse_mass_.get(),
              static_cast<T>(program_.viscous_step.tau()), out);
        }
      });
    };
    viscous_step_->capture(stream_, program_.rule, v_.get(), last_.get(), enqueue_decay);
  }

  Graph substep_by(const TimeRule<T>& rule) const {
    return Graph(stream_, [&] {
      Enqueue on(*this, rule);
      substep(on);
      check(cudaGetLastError(), "launching a kernel");
    });
  }

  static int blocks(int threads) { return (threads + block_size - 1) / block_size; }

  DeviceVertices<T> vertices() const {
    return {inverse_mass_.get(), rest_.get(), u_.get(), v_.get(), d_.get(),
            last_.get(),         done_.get(), dt_};
  }

  // Enqueues a substep (step/substep.hpp), one kernel after the other.
  class Enqueue {
   public:
    using Number = T;

    Enqueue(const CudaSolver& solver, const TimeRule<T>& rule)
        : s_(solver), rule_(rule), acts_(rule.acts) {}

    const TimeRule<T>& rule() const { return rule_; }
    const TimeRule<T>& usual_rule() const { return s_.program_.rule; }

    void find_compressed() const {}  // bound_compression() does
    void solve_damping() const {}    // the host does, before it launches the substep
    void act_over(T acts) { acts_ = acts; }

    template <class VertexStep>
    void for_each_vertex(const VertexStep& step) const {
      sim::for_each_vertex<<<blocks(s_.n_), block_size, 0, s_.stream_>>>(s_.n_, s_.vertices(),
                                                                         step);
    }
    template <class Motion, class VertexStep>
    void for_each_led(const Motion& motion, const VertexStep& step) const {
      const int count = static_cast<int>(motion.vertices.size());
      if (count == 0) return;
      sim::for_each_led<<<blocks(count), block_size, 0, s_.stream_>>>(count, motion.vertices.get(),
                                                                      s_.vertices(), step);
    }
    template <class VertexStep>
    void end(const VertexStep& step) const {
      sim::end<<<blocks(s_.n_), block_size, 0, s_.stream_>>>(s_.n_, s_.vertices(), step);
    }
    template <EffectKind kind, class Function>
    void for_each_effect(Function&& function) const {
      s_.template for_each_active<kind>([&]<class Effect>(const auto& effect) {
        if constexpr (kind == EffectKind::contact) {
          const Contact<Effect> contact{effect.device, effect.correction.get()};
          function.template operator()<Effect>(contact);
        } else {
          function.template operator()<Effect>(effect);
        }
      });
    }

    bool sweeps_rate_forces() const {
      bool any = false;
      for_each_effect<EffectKind::element>([&any]<class Effect>(const auto&) {
        if constexpr (is_rate_force<Effect>) any = true;
      });
      return any && !s_.viscous_step_;
    }
    void sweep_rate_forces() const {
      for_each_effect<EffectKind::element>([&]<class Effect>(const auto& effect) {
        if constexpr (is_rate_force<Effect>) {
          for (int pass = 0; pass < s_.program_.viscous_step.passes; ++pass) {
            s_.template enqueue_sweep<Effect, Arithmetic::xpbd_only>(effect, acts_);
          }
        }
      });
    }

    bool holds_forces() const { return s_.layout_.holds; }
    Vec3<T>* held() const { return s_.held_.get(); }
    Vec3<T>* added() const { return s_.added_.get(); }
    T renewed() const { return s_.constants_.renewed; }

    void apply_loads() const {
      for_each_effect<EffectKind::element>(
          [&]<class Effect>(const auto& effect) { apply_load(effect); });
    }

    int iterations() const { return s_.options_.iterations; }
    // Forces (rows = 0) act once a substep.
    void solve_elements(int iteration) const {
      const Arithmetic arithmetic = arithmetic_of(s_.options_, iteration);
      Effects::for_each([&]<class Effect, std::size_t i>() {
        for (const auto& own : std::get<i>(s_.effects_)) {
          if constexpr (Effect::kind == EffectKind::region) {
            own.enqueue(s_.stream_, arithmetic, s_.options_.stiffness,
                        {s_.u_.get(), s_.d_.get(), s_.inverse_mass_.get()});
          } else if constexpr (Effect::kind == EffectKind::element) {
            if constexpr (is_constraint<Effect>) {
              s_.template enqueue_sweep_by<Effect>(own, arithmetic, acts_);
            } else if (iteration == 0 && !holds_forces()) {
              apply_load(own);
            }
          }
        }
      });
    }

    template <class SelfContact>
    void separate(const SelfContact& effect) const {
      effect.enqueue(s_.stream_, s_.u_.get(), s_.d_.get(), s_.inverse_mass_.get());
    }
    void bound_compression() const {
      s_.volume_bound_.enqueue(s_.stream_, s_.u_.get(), s_.d_.get(), s_.inverse_mass_.get(),
                               rule_.acts, s_.done_.get(), s_.substeps_);
    }
    const Vec3<T>* bound_corrections() const { return s_.volume_bound_.corrections(); }

   private:
    template <class Effect>
    struct Contact {
      const typename Effect::template Device<T>& device;
      Vec3<T>* correction;  // [n] m, on the device
    };

    template <class Effect>
    void apply_load(const OnDevice<Effect, T>& own) const {
      if constexpr (!is_constraint<Effect> && !is_rate_force<Effect>)
        s_.template enqueue_sweep<Effect, Arithmetic::xpbd_only>(own, acts_);
    }

    const CudaSolver& s_;
    TimeRule<T> rule_;
    T acts_;  // s
  };

  template <class Effect>
  void enqueue_sweep_by(const OnDevice<Effect, T>& own, Arithmetic arithmetic, T acts) const {
    using enum Arithmetic;
    switch (arithmetic) {
      case xpbd_only:
        return enqueue_sweep<Effect, xpbd_only>(own, acts);
      case xpbd_first:
        return enqueue_sweep<Effect, xpbd_first>(own, acts);
      case xpbd_next:
        return enqueue_sweep<Effect, xpbd_next>(own, acts);
      case xpbd_held:
        return enqueue_sweep<Effect, xpbd_held>(own, acts);
      case force:
        return enqueue_sweep<Effect, force>(own, acts);
      case pbd:
        if constexpr (is_projectable<Effect>) enqueue_sweep<Effect, pbd>(own, acts);
        return;
      case in_full:
      case resisted:
        return;  // of rate forces, which are no constraints
    }
  }

  template <class Effect, Arithmetic arithmetic>
  void enqueue_sweep(const OnDevice<Effect, T>& own, T acts) const {
    const auto& colors = own.coloring.color_begin;
    if (!own.gathers) {
      for (std::size_t c = 0; c + 1 < colors.size(); ++c) {
        enqueue_elements<Effect, arithmetic>(own, colors[c], colors[c + 1], acts);
      }
      return;
    }
    enqueue_elements<Effect, arithmetic>(own, 0, colors.back(), acts);
    gather_impulses<T><<<blocks(n_), block_size, 0, stream_>>>(n_, own.slots_begin.get(),
                                                               own.slots.get(), own.impulses.get(),
                                                               inverse_mass_.get(), acts, d_.get());
  }

  template <class Effect, Arithmetic arithmetic>
  void enqueue_elements(const OnDevice<Effect, T>& own, int first, int last, T acts) const {
    if (first == last) return;
    solve_elements<Effect, arithmetic, T><<<blocks(last - first), block_size, 0, stream_>>>(
        first, last, own.view(), inverse_mass_.get(), u_.get(), d_.get(), constants_, acts);
  }

  template <EffectKind kind, class Function>
  void for_each_active(Function&& function) const {
    for_each_slot<kind>(effects_, function);
  }

  std::string name_;
  SolverOptions options_;
  SweepConstants<T> constants_;
  Program<T> program_;  // what was uploaded; kept to be compared with
  int n_;
  double dt_;  // s
  int substeps_;
  DeviceLayout layout_;
  DeviceArray<Vec3<T>> rest_;
  DeviceArray<T> inverse_mass_;
  DeviceArray<Vec3<T>> u_, v_, d_;
  DeviceArray<Added<T>> last_;
  // Where forces are held, m over the substep: they, and what the last sweep has added to them.
  DeviceArray<Vec3<T>> held_, added_;
  CudaVolumeBound<T> volume_bound_;
  std::optional<CudaViscousStep<T>> viscous_step_;  // where damping is solved for
  DeviceArray<unsigned long long> done_;            // [1] substeps
  std::uint64_t step_ = 0;                          // the same, for the host
  Effects::Slots<Slot> effects_;
  Stream stream_;
  Graph graph_, graph_to_first_order_;
};

}  // namespace

CudaDevice find_cuda_device() {
  int count = 0;
  if (const cudaError_t status = cudaGetDeviceCount(&count); status != cudaSuccess) {
    return {.why_not = cudaGetErrorString(status)};
  }
  cudaDeviceProp properties{};
  if (count == 0 || cudaGetDeviceProperties(&properties, 0) != cudaSuccess) {
    return {.why_not = "no device found"};
  }
  return {.name = properties.name, .count = count};
}

namespace {

std::unique_ptr<Solver> make_by_kernels(const Model& model, const Scene& scene,
                                        const SolverOptions& options, const std::string& name) {
  const SolverOptions own = options_for(scene, options);
  if (own.precision == Precision::fp64) {
    return std::make_unique<CudaSolver<double>>(model, scene, own, name);
  }
  return std::make_unique<CudaSolver<float>>(model, scene, own, name);
}

}  // namespace

std::unique_ptr<Ensemble> make_ensemble_on_cuda(const Model& model, const Scene& scene,
                                                const SolverOptions& options, int members,
                                                const Tune& tune) {
  check_scene(scene);
  check_options(scene, options);
  const CudaDevice device = find_cuda_device();
  if (!device.name) {
    throw Refusal(Refusal::Cause::device, "device", device.why_not, "a CUDA device and its driver",
                  "use device: cpu or auto");
  }
  if (const std::string lacks = what_cuda_lacks(scene, options); !lacks.empty()) {
    throw Refusal(Refusal::Cause::scene, "device", "cuda, which does not run " + lacks,
                  "xpbd, pbd or tled; in blocks xpbd with one iteration a substep and no region",
                  "use another scheme, or device: cpu or auto");
  }
  if (const int most = std::min(device.count, most_devices); options.devices > most) {
    throw Refusal(Refusal::Cause::device, "devices", std::to_string(options.devices),
                  "at most " + std::to_string(most) + ", of the " + std::to_string(device.count) +
                      " that this machine has",
                  "use fewer");
  }
  const auto make_one = [&](const Model& own_model, const Scene& own_scene) {
    return in_blocks(options) ? std::make_unique<OnlyMember>(make_cuda_blocks(
                                    own_model, own_scene, options, 1, *device.name))
                              : make_by_kernels(own_model, own_scene, options, *device.name);
  };
  // Blocks with self-contact, or on several devices, are of one body.
  const bool alone = scene.has<SelfContact>() || options.devices > 1;
  if (!in_blocks(options) || (alone && members > 1)) {
    return std::make_unique<Separately>(model, scene, members, tune, make_one);
  }
  const auto make_some = [&](int first, int count) {
    auto ensemble = make_cuda_blocks(model, scene, options, count, *device.name);
    for (int member = 0; tune && member < count; ++member) {
      const auto [own_model, own_scene] = tuned(model, scene, first + member, tune);
      ensemble->retune(member, own_model, own_scene);
    }
    return ensemble;
  };
  const int devices = std::min(device.count, members);
  if (devices == 1) return make_some(0, members);
  return std::make_unique<AcrossDevices>(devices, members, on_device, make_some);
}

}  // namespace viscera::sim
