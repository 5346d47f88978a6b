// Block Gauss-Seidel on a CUDA device: what the kernel of a frame (cuda_block_kernel.cuh) is given,
// where it lies on the device, and how states enter and leave.
#include <cuda_runtime.h>

#include <algorithm>

#include "sim/backend/cuda_block_kernel.cuh"
#include "sim/backend/cuda_blocks.hpp"
#include "sim/backend/cuda_memory.cuh"

namespace viscera::sim {
namespace {

constexpr int least_block = 150;  // tets: smaller blocks cost accuracy and are no faster
// What one element effect keeps on the device.
template <class Effect, class T>
struct DeviceElements {
  std::vector<int> element_of;
  int most, most_phases;  // in a block
  DeviceArray<LocalVertices<Effect::arity>> vertices;
  DeviceArray<AlignedRest<typename Effect::template Rest<T>>> rest;
  DeviceArray<int> phase_begin, block_phase;
  DeviceArray<T> memory;

  explicit DeviceElements(BlockElements<Effect, T>&& host)
      : element_of(std::move(host.element_of)),
        most(0),
        most_phases(0),
        vertices(host.vertices),
        rest(host.rest),
        phase_begin(host.phase_begin),
        block_phase(host.block_phase),
        memory(host.rest.size() * memory_of<Effect>) {
    for (std::size_t block = 0; block + 1 < host.block_phase.size(); ++block) {
      const int b = static_cast<int>(block);
      most = std::max(most, host.block_begin(b + 1) - host.block_begin(b));
      most_phases = std::max(most_phases, host.block_phase[b + 1] - host.block_phase[b]);
    }
  }

  void save_memory(std::vector<double>& all) const {
    if constexpr (memory_of<Effect> != 0) save_kept<memory_of<Effect>>(memory, element_of, all);
  }
  void load_memory(std::span<const double>& all) {
    if constexpr (memory_of<Effect> != 0) load_kept<memory_of<Effect>>(memory, element_of, all);
  }
};

template <class Effect, class T, EffectKind kind = Effect::kind>
struct Own {};
template <class Effect, class T>
struct Own<Effect, T, EffectKind::element> : DeviceElements<Effect, T> {
  using DeviceElements<Effect, T>::DeviceElements;
};

template <class T>
class CudaBlocks final : public Solver {
 public:
  CudaBlocks(const Model& model, const Scene& scene, int tets_per_block, std::string name)
      : name_(std::move(name)),
        program_(model, scene),
        layout_(model, program_, tets_per_block, team_for(tets_per_block)),
        u_(layout_.copy_count()),
        v_(layout_.copy_count()),
        parcels_(2 * static_cast<std::size_t>(layout_.copy_count())) {
    place_copies();
    place_effects();
    upload_views();
    frame_.u = u_.get();
    frame_.v = v_.get();
    frame_.parcels = parcels_.get();
    frame_.copies = layout_.copy_count();
    frame_.dt = program_.dt;
    frame_.substeps = program_.substeps;
    frame_.team = layout_.lanes();
    frame_.scene.dt = static_cast<T>(program_.dt);
    touching_ = DeviceArray<unsigned char>(static_cast<std::size_t>(frame_.scene.contacts) *
                                           layout_.copy_count());
    frame_.touching = touching_.get();
    check(cudaFuncSetAttribute(kernel_.run, cudaFuncAttributeMaxDynamicSharedMemorySize,
                               static_cast<int>(shared_bytes_)),
          "asking for shared memory");
  }

  void advance_frame() override {
    frame_.done = step_;
    void* arguments[] = {&frame_};
    check(cudaLaunchCooperativeKernel(kernel_.run, dim3(layout_.block_count()),
                                      dim3(kernel_.threads), arguments, shared_bytes_, nullptr),
          "launching a frame");
    check(cudaDeviceSynchronize(), "running a frame");
    step_ += frame_.substeps;
  }

