// The bound on compression (solvers/xpbd/volume_bound.hpp) on a device, colour by colour: one
// kernel marks the tets that are near it, one thread block corrects them. What is tested is tested
// side by side; what is changed is changed by one thread in the order of the tets, so that two runs
// give the same bits.
#pragma once

#include "sim/backend/cuda/memory.cuh"
#include "sim/solvers/xpbd/volume_bound.hpp"

namespace viscera::sim {

// What the two kernels work on.
template <class T>
struct VolumeBoundView {
  int count;                  // tets
  const Tet* vertices;        // [count]
  const Mat3<T>* rest;        // [count] rest_inverse, 1/m
  const Vec3<T>* u;           // [n] m
  Vec3<T>* d;                 // [n] m over the substep
  const T* inverse_mass;      // [n] 1/kg
  T dt;                       // s
  unsigned char* near_bound;  // [count]
  int* watched;               // [count] tets near the bound
  unsigned char* below;       // [count] by place in `watched`, at last by tet
  int* wrong;                 // [count] likewise
  Vec3<T>* corrections;       // [n] m, by which vertices were moved in this substep
  int* group_of;              // [n] of JoinedVertices
  int* members;               // [n] likewise
  int* state;  // whether any tet was moved in this substep, and whether any then falls

  __device__ MovingTet<T> tet(int t) const {
    MovingTet<T> tet{.rest_inverse = rest[t]};
    for (int i = 0; i < 4; ++i) {
      const int v = vertices[t][i];
      tet.u[i] = u[v];
      tet.d[i] = d[v];
      tet.w[i] = inverse_mass[v] * (dt * dt);
    }
    return tet;
  }
  __device__ Row<T> row(int v) const { return {d[v], inverse_mass[v] * (dt * dt)}; }
  __device__ void move(int v, const Vec3<T>& to) const {
    corrections[v] += to - d[v];
    d[v] = to;
  }
};

template <class T>
__global__ void watch_volumes(VolumeBoundView<T> view) {
  const int t = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (t >= view.count) return;
  view.near_bound[t] = view.tet(t).strain_after() < T(VolumeBound::watched - 1.0);
}

inline constexpr int bound_threads = 1024;

// Writes the indices of the marks that are set, in order, and returns how many there are. By all
// threads of a block.
__device__ inline int compact(const unsigned char* marks, int count, int* indices) {
  __shared__ int sums[bound_threads];
  const int thread = static_cast<int>(threadIdx.x);
  const int share = (count + bound_threads - 1) / bound_threads;
  const int begin = min(thread * share, count), end = min(begin + share, count);
  int own = 0;
  for (int i = begin; i < end; ++i) own += marks[i] != 0;
  sums[thread] = own;
  __syncthreads();
  for (int reach = 1; reach < bound_threads; reach *= 2) {
    const int before = thread >= reach ? sums[thread - reach] : 0;
    __syncthreads();
    sums[thread] += before;
    __syncthreads();
  }
  const int total = sums[bound_threads - 1];
  int at = sums[thread] - own;
  for (int i = begin; i < end; ++i) {
    if (marks[i] != 0) indices[at++] = i;
  }
  __syncthreads();
  return total;
}

// Until correct(tet) has changed none of those watched, at most so many times. needs(tet) tells,
// without changing it, whether correct would. Returns whether it did for any.
template <class T, class Needs, class Correct>
__device__ bool repeat_over_watched(const VolumeBoundView<T>& view, int watched, int at_most,
                                    Needs&& needs, Correct&& correct) {
  for (int pass = 0; pass < at_most; ++pass) {
    for (int k = static_cast<int>(threadIdx.x); k < watched; k += bound_threads) {
      view.below[k] = needs(view.tet(view.watched[k]));
    }
    __syncthreads();
    const int wrong = compact(view.below, watched, view.wrong);
    if (wrong == 0) return pass > 0;
    if (threadIdx.x == 0) {
      for (int k = 0; k < wrong; ++k) {
        const int t = view.watched[view.wrong[k]];
        MovingTet<T> tet = view.tet(t);
        if (!correct(tet)) continue;
        for (int i = 0; i < 4; ++i) view.move(view.vertices[t][i], tet.d[i]);
      }
    }
    __syncthreads();
  }
  return true;
}

enum { any_moved, any_falls };

// The tets that repeated averages have left, and those that they have pressed.
template <class T>
__global__ void find_those_left(VolumeBoundView<T> view) {
  const int t = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (t >= view.count || !view.state[any_moved]) return;
  view.below[t] = view.tet(t).falls();
  if (view.below[t]) view.state[any_falls] = 1;  // all write the same
}

// Joins them, and then those that this presses: they have a vertex in a group.
template <class T>
__global__ void __launch_bounds__(bound_threads) join_those_left(VolumeBoundView<T> view) {
  __shared__ bool any;
  if (!view.state[any_moved] || !view.state[any_falls]) return;
  JoinedVertices<T> joined{view.group_of, view.members};  // thread 0's
  for (;;) {
    const int wrong = compact(view.below, view.count, view.wrong);
    if (threadIdx.x == 0) {
      any = false;
      for (int k = 0; k < wrong; ++k) {
        if (joined.join(view.vertices[view.wrong[k]])) any = true;
      }
      if (any) {
        joined.lead([&view](int v) { return view.row(v); },
                    [&view](int v, const Vec3<T>& to) { view.move(v, to); });
      } else {
        joined.part();
      }
    }
    __syncthreads();
    if (!any) return;
    for (int t = static_cast<int>(threadIdx.x); t < view.count; t += bound_threads) {
      bool grouped = false;
      for (const int v : view.vertices[t]) grouped = grouped || view.group_of[v] >= 0;
      view.below[t] = grouped && view.tet(t).falls();
    }
    __syncthreads();
  }
}

// Where `acts` says so. At the last substep of a frame, of which a frame has `substeps` and the
// device has `done`, it is decided anew; without `acts` it is always.
template <class T>
__global__ void __launch_bounds__(bound_threads)
    bound_volumes(VolumeBoundView<T> view, unsigned char* acts, const unsigned long long* done,
                  int substeps) {
  const int watched = compact(view.near_bound, view.count, view.watched);
  const bool now = !acts || *acts;
  bool moved = false;
  if (now && watched > 0) {
    const auto push = [](MovingTet<T>& tet) { return tet.push(); };
    const auto halt = [](MovingTet<T>& tet) { return tet.halt(); };
    const auto would = [](const auto& correct) {
      return [correct](MovingTet<T> own) { return correct(own); };
    };
    moved = repeat_over_watched(view, watched, VolumeBound::pushes, would(push), push);
    moved = repeat_over_watched(view, watched, VolumeBound::halts, would(halt), halt) || moved;
  }
  if (threadIdx.x == 0) {
    view.state[any_moved] = moved;
    view.state[any_falls] = 0;
  }
  if (acts && threadIdx.x == 0 && (*done + 1) % substeps == 0) {
    *acts = VolumeBound::goes_on(now, watched, view.count);
  }
}

// The tets of a body that the bound is for, on the device; empty where a scene has no such law.
template <class T>
class CudaVolumeBound {
 public:
  CudaVolumeBound(BoundedTets<T> tets, int vertices)
      : tets_(std::move(tets)),
        vertices_(tets_.vertices),
        rest_(tets_.rest_inverse),
        near_bound_(tets_.vertices.size()),
        watched_(tets_.vertices.size()),
        below_(tets_.vertices.size()),
        wrong_(tets_.vertices.size()),
        corrections_(tets_.vertices.empty() ? 0 : vertices),
        group_of_(std::vector<int>(corrections_.size(), -1)),
        members_(corrections_.size()),
        state_(2),
        acts_(1),
        count_(static_cast<int>(tets_.vertices.size())) {
    begin_at({});
  }

