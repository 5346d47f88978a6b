// Self-contact on a device. In every substep the surface's vertices are sorted into a grid, each
// triangle lists the vertices that touch it, and one thread block moves the pairs apart in rounds
// (self_contact_step.hpp): lists and results do not depend on which thread came first.
#pragma once

#include <cooperative_groups/reduce.h>

#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>

#include "sim/backend/cuda/memory.cuh"
#include "sim/backend/self_contact_step.hpp"
#include "sim/solvers/solver.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

template <class T>
struct ContactBody {
  const Triangle* triangles;
  const Vec3<double>* rest;  // m
  const Vec3<T>* u;          // m
  Vec3<T>* d;                // m
  const T* w;                // inverse mass, 1/kg

  SIM_HD Vec3<double> start(int v) const { return rest[v] + cast<double>(u[v]); }
  SIM_HD Vec3<double> motion(int v) const { return cast<double>(d[v]); }
  SIM_HD double mobility(int v) const { return static_cast<double>(w[v]); }
  SIM_HD void move(int v, const Vec3<double>& by) const { d[v] += cast<T>(by); }
};

// The pairs of one pass, on the device.
struct ContactList {
  TouchingPair* pairs;  // [capacity]
  int* begin;           // [triangles + 1] each triangle's
  int* round_of;        // [capacity]
  int* rounds;          // [1]
  int capacity;
};

// Adds up to one more than there is room for, so that no sum overflows.
struct AddUpTo {
  int most;
  SIM_HD int operator()(int a, int b) const { return a + b < most ? a + b : most; }
};

// The threads of one block as a Team of keep_all_apart().
struct BlockTeam {
  template <class Work>
  __device__ void for_each(int count, const Work& work) const {
    for (int k = static_cast<int>(threadIdx.x); k < count; k += static_cast<int>(blockDim.x)) {
      work(k);
    }
    __syncthreads();
  }
  template <class Work>
  __device__ bool any(int count, const Work& work) const {
    bool own = false;
    for (int k = static_cast<int>(threadIdx.x); k < count; k += static_cast<int>(blockDim.x)) {
      own |= work(k);
    }
    return __syncthreads_or(own) != 0;
  }
  __device__ void lower(int& a, int b) const { atomicMin(&a, b); }
};

// Where each vertex starts, as a key of its cell.
template <class T>
__global__ void place_vertices(int count, const int* vertices, double cell, ContactBody<T> body,
                               SurfaceGrid::Key* keys) {
  const int k = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (k < count) keys[k] = SurfaceGrid::key_of(body.start(vertices[k]), cell);
}

// The bits of floats that are not negative rise with their values, so their maximum is one of whole
// numbers.
template <class T>
__global__ void find_largest_motion(int count, const int* vertices, ContactBody<T> body,
                                    unsigned* largest) {
  const int k = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  const double motion = k < count ? norm(body.motion(vertices[k])) : 0.0;
  const unsigned bits = motion > 0.0 ? __float_as_uint(__double2float_ru(motion)) : 0u;
  const auto warp =
      cooperative_groups::tiled_partition<32>(cooperative_groups::this_thread_block());
  const unsigned most =
      cooperative_groups::reduce(warp, bits, cooperative_groups::greater<unsigned>());
  if (threadIdx.x % 32 == 0 && most > 0) atomicMax(largest, most);
}

// Not inlined, so that who counts and who lists finds the same pairs, to the rounding.
template <class T>
__device__ __noinline__ bool touch_in_step(const ContactBody<T>& body, double distance,
                                           double reach, TouchingPair& pair) {
  return touch(pair_of(body, pair.vertex, pair.triangle), distance, reach, pair.over);
}

constexpr int max_on_triangle = 1024;  // vertices: more are sorted too slowly, and are too many

// Counts the vertices that touch each triangle, or lists them, ascending, where they were counted.
template <class T>
__global__ void find_pairs(bool lists, int triangles, SurfaceGrid grid, ContactBody<T> body,
                           double distance, const unsigned* largest_motion, int* counts,
                           ContactList list) {
  const int t = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (t >= triangles) return;
  int count = 0;
  TouchingPair* own = nullptr;
  if (lists) {
    if (list.begin[t] == list.begin[t + 1] || list.begin[t + 1] > list.capacity) return;
    own = list.pairs + list.begin[t];
  }
  const double reach =
      contact_reach(distance, static_cast<double>(__uint_as_float(*largest_motion)));
  grid.for_each_near(
      t, reach, [&](int vertex) { return body.start(vertex); },
      [&](int vertex) {
        TouchingPair pair{vertex, t, {}, 0.0};
        if (!touch_in_step(body, distance, reach, pair)) return;
        if (lists) {
          int at = count;
          for (; at > 0 && own[at - 1].vertex > vertex; --at) own[at] = own[at - 1];
          own[at] = pair;
        }
        ++count;
      });
  if (!lists) counts[t] = count > max_on_triangle ? list.capacity + 1 : count;
}