  State state() const override {
    State state{gathered(u_.download()), gathered(v_.download()), step_};
    save_memory(own_, state);
    return state;
  }
  void set_state(const State& state) override {
    u_.upload(spread(state.u));
    v_.upload(spread(state.v));
    step_ = state.step;
    // Parcels of an exchange that is to come again must not be taken for it.
    parcels_ = DeviceArray<Parcel<T>>(parcels_.size());
    frame_.parcels = parcels_.get();
    load_memory(own_, state);
  }
  void retune(const Model& model, const Scene& scene) override {
    check_scene(scene);
    program_.retune({model, scene});
    Effects::for_each([&]<class Effect, std::size_t i>() {
      const auto& effects = std::get<i>(program_.effects);
      for (std::size_t k = 0; k < effects.size(); ++k) {
        if constexpr (Effect::kind == EffectKind::element) {
          auto& own = std::get<i>(own_)[k];
          own.rest.upload(layout_.rest_of(effects[k], own.element_of));
        } else if constexpr (requires { effects[k].device; }) {
          std::get<i>(host_views_)[k].device = effects[k].device;
        }
      }
    });
    upload_views();
  }
  std::size_t contact_count() const override {
    const auto touching = touching_.download();
    std::size_t count = 0;
    for (int k = 0; k < frame_.scene.contacts; ++k) {
      for (int v = 0; v < vertex_count(); ++v) {
        count += touching[static_cast<std::size_t>(k) * frame_.copies + layout_.copies_of(v)[0]];
      }
    }
    return count;
  }
  std::string device() const override { return "cuda, " + name_; }

 private:
  template <class Effect>
  using View = BlockView<Effect, T>;
  template <class Effect>
  using OwnOf = Own<Effect, T>;
  template <class Effect>
  using ViewArray = DeviceArray<BlockView<Effect, T>>;
  template <class Effect>
  struct ArrayOf {
    ViewArray<Effect> array;
  };

  void place_copies() {
    const T dt2 = static_cast<T>(program_.dt) * static_cast<T>(program_.dt);
    std::vector<Vec3<T>> rest;
    std::vector<T> inverse_mass, mobility;
    std::vector<int> copy_begin = {0}, gather_begin = {0}, gather;
    for (int copy = 0; copy < layout_.copy_count(); ++copy) {
      const int vertex = layout_.vertex_of(copy);
      const auto copies = layout_.copies_of(vertex);
      const T w = program_.inverse_mass[vertex];
      rest.push_back(program_.rest[vertex]);
      inverse_mass.push_back(w);
      mobility.push_back(static_cast<T>(copies.size()) * w * dt2);
      if (copies.size() > 1) gather.insert(gather.end(), copies.begin(), copies.end());
      gather_begin.push_back(static_cast<int>(gather.size()));
    }
    for (int block = 0; block < layout_.block_count(); ++block) {
      const Range copies = layout_.copies_in(block);
      copy_begin.push_back(copies.end);
      frame_.most_copies = std::max(frame_.most_copies, copies.end - copies.begin);
    }
    frame_.rest = (rest_ = DeviceArray<Vec3<T>>(rest)).get();
    frame_.inverse_mass = (inverse_mass_ = DeviceArray<T>(inverse_mass)).get();
    frame_.mobility = (mobility_ = DeviceArray<T>(mobility)).get();
    frame_.copy_begin = (copy_begin_ = DeviceArray<int>(copy_begin)).get();
    frame_.gather_begin = (gather_begin_ = DeviceArray<int>(gather_begin)).get();
    frame_.gather = (gather_ = DeviceArray<int>(gather)).get();
  }

