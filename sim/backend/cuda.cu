// The XPBD substep on a CUDA device: the same effects as the CPU, one kernel per pass and per
// colour, captured once as a graph and launched as one. Elements of a colour touch disjoint
// vertices, so two runs on one device give the same bits.
#include <cuda_runtime.h>

#include <algorithm>
#include <type_traits>

#include "sim/backend/backend.hpp"
#include "sim/refusal.hpp"
#include "sim/solvers/xpbd.hpp"

namespace viscera::sim {
namespace {

constexpr int block_size = 256;

void check(cudaError_t status, const char* doing) {
  if (status == cudaSuccess) return;
  throw Refusal(Refusal::Cause::device, "cuda",
                std::string(doing) + ": " + cudaGetErrorString(status), "a working CUDA device",
                "use device: cpu, or mend the driver");
}

// Device memory that is freed with its owner.
template <class T>
class DeviceArray {
 public:
  DeviceArray() = default;
  explicit DeviceArray(std::size_t size) : size_(size) {
    if (size > 0) check(cudaMalloc(&data_, size * sizeof(T)), "allocating");
    if (size > 0) check(cudaMemset(data_, 0, size * sizeof(T)), "clearing");
  }
  explicit DeviceArray(const std::vector<T>& host) : DeviceArray(host.size()) { upload(host); }
  DeviceArray(DeviceArray&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}
  DeviceArray& operator=(DeviceArray&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~DeviceArray() { cudaFree(data_); }

  void upload(const std::vector<T>& host) {
    if (host.empty()) return;
    check(cudaMemcpy(data_, host.data(), size_ * sizeof(T), cudaMemcpyHostToDevice), "uploading");
  }
  std::vector<T> download() const {
    std::vector<T> host(size_);
    if (size_ == 0) return host;
    check(cudaMemcpy(host.data(), data_, size_ * sizeof(T), cudaMemcpyDeviceToHost), "downloading");
    return host;
  }
  T* get() const { return data_; }
  int size() const { return static_cast<int>(size_); }

 private:
  T* data_ = nullptr;
  std::size_t size_ = 0;
};

__device__ int global_thread() {
  return static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
}

template <class T>
__global__ void begin(int n, const T* w, const Vec3<T>* v, Vec3<T>* d, T dt) {
  const int i = global_thread();
  if (i < n) d[i] = begin_vertex(w[i], v[i], dt);
}

template <class Effect, class T>
__global__ void apply_force(int n, typename Effect::template Device<T> device, const T* w,
                            const Vec3<T>* rest, const Vec3<T>* u, const Vec3<T>* v, Vec3<T>* d,
                            T dt) {
  const int i = global_thread();
  if (i < n && w[i] > T(0)) d[i] += (dt * dt) * Effect::acceleration(device, rest[i], u[i], v[i]);
}

template <class Effect, class T>
__global__ void solve_color(int first, int last, const std::array<int, Effect::arity>* vertices,
                            const typename Effect::template Rest<T>* rest, const T* w,
                            const Vec3<T>* u, Vec3<T>* d, T dt) {
  const int e = first + global_thread();
  if (e >= last) return;
  constexpr int arity = Effect::arity;
  Vec3<T> local_u[arity], local_d[arity];
  T mobility[arity];
  for (int i = 0; i < arity; ++i) {
    const int v = vertices[e][i];
    local_u[i] = u[v];
    local_d[i] = d[v];
    mobility[i] = w[v] * (dt * dt);
  }
  correct_element<Effect>(rest[e], mobility, local_u, local_d);
  for (int i = 0; i < arity; ++i) d[vertices[e][i]] = local_d[i];
}

template <class Effect, class T>
__global__ void push(int n, typename Effect::template Device<T> device, const T* w,
                     const Vec3<T>* rest, const Vec3<T>* u, Vec3<T>* d, T* depth) {
  const int i = global_thread();
  if (i < n) depth[i] = w[i] > T(0) ? Effect::push(device, rest[i], u[i], d[i]) : T(0);
}

template <class Effect, class T>
__global__ void rub(int n, typename Effect::template Device<T> device, const T* depth, Vec3<T>* d) {
  const int i = global_thread();
  if (i < n && depth[i] > T(0)) Effect::rub(device, depth[i], d[i]);
}

template <class T>
__global__ void end(int n, const Vec3<T>* d, T dt, Vec3<T>* u, Vec3<T>* v) {
  const int i = global_thread();
  if (i < n) end_vertex(d[i], dt, u[i], v[i]);
}

// What one effect keeps on the device.
template <class Effect, class T, EffectKind kind = Effect::kind>
struct OnDevice {  // force effects travel as kernel arguments
  typename Effect::template Device<T> device;

