// Block Gauss-Seidel on a CUDA device. One cooperative launch is one frame: a thread block holds
// its copies of vertices in shared memory and runs all substeps on them, phase by phase with a
// barrier of its own between. Blocks meet once a substep, where the copies of a vertex are
// averaged: each publishes its own together with the number of the exchange in one 16-byte word and
// waits for those that it needs, so there is no barrier over the grid and no second trip to memory.
// The sums are in a fixed order: two runs on one device give the same bits.
#include <cuda_runtime.h>

#include <algorithm>

#include "sim/backend/block_step.hpp"
#include "sim/backend/cuda_blocks.hpp"
#include "sim/backend/cuda_memory.cuh"

namespace viscera::sim {
namespace {

// A kernel is compiled for a set of effects: what a scene does not name costs neither registers nor
// room in the instruction cache.
inline constexpr EffectSet tissue = effect_set<Gravity, Fixed, NeoHookean, Ground>;
inline constexpr EffectSet damped_tissue = tissue | effect_set<Viscosity, Prescribed>;

constexpr int least_block = 150;  // tets: smaller blocks cost accuracy and are no faster
constexpr int bounds_beyond = 4;  // of phases, in the table that a sweep reads ahead

// A vertex's displacement on its way to other blocks. A word is written and read at once (PTX ISA
// 8.3: b128 accesses of sm_70 and later are single), so a number that belongs to the exchange tells
// that the rest of its word does.
struct alignas(16) Word {
  unsigned long long low, high;
};
__device__ void store(Word* to, Word word) {
  asm volatile(
      "{ .reg .b128 w; mov.b128 w, {%1, %2}; st.relaxed.gpu.global.b128 [%0], w; }" ::"l"(to),
      "l"(word.low), "l"(word.high)
      : "memory");
}
__device__ Word load(const Word* from) {
  Word word;
  asm volatile("{ .reg .b128 w; ld.relaxed.gpu.global.b128 w, [%2]; mov.b128 {%0, %1}, w; }"
               : "=l"(word.low), "=l"(word.high)
               : "l"(from)
               : "memory");
  return word;
}

template <class T>
struct Parcel;
template <>
struct Parcel<float> {
  Word word;
  __device__ static void send(Parcel* to, const Vec3<float>& d, unsigned exchange) {
    const auto bits = [](float a) { return static_cast<unsigned long long>(__float_as_uint(a)); };
    store(&to->word, {bits(d.x) | bits(d.y) << 32,
                      bits(d.z) | static_cast<unsigned long long>(exchange) << 32});
  }
  __device__ static Parcel look(const Parcel* at) { return {load(&at->word)}; }
  __device__ bool arrived(unsigned exchange) const { return word.high >> 32 == exchange; }
  __device__ Vec3<float> content() const {
    return {__uint_as_float(static_cast<unsigned>(word.low)),
            __uint_as_float(static_cast<unsigned>(word.low >> 32)),
            __uint_as_float(static_cast<unsigned>(word.high))};
  }
};
template <>
struct Parcel<double> {
  Word word[3];
  __device__ static void send(Parcel* to, const Vec3<double>& d, unsigned exchange) {
    const double content[3] = {d.x, d.y, d.z};
    for (int k = 0; k < 3; ++k) {
      store(&to->word[k],
            {static_cast<unsigned long long>(__double_as_longlong(content[k])), exchange});
    }
  }
  __device__ static Parcel look(const Parcel* at) {
    return {load(&at->word[0]), load(&at->word[1]), load(&at->word[2])};
  }
  __device__ bool arrived(unsigned exchange) const {
    return word[0].high == exchange && word[1].high == exchange && word[2].high == exchange;
  }
  __device__ Vec3<double> content() const {
    const auto number = [this](int k) {
      return __longlong_as_double(static_cast<long long>(word[k].low));
    };
    return {number(0), number(1), number(2)};
  }
};

// What a frame's kernel is given; arrays over copies unless said otherwise.
template <class T>
struct Frame {
  BlockScene<T> scene;
  Vec3<T>* u;
  Vec3<T>* v;
  const Vec3<T>* rest;
  const T* inverse_mass;
  const T* mobility;
  const int* leader;        // or null
  const int* copy_begin;    // [blocks + 1]
  const int* gather_begin;  // [copies + 1]
  const int* gather;        // the copies of the same vertex, in order; none where it has one
  Parcel<T>* parcels;       // [2 * copies]
  int copies;
  unsigned char* touching;  // [contacts * copies] at the end of the frame
  unsigned long long done;  // substeps
  double dt;
  int substeps;
  int most_copies;            // of a block
  int team;                   // lanes that sweep
  std::size_t element_bytes;  // shared memory for linearised elements
};

// Elements that were linearised, in shared memory.
template <class Effect, class T>
struct LinearizedWork {
  using Item = LinearizedElement<Effect, T>;
  using Rows = sim::Rows<T, Effect::arity>;
  const BlockVertices<T>& x;
  const Item* elements;