constexpr int contact_threads = 1024;

template <class T>
__global__ void __launch_bounds__(contact_threads)
    move_pairs_apart(int triangles, ContactBody<T> body, double distance, ContactList list,
                     int* holder, int* most) {
  const int count = list.begin[triangles];
  if (count > *most && threadIdx.x == 0) *most = count;
  if (count > list.capacity) return;  // the host looks at `most`
  const int rounds =
      keep_all_apart(BlockTeam{}, body, list.pairs, count, distance, list.round_of, holder);
  if (threadIdx.x == 0) *list.rounds = rounds;
}

template <class T>
__global__ void __launch_bounds__(contact_threads)
    resist_pairs(int triangles, ContactBody<T> body, double friction, ContactList list) {
  const int count = list.begin[triangles];
  if (count > list.capacity) return;
  resist_all_slides(BlockTeam{}, body, list.pairs, count, friction, list.round_of, *list.rounds);
}

template <class T>
class CudaSelfContact {
 public:
  CudaSelfContact(const SurfacePairs& pairs, const std::vector<Vec3<double>>& rest,
                  const SelfContact::Params& params)
      : thickness_(params.thickness),
        friction_(params.friction),
        cell_(std::max(pairs.mean_edge(rest), 2.0 * params.thickness)),
        triangles_(pairs.triangles()),
        left_out_(pairs.left_out()),
        left_out_begin_(pairs.left_out_begin()),
        vertices_(pairs.vertices()),
        placed_(pairs.vertices().size()),
        rest_(rest),
        keys_(pairs.vertices().size()),
        sorted_keys_(pairs.vertices().size()),
        largest_motion_(1),
        counts_(pairs.triangles().size() + 1),
        holder_(std::vector<int>(rest.size(), unclaimed)),
        most_(1),
        push_(pairs),
        rub_(pairs) {
    std::size_t sort = 0, scan = 0;
    check(sort_vertices(nullptr, sort, nullptr), "asking for a sort's memory");
    check(scan_counts(nullptr, scan, nullptr, nullptr), "asking for a scan's memory");
    work_ = DeviceArray<std::byte>(std::max(sort, scan));
  }

  // Of a body with this many vertices in all.
  static std::size_t bytes(const SurfacePairs& pairs, std::size_t vertices) {
    return vertices * (sizeof(Vec3<double>) + sizeof(int)) +
           pairs.vertices().size() * (4 * sizeof(SurfaceGrid::Key) + 2 * sizeof(int)) +
           pairs.triangles().size() * (sizeof(Triangle) + 4 * sizeof(int)) +
           pairs.left_out().size() * sizeof(int) +
           2 * capacity_of(pairs) * (sizeof(TouchingPair) + sizeof(int));
  }

  void retune(const SelfContact::Params& params) { friction_ = params.friction; }

  // Before the elements: leads d out.
  void enqueue_push(cudaStream_t stream, const Vec3<T>* u, Vec3<T>* d, const T* w) const {
    const ContactBody<T> body = body_of(u, d, w);
    const int count = static_cast<int>(vertices_.size());
    place_vertices<T>
        <<<blocks(count), threads, 0, stream>>>(count, vertices_.get(), cell_, body, keys_.get());
    std::size_t bytes = work_.size();
    check(sort_vertices(work_.get(), bytes, stream), "sorting vertices");
    separate(stream, body, thickness_, push_);
  }
  // After the elements: friction, and what must be kept in any case.
  void enqueue_rub(cudaStream_t stream, const Vec3<T>* u, Vec3<T>* d, const T* w) const {
    const ContactBody<T> body = body_of(u, d, w);
    if (friction_ > 0.0) {
      resist_pairs<T>
          <<<1, contact_threads, 0, stream>>>(triangle_count(), body, friction_, push_.view());
    }
    separate(stream, body, 0.5 * thickness_, rub_);
  }