  OnDevice(const Prepared<Effect, T>& host, int) : device(host.device) {}
};

template <class Effect, class T>
struct OnDevice<Effect, T, EffectKind::contact> {
  typename Effect::template Device<T> device;
  DeviceArray<T> depth;  // [n] m, corrected in this substep; 0: not in contact

  OnDevice(const Prepared<Effect, T>& host, int vertex_count)
      : device(host.device), depth(vertex_count) {}
};

template <class Effect, class T>
struct OnDevice<Effect, T, EffectKind::element> {
  DeviceArray<std::array<int, Effect::arity>> vertices;
  DeviceArray<typename Effect::template Rest<T>> rest;
  std::vector<int> color_begin;

  OnDevice(const Prepared<Effect, T>& host, int)
      : vertices(host.vertices), rest(host.rest), color_begin(host.color_begin) {}
};

template <class T>
class XpbdCuda final : public Solver {
 public:
  XpbdCuda(const Model& model, const Scene& scene, std::string name)
      : XpbdCuda(XpbdProgram<T>(model, scene), std::move(name)) {}

  ~XpbdCuda() override {
    cudaGraphExecDestroy(graph_);
    cudaStreamDestroy(stream_);
  }

  void advance_frame() override {
    for (int substep = 0; substep < substeps_; ++substep) {
      check(cudaGraphLaunch(graph_, stream_), "launching a substep");
    }
    check(cudaStreamSynchronize(stream_), "running a frame");
  }
  State state() const override {
    return {cast_all<double>(u_.download()), cast_all<double>(v_.download())};
  }
  void set_state(const State& state) override {
    u_.upload(cast_all<T>(state.u));
    v_.upload(cast_all<T>(state.v));
  }
  std::size_t contact_count() const override {
    std::size_t count = 0;
    for_each_active<EffectKind::contact>([&count]<class Effect>(const auto& effect) {
      count += std::ranges::count_if(effect.depth.download(), [](T depth) { return depth > T(0); });
    });
    return count;
  }
  std::string device() const override { return "cuda, " + name_; }

 private:
  template <class Effect>
  using Slot = OnDevice<Effect, T>;

  XpbdCuda(const XpbdProgram<T>& program, std::string name)
      : name_(std::move(name)),
        n_(static_cast<int>(program.rest.size())),
        dt_(program.dt),
        substeps_(program.substeps),
        rest_((require_memory(program), program.rest)),
        inverse_mass_(program.inverse_mass),
        u_(n_),
        v_(n_),
        d_(n_) {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if (const auto& host = std::get<i>(program.effects)) {
        std::get<i>(effects_).emplace(*host, n_);
      }
    });
    check(cudaStreamCreate(&stream_), "creating a stream");
    capture();
  }