  __device__ Item fetch(int e) const { return elements[e]; }
  __device__ Rows gather(const Item& item) const { return {x, item.vertices}; }
  __device__ void solve(const Item& item, const Rows& rows, bool active) const {
    solve_linearized(x, item, rows, active);
  }
};

// Elements that are evaluated one phase after the other.
template <class Effect, class T>
struct DirectWork {
  struct Item {
    typename BlockView<Effect, T>::Rest rest;
    typename BlockView<Effect, T>::Local vertices;
    int element;
  };
  struct Rows {};
  const BlockVertices<T>& x;
  const BlockView<Effect, T>& view;
  int first;

  __device__ Item fetch(int e) const { return {view.rest[first + e], view.vertices[first + e], e}; }
  __device__ Rows gather(const Item&) const { return {}; }
  __device__ void solve(const Item& item, const Rows&, bool active) const {
    if (!active) return;
    solve_element<Effect>(
        x, item.vertices, item.rest.rest,
        view.memory + static_cast<std::size_t>(first + item.element) * memory_of<Effect>);
  }
};

// Solves the elements phase by phase. A lane's next element is fetched while it works on the
// present one: between two phases only displacements are waited for. Lanes without an element work
// on another's and keep nothing, so that a warp stays together. `bounds` are those of the phases,
// with three more at the end.
template <bool one_warp_sweeps, class Work>
__device__ void sweep(const Work& work, const int* bounds, int phases, int team) {
  const int lane = static_cast<int>(threadIdx.x);
  if (lane >= team) return;
  int end = bounds[1], next_end = bounds[2];
  typename Work::Item even = work.fetch(min(lane, end - 1)), odd;
  bool even_active = lane < end, odd_active = false;
  const auto solve = [&](const typename Work::Item& item, bool active, typename Work::Item& next,
                         bool& next_active, int phase) {
    const auto rows = work.gather(item);
    next = work.fetch(min(end + lane, next_end - 1));
    next_active = end + lane < next_end;
    end = next_end;
    next_end = bounds[phase + 3];
    work.solve(item, rows, active);
    if constexpr (one_warp_sweeps) {
      __syncwarp();
    } else {
      asm volatile("bar.sync 1, %0;" ::"r"(team) : "memory");
    }
  };
  for (int phase = 0; phase < phases; phase += 2) {
    solve(even, even_active, odd, odd_active, phase);
    solve(odd, odd_active, even, even_active, phase + 1);
  }
}
template <class Work>
__device__ void sweep(const Work& work, const int* bounds, int phases, int team) {
  if (team == one_warp) {
    sweep<true>(work, bounds, phases, team);
  } else {
    sweep<false>(work, bounds, phases, team);
  }
  __syncthreads();
}

// A block's shared memory beyond its vertices.
struct Room {
  int* bounds;  // of the phases of the effect at hand, from its first element in the block
  unsigned char* elements;
};

template <class Effect, class T>
__device__ void sweep_effect(const BlockView<Effect, T>& view, const BlockVertices<T>& x, int team,
                             const Room& room) {
  const int first_phase = view.block_phase[blockIdx.x];
  const int phases = view.block_phase[blockIdx.x + 1] - first_phase;
  if (phases == 0) return;
  const int first = view.phase_begin[first_phase];
  const int count = view.phase_begin[first_phase + phases] - first;
  const int lane = static_cast<int>(threadIdx.x), lanes = static_cast<int>(blockDim.x);
  for (int p = lane; p < phases + bounds_beyond; p += lanes) {
    room.bounds[p] = view.phase_begin[first_phase + min(p, phases)] - first;
  }
  if constexpr (is_linearizable<Effect>) {
    if (view.linearized) {
      auto* const elements = reinterpret_cast<LinearizedElement<Effect, T>*>(room.elements);
      for (int e = lane; e < count; e += lanes) {
        linearize_element<Effect>(
            x, view.vertices[first + e], view.rest[first + e].rest,
            view.memory + static_cast<std::size_t>(first + e) * memory_of<Effect>, elements[e]);
      }
      __syncthreads();
      sweep(LinearizedWork<Effect, T>{x, elements}, room.bounds, phases, team);
      return;
    }
  }
  __syncthreads();
  sweep(DirectWork<Effect, T>{x, view, first}, room.bounds, phases, team);
}

// The average of a vertex's copies. All that are awaited are asked for before the first is taken.
template <class T>
__device__ Vec3<T> averaged(const Frame<T>& frame, const Vec3<T>& own, int copy,
                            unsigned exchange) {
  constexpr int batch = 8;
  const int begin = frame.gather_begin[copy], end = frame.gather_begin[copy + 1];
  if (begin == end) return own;
  const Parcel<T>* const parcels = frame.parcels + (exchange & 1u) * frame.copies;
  Vec3<T> sum;
  for (int first = begin; first < end; first += batch) {
    Parcel<T> parcel[batch];
    int from[batch];  // itself where nothing is awaited
    bool waiting[batch];
#pragma unroll
    for (int k = 0; k < batch; ++k) {
      from[k] = first + k < end ? frame.gather[first + k] : copy;
      waiting[k] = from[k] != copy;
    }
    for (bool any = true; any;) {
#pragma unroll
      for (int k = 0; k < batch; ++k) {
        if (waiting[k]) parcel[k] = Parcel<T>::look(parcels + from[k]);
      }
      any = false;
#pragma unroll
      for (int k = 0; k < batch; ++k) {
        waiting[k] = waiting[k] && !parcel[k].arrived(exchange);
        any = any || waiting[k];
      }
    }
#pragma unroll
    for (int k = 0; k < batch; ++k) {
      if (first + k < end) sum += from[k] == copy ? own : parcel[k].content();
    }
  }
  return (T(1) / static_cast<T>(end - begin)) * sum;
}

template <class T>
constexpr std::size_t vertex_bytes(int copies, int contacts) {
  return (copies * (2 * sizeof(Row<T>) + (1 + contacts) * sizeof(Vec3<T>)) + 31) / 32 * 32;
}

template <class T, EffectSet set, int threads>
__global__ void __launch_bounds__(threads, 1) run_frame(const __grid_constant__ Frame<T> frame) {
  extern __shared__ __align__(32) unsigned char shared[];
  const BlockScene<T>& scene = frame.scene;
  const int lane = static_cast<int>(threadIdx.x);
  const int first = frame.copy_begin[blockIdx.x];
  const int count = frame.copy_begin[blockIdx.x + 1] - first;
  BlockVertices<T> x;
  x.u = reinterpret_cast<Row<T>*>(shared);
  x.d = x.u + frame.most_copies;
  x.v = reinterpret_cast<Vec3<T>*>(x.d + frame.most_copies);
  x.corrections = x.v + frame.most_copies;
  x.rest = frame.rest + first;
  x.leader = frame.leader ? frame.leader + first : nullptr;
  x.count = count;
  unsigned char* const elements = shared + vertex_bytes<T>(frame.most_copies, scene.contacts);
  const Room room{reinterpret_cast<int*>(elements + frame.element_bytes), elements};
  const auto step_at = [&frame](int substep) {
    return Step<T>{frame.scene.dt, static_cast<double>(frame.done + substep + 1) * frame.dt};
  };
  for (int i = lane; i < count; i += threads) {
    x.u[i] = {frame.u[first + i], frame.inverse_mass[first + i]};
    x.d[i].w = frame.mobility[first + i];
    x.v[i] = frame.v[first + i];
    begin_copy<set>(scene, step_at(0), x, i);
  }
  __syncthreads();
  for (int substep = 0; substep < frame.substeps; ++substep) {
    for_each_view<EffectKind::element, set>(scene, [&]<class Effect>(const auto& view, int) {
      sweep_effect<Effect, T>(view, x, frame.team, room);
    });
    const unsigned exchange = static_cast<unsigned>(frame.done + substep + 1);
    Parcel<T>* const parcels = frame.parcels + (exchange & 1u) * frame.copies;
    for (int i = lane; i < count; i += threads) {
      if (frame.gather_begin[first + i] < frame.gather_begin[first + i + 1]) {
        Parcel<T>::send(parcels + first + i, x.d[i].v, exchange);
      }
    }
    for (int i = lane; i < count; i += threads) {
      finish_copy<set>(scene, step_at(substep), x, i,
                       averaged(frame, x.d[i].v, first + i, exchange));
      if (substep + 1 < frame.substeps) {
        begin_copy<set>(scene, step_at(substep + 1), x, i);
      } else {
        frame.u[first + i] = x.u[i].v;
        frame.v[first + i] = x.v[i];
        for (int k = 0; k < scene.contacts; ++k) {
          frame.touching[static_cast<std::size_t>(k) * frame.copies + first + i] =
              touches(x.corrections[k * count + i]);
        }
      }
    }
    __syncthreads();
  }
}

template <class T>
struct Kernel {
  void (*run)(Frame<T>);
  int threads;
};
template <class T>
Kernel<T> kernel_for(EffectSet named) {
  constexpr int wide = sizeof(T) == 4 ? 384 : 256;
  if ((named & ~tissue) == 0) return {run_frame<T, tissue, wide>, wide};
  if ((named & ~damped_tissue) == 0) return {run_frame<T, damped_tissue, wide>, wide};
  return {run_frame<T, all_effects, 256>, 256};
}

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
    for_each_slot<EffectKind::element>(
        own_, [&state]<class Effect>(const auto& own) { own.save_memory(state.memory); });
    return state;
  }
  void set_state(const State& state) override {
    u_.upload(spread(state.u));
    v_.upload(spread(state.v));
    step_ = state.step;
    // Parcels of an exchange that is to come again must not be taken for it.
    parcels_ = DeviceArray<Parcel<T>>(parcels_.size());
    frame_.parcels = parcels_.get();
    std::span<const double> memory = state.memory;
    for_each_slot<EffectKind::element>(
        own_, [&memory]<class Effect>(auto& own) { own.load_memory(memory); });
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