  // Throws Diverged when more pairs touched than there is room for.
  void check_room() const {
    if (most_.download()[0] <= push_.capacity) return;
    throw Diverged("self-contact: more than " + std::to_string(push_.capacity) +
                   " pairs touch at once, or more than " + std::to_string(max_on_triangle) +
                   " vertices one triangle: flown apart, or too many for a device (device: cpu)");
  }
  // Of a state that is set, no pair has touched.
  void forget() { most_.clear(0, 1); }

  std::size_t count() const {
    const int pairs = push_.begin.download(triangles_.size(), 1)[0];
    return count_held(push_.pairs.download(0, std::min(pairs, push_.capacity)));
  }

 private:
  static constexpr int threads = 128;

  struct List {
    int capacity;
    DeviceArray<TouchingPair> pairs;
    DeviceArray<int> begin, round_of, rounds;

    explicit List(const SurfacePairs& surface)
        : capacity(static_cast<int>(capacity_of(surface))),
          pairs(capacity),
          begin(surface.triangles().size() + 1),
          round_of(capacity),
          rounds(1) {}
    ContactList view() const {
      return {pairs.get(), begin.get(), round_of.get(), rounds.get(), capacity};
    }
  };

  // A vertex lies over one triangle of each sheet that it touches, or two at a seam.
  static std::size_t capacity_of(const SurfacePairs& pairs) {
    return 16 * pairs.vertices().size() + 1024;
  }

  static int blocks(int count) { return (count + threads - 1) / threads; }
  int triangle_count() const { return static_cast<int>(triangles_.size()); }

  ContactBody<T> body_of(const Vec3<T>* u, Vec3<T>* d, const T* w) const {
    return {triangles_.get(), rest_.get(), u, d, w};
  }

  cudaError_t sort_vertices(void* work, std::size_t& bytes, cudaStream_t stream) const {
    return cub::DeviceRadixSort::SortPairs(work, bytes, keys_.get(), sorted_keys_.get(),
                                           vertices_.get(), placed_.get(),
                                           static_cast<int>(vertices_.size()), 0, 64, stream);
  }
  cudaError_t scan_counts(void* work, std::size_t& bytes, int* begin, cudaStream_t stream) const {
    return cub::DeviceScan::ExclusiveScan(work, bytes, counts_.get(), begin,
                                          AddUpTo{push_.capacity + 1}, 0,
                                          static_cast<int>(counts_.size()), stream);
  }

  // Finds what comes nearer than `distance`, into `list`, and moves it apart.
  void separate(cudaStream_t stream, const ContactBody<T>& body, double distance,
                const List& list) const {
    const int count = static_cast<int>(vertices_.size()), triangles = triangle_count();
    check(cudaMemsetAsync(largest_motion_.get(), 0, sizeof(unsigned), stream), "clearing");
    find_largest_motion<T><<<blocks(count), threads, 0, stream>>>(count, vertices_.get(), body,
                                                                  largest_motion_.get());
    const SurfaceGrid grid{
        cell_,           sorted_keys_.get(),   placed_.get(), count, triangles_.get(),
        left_out_.get(), left_out_begin_.get()};
    const auto find = [&](bool lists) {
      find_pairs<T><<<blocks(triangles), threads, 0, stream>>>(lists, triangles, grid, body,
                                                               distance, largest_motion_.get(),
                                                               counts_.get(), list.view());
    };
    find(false);
    std::size_t bytes = work_.size();
    check(scan_counts(work_.get(), bytes, list.begin.get(), stream), "adding counts up");
    find(true);
    move_pairs_apart<T><<<1, contact_threads, 0, stream>>>(triangles, body, distance, list.view(),
                                                           holder_.get(), most_.get());
  }

  double thickness_, friction_;
  double cell_;  // of the grid, m
  DeviceArray<Triangle> triangles_;
  DeviceArray<int> left_out_, left_out_begin_;
  DeviceArray<int> vertices_, placed_;  // of the surface: ascending, and in the grid's order
  DeviceArray<Vec3<double>> rest_;      // [n] m
  DeviceArray<SurfaceGrid::Key> keys_, sorted_keys_;
  DeviceArray<unsigned> largest_motion_;  // [1] the bits of a float, m
  DeviceArray<int> counts_;               // [triangles + 1], the last 0
  DeviceArray<int> holder_;               // [n]
  DeviceArray<int> most_;                 // [1] pairs that touched in any substep
  List push_, rub_;                       // before and after the elements
  DeviceArray<std::byte> work_;           // of sort and scan
};

}  // namespace viscera::sim