  void place_effects() {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (Effect::kind == EffectKind::contact) {
        frame_.scene.contacts += static_cast<int>(std::get<i>(program_.effects).size());
      }
    });
    int most = 0;  // shared memory of a block on this device, bytes
    check(cudaDeviceGetAttribute(&most, cudaDevAttrMaxSharedMemoryPerBlockOptin, 0),
          "asking for the shared memory");
    const std::size_t bytes = vertex_bytes<T>(frame_.most_copies, frame_.scene.contacts);
    require_room(bytes, most);
    constexpr std::size_t bounds_bytes = 1024;
    int phases = 0;
    EffectSet named = 0;
    std::vector<int> leader(layout_.copy_count(), -1);
    int motions = 0;
    Effects::for_each([&]<class Effect, std::size_t i>() {
      auto& views = std::get<i>(host_views_);
      for (const auto& effect : std::get<i>(program_.effects)) {
        named |= EffectSet{1} << i;
        if constexpr (Effect::kind == EffectKind::element) {
          auto& own = std::get<i>(own_).emplace_back(layout_.lay_out(effect));
          phases = std::max(phases, own.most_phases);
          bool linearized = false;
          if constexpr (is_linearizable<Effect>) {
            const std::size_t wanted = own.most * sizeof(LinearizedElement<Effect, T>);
            linearized = bytes + wanted + bounds_bytes <= static_cast<std::size_t>(most);
            if (linearized) frame_.element_bytes = std::max(frame_.element_bytes, wanted);
          }
          views.push_back({own.vertices.get(), own.rest.get(), own.phase_begin.get(),
                           own.block_phase.get(), own.memory.get(), linearized});
        } else if constexpr (requires { effect.device; }) {
          if constexpr (Effect::kind == EffectKind::motion) {
            for (const int vertex : effect.vertices) {
              for (const int copy : layout_.copies_of(vertex)) leader[copy] = motions;
            }
            ++motions;
          }
          views.push_back({effect.device});
        }
      }
    });
    if (motions > 0) frame_.leader = (leader_ = DeviceArray<int>(leader)).get();
    shared_bytes_ = bytes + frame_.element_bytes + (phases + bounds_beyond) * sizeof(int);
    kernel_ = kernel_for<T>(named);
  }

  void upload_views() {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      const auto& views = std::get<i>(host_views_);
      auto& array = static_cast<ArrayOf<Effect>&>(views_).array;
      array = ViewArray<Effect>(views);
      static_cast<BlockViews<Effect, T>&>(frame_.scene.effects) = {array.get(),
                                                                   static_cast<int>(views.size())};
    });
  }

  static void require_room(std::size_t bytes, int most) {
    if (bytes <= static_cast<std::size_t>(most)) return;
    throw Refusal(Refusal::Cause::device, "block_tets",
                  "a block's vertices need " + std::to_string(bytes >> 10) + " KiB",
                  "at most " + std::to_string(most >> 10) + " KiB, the device's shared memory",
                  "use a smaller block_tets, a coarser mesh or scheme: gauss_seidel");
  }

  std::vector<Vec3<double>> gathered(const std::vector<Vec3<T>>& copies) const {
    std::vector<Vec3<double>> field;
    for (int v = 0; v < vertex_count(); ++v) {
      field.push_back(cast<double>(copies[layout_.copies_of(v)[0]]));
    }
    return field;
  }
  std::vector<Vec3<T>> spread(const std::vector<Vec3<double>>& field) const {
    std::vector<Vec3<T>> copies;
    for (int copy = 0; copy < layout_.copy_count(); ++copy) {
      copies.push_back(cast<T>(field[layout_.vertex_of(copy)]));
    }
    return copies;
  }

  int vertex_count() const { return static_cast<int>(program_.rest.size()); }

  std::string name_;
  Program<T> program_;
  BlockLayout layout_;
  Frame<T> frame_{};
  Kernel<T> kernel_{};
  std::uint64_t step_ = 0;
  std::size_t shared_bytes_ = 0;
  Effects::Slots<OwnOf> own_;
  Effects::Slots<View> host_views_;
  Effects::Joined<ArrayOf> views_;
  DeviceArray<Vec3<T>> u_, v_, rest_;
  DeviceArray<T> inverse_mass_, mobility_;
  DeviceArray<int> leader_, copy_begin_, gather_begin_, gather_;
  DeviceArray<Parcel<T>> parcels_;
  DeviceArray<unsigned char> touching_;
};

}  // namespace

std::unique_ptr<Solver> make_cuda_blocks(const Model& model, const Scene& scene,
                                         const SolverOptions& options, const std::string& name) {
  int processors = 0;
  check(cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, 0),
        "asking for the multiprocessors");
  const int tets = static_cast<int>(model.tet_count());
  // All blocks run at once: one a multiprocessor.
  const int least = (tets + processors - 1) / processors;
  const int tets_per_block =
      std::max(least, options.block_tets > 0 ? options.block_tets : least_block);
  if (options.precision == Precision::fp64) {
    return std::make_unique<CudaBlocks<double>>(model, scene, tets_per_block, name);
  }
  return std::make_unique<CudaBlocks<float>>(model, scene, tets_per_block, name);
}

}  // namespace viscera::sim