  // Refuses before the first allocation what will not fit.
  static void require_memory(const XpbdProgram<T>& program) {
    std::size_t bytes = program.rest.size() * (4 * sizeof(Vec3<T>) + 2 * sizeof(T));
    program.template for_each_active<EffectKind::element>([&]<class Effect>(const auto& effect) {
      bytes += effect.rest.size() * (sizeof(effect.rest[0]) + sizeof(effect.vertices[0]));
    });
    std::size_t free_bytes = 0, total_bytes = 0;
    check(cudaMemGetInfo(&free_bytes, &total_bytes), "asking for the free memory");
    if (bytes <= free_bytes) return;
    throw Refusal(Refusal::Cause::device, "mesh",
                  "needs " + std::to_string(bytes >> 20) + " MiB on the device",
                  "at most " + std::to_string(free_bytes >> 20) + " MiB, which are free",
                  "use a coarser mesh or device: cpu");
  }

  void capture() {
    check(cudaStreamBeginCapture(stream_, cudaStreamCaptureModeThreadLocal), "capturing a substep");
    enqueue_substep();
    cudaGraph_t graph = nullptr;
    check(cudaStreamEndCapture(stream_, &graph), "capturing a substep");
    const cudaError_t status = cudaGraphInstantiate(&graph_, graph, 0);
    cudaGraphDestroy(graph);
    check(status, "preparing a substep");
  }

  static int blocks(int threads) { return (threads + block_size - 1) / block_size; }

  void enqueue_substep() {
    begin<T>
        <<<blocks(n_), block_size, 0, stream_>>>(n_, inverse_mass_.get(), v_.get(), d_.get(), dt_);
    for_each_active<EffectKind::force>([&]<class Effect>(const auto& effect) {
      apply_force<Effect, T><<<blocks(n_), block_size, 0, stream_>>>(
          n_, effect.device, inverse_mass_.get(), rest_.get(), u_.get(), v_.get(), d_.get(), dt_);
    });
    for_each_active<EffectKind::contact>([&]<class Effect>(const auto& effect) {
      push<Effect, T><<<blocks(n_), block_size, 0, stream_>>>(
          n_, effect.device, inverse_mass_.get(), rest_.get(), u_.get(), d_.get(),
          effect.depth.get());
    });
    for_each_active<EffectKind::element>([&]<class Effect>(const auto& effect) {
      for (std::size_t color = 0; color + 1 < effect.color_begin.size(); ++color) {
        const int first = effect.color_begin[color], last = effect.color_begin[color + 1];
        solve_color<Effect, T><<<blocks(last - first), block_size, 0, stream_>>>(
            first, last, effect.vertices.get(), effect.rest.get(), inverse_mass_.get(), u_.get(),
            d_.get(), dt_);
      }
    });
    for_each_active<EffectKind::contact>([&]<class Effect>(const auto& effect) {
      rub<Effect, T>
          <<<blocks(n_), block_size, 0, stream_>>>(n_, effect.device, effect.depth.get(), d_.get());
    });
    end<T><<<blocks(n_), block_size, 0, stream_>>>(n_, d_.get(), dt_, u_.get(), v_.get());
    check(cudaGetLastError(), "launching a kernel");
  }

  template <EffectKind kind, class Function>
  void for_each_active(Function&& function) const {
    for_each_slot<kind>(effects_, function);
  }

  std::string name_;
  int n_;
  T dt_;
  int substeps_;
  DeviceArray<Vec3<T>> rest_;
  DeviceArray<T> inverse_mass_;
  DeviceArray<Vec3<T>> u_, v_, d_;
  Effects::Slots<Slot> effects_;
  cudaStream_t stream_ = nullptr;
  cudaGraphExec_t graph_ = nullptr;
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
  return {.name = properties.name};
}

std::unique_ptr<Solver> make_xpbd_cuda(const Model& model, const Scene& scene,
                                       Precision precision) {
  check_scene(scene);
  const CudaDevice device = find_cuda_device();
  if (!device.name) {
    throw Refusal(Refusal::Cause::device, "device", device.why_not, "a CUDA device and its driver",
                  "use device: cpu or auto");
  }
  if (precision == Precision::fp64) {
    return std::make_unique<XpbdCuda<double>>(model, scene, *device.name);
  }
  return std::make_unique<XpbdCuda<float>>(model, scene, *device.name);
}

}  // namespace viscera::sim