  // One without displacements is that of rest.
  void begin_at(const State& state) {
    const unsigned char acts = state.u.empty() || tets_.begins_at(state);
    check(cudaMemcpy(acts_.get(), &acts, sizeof(acts), cudaMemcpyHostToDevice), "uploading");
    check(cudaStreamSynchronize(nullptr), "uploading");
  }

  const Mat3<T>* rest_inverse() const { return rest_.get(); }  // [tets] 1/m
  // [n] m, of the substep; null where there is no bound.
  const Vec3<T>* corrections() const { return corrections_.get(); }
  // At the end of a frame, for the next.
  bool acts() const { return count_ == 0 || acts_.download()[0] != 0; }

  static std::size_t bytes(const BoundedTets<T>& tets, std::size_t vertices) {
    if (tets.vertices.empty()) return 0;
    return tets.vertices.size() * (sizeof(Tet) + sizeof(Mat3<T>) + 2 + 2 * sizeof(int)) +
           vertices * (sizeof(Vec3<T>) + 2 * sizeof(int));
  }

  // `done` counts the substeps on the device, of which a frame has `substeps`.
  void enqueue(cudaStream_t stream, const Vec3<T>* u, Vec3<T>* d, const T* inverse_mass, T dt,
               const unsigned long long* done, int substeps) const {
    enqueue(stream, view(u, d, inverse_mass, dt), acts_.get(), done, substeps);
  }
  // Whatever acts() says.
  void enqueue_always(cudaStream_t stream, const Vec3<T>* u, Vec3<T>* d, const T* inverse_mass,
                      T dt) const {
    enqueue(stream, view(u, d, inverse_mass, dt), nullptr, nullptr, 1);
  }

 private:
  VolumeBoundView<T> view(const Vec3<T>* u, Vec3<T>* d, const T* inverse_mass, T dt) const {
    return {.count = count_,
            .vertices = vertices_.get(),
            .rest = rest_.get(),
            .u = u,
            .d = d,
            .inverse_mass = inverse_mass,
            .dt = dt,
            .near_bound = near_bound_.get(),
            .watched = watched_.get(),
            .below = below_.get(),
            .wrong = wrong_.get(),
            .corrections = corrections_.get(),
            .group_of = group_of_.get(),
            .members = members_.get(),
            .state = state_.get()};
  }
  void enqueue(cudaStream_t stream, const VolumeBoundView<T>& view, unsigned char* acts,
               const unsigned long long* done, int substeps) const {
    if (count_ == 0) return;
    constexpr int width = 256;
    const int blocks = (count_ + width - 1) / width;
    check(cudaMemsetAsync(corrections_.get(), 0, corrections_.size() * sizeof(Vec3<T>), stream),
          "clearing");
    watch_volumes<T><<<blocks, width, 0, stream>>>(view);
    bound_volumes<T><<<1, bound_threads, 0, stream>>>(view, acts, done, substeps);
    find_those_left<T><<<blocks, width, 0, stream>>>(view);
    join_those_left<T><<<1, bound_threads, 0, stream>>>(view);
  }

  BoundedTets<T> tets_;
  DeviceArray<Tet> vertices_;
  DeviceArray<Mat3<T>> rest_;
  DeviceArray<unsigned char> near_bound_;
  DeviceArray<int> watched_;
  DeviceArray<unsigned char> below_;
  DeviceArray<int> wrong_;
  DeviceArray<Vec3<T>> corrections_;
  DeviceArray<int> group_of_, members_, state_;
  DeviceArray<unsigned char> acts_;
  int count_;
};

}  // namespace viscera::sim
