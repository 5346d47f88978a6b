// Self-contact on a device. Candidates are kept as on the CPU (backend/self_contact_step.hpp) and
// found anew, by the device alone, where a vertex has moved too far for them: a group of vertices
// has a box, and a warp a triangle. A substep asks all candidates whether they touch, and one
// thread block moves those that do apart, in rounds. Candidates and pairs are in the order of their
// triangles and vertices: results do not depend on which thread came first.
#pragma once

#include <cooperative_groups/reduce.h>

#include <cub/block/block_scan.cuh>

#include "sim/backend/block_layout.hpp"
#include "sim/backend/cuda/kernels.cuh"
#include "sim/backend/cuda/memory.cuh"
#include "sim/backend/self_contact_step.hpp"
#include "sim/base/triangle.hpp"
#include "sim/model/surface_pairs.hpp"
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
  int* count;           // [1]
  int* round_of;        // [capacity]
  int* rounds;          // [1]
  int capacity;
};

// What is known of candidates, on the device. Motions are bits of floats, m: those of numbers that
// are not negative rise with their values.
struct ContactSearch {
  unsigned since, now;
  double margin;     // m; 0: candidates were never looked for
  int candidates;    // pairs; more than there is room for: none are listed
  int most;          // pairs that touched in any substep
  bool has_overrun;  // more candidates than there was room for, in any substep
};

struct Candidate {
  int triangle, vertex;
};

// The threads of one block as a Team of keep_all_apart().
struct ContactTeam {
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

// The surface and where its candidates were found, as a kernel sees them.
struct ContactSurface {
  const Triangle* triangles;
  const int* vertices;     // [count] ascending
  Vec3<double>* found_at;  // [n] of the surface's vertices, m
  Bounds* boxes;           // of one_warp vertices each
  LeftOut left_out;
  int triangle_count, count;
  double thickness, edge;  // m; the mean edge of a triangle
  int capacity;            // candidates

  __host__ __device__ int groups() const { return (count + one_warp - 1) / one_warp; }
  __device__ static double length(unsigned bits) {
    return static_cast<double>(__uint_as_float(bits));
  }
  __device__ bool is_known(const ContactSearch& search) const {
    return are_known(thickness, search.margin, length(search.since), length(search.now));
  }
  // Beyond an edge only as far as this substep needs, so that there is room for all of them.
  __device__ double next_margin(const ContactSearch& search) const {
    const double now = length(search.now);
    return fmin(margin_of_candidates(thickness, now),
                fmax(edge, contact_reach(thickness, now) - thickness));
  }
};

__device__ inline auto this_warp() {
  return cooperative_groups::tiled_partition<one_warp>(cooperative_groups::this_thread_block());
}

__device__ inline int global_warp() {
  return global_thread() / one_warp;
}
__device__ inline int warps_of_grid() {
  return static_cast<int>(gridDim.x * blockDim.x) / one_warp;
}

template <class T>
__global__ void measure_motion(ContactSurface surface, ContactBody<T> body, ContactSearch* search) {
  const int k = global_thread();
  double since = 0.0, now = 0.0;
  if (k < surface.count) {
    const int vertex = surface.vertices[k], first = surface.vertices[0];
    // All distances are as they were where all have moved as the first one has.
    const Vec3<double> alike = body.start(first) - surface.found_at[first];
    since = norm(body.start(vertex) - surface.found_at[vertex] - alike);
    now = norm(body.motion(vertex));
  }
  const auto raise = [](double length, unsigned& most) {
    const unsigned bits = length > 0.0 ? __float_as_uint(__double2float_ru(length)) : 0u;
    const unsigned of_warp =
        cooperative_groups::reduce(this_warp(), bits, cooperative_groups::greater<unsigned>());
    if (threadIdx.x % one_warp == 0 && of_warp > 0) atomicMax(&most, of_warp);
  };
  raise(since, search->since);
  raise(now, search->now);
}

// Where candidates are looked for, and the box of each group of vertices.
template <class T>
__device__ void place_groups(const ContactSurface& surface, const ContactBody<T>& body) {
  const auto warp = this_warp();
  const auto least = [&warp](double of) {
    return cooperative_groups::reduce(warp, of, cooperative_groups::less<double>());
  };
  for (int group = global_warp(); group < surface.groups(); group += warps_of_grid()) {
    const int k = group * one_warp + static_cast<int>(warp.thread_rank());
    const int vertex = surface.vertices[min(k, surface.count - 1)];
    const Vec3<double> x = body.start(vertex);
    if (k < surface.count) surface.found_at[vertex] = x;
    const Vec3<double> lo{least(x.x), least(x.y), least(x.z)};
    const Vec3<double> hi{-least(-x.x), -least(-x.y), -least(-x.z)};
    if (warp.thread_rank() == 0) surface.boxes[group] = Bounds(lo, hi, hi, 0.0);
  }
}

// Counts the candidates of each triangle, a warp each, or lists them, ascending, where they were
// counted.
__device__ inline void list_candidates(bool lists, const ContactSurface& surface, double reach,
                                       int* counts, const int* begin, Candidate* candidates) {
  const int lane = static_cast<int>(threadIdx.x) % one_warp;
  for (int t = global_warp(); t < surface.triangle_count; t += warps_of_grid()) {
    const auto& [i, j, k] = surface.triangles[t];
    const Vec3<double>&a = surface.found_at[i], &b = surface.found_at[j], &c = surface.found_at[k];
    const Bounds around(a, b, c, reach);
    int found = 0;
    for (int first = 0; first < surface.groups(); first += one_warp) {
      const int group = first + lane;
      const bool meets = group < surface.groups() && around.meets(surface.boxes[group]);
      for (unsigned left = __ballot_sync(~0u, meets); left != 0; left &= left - 1) {
        const int n = (first + __ffs(static_cast<int>(left)) - 1) * one_warp + lane;
        const int vertex = surface.vertices[n < surface.count ? n : 0];
        const Vec3<double>& x = surface.found_at[vertex];
        const bool is_near = n < surface.count && around.holds(x) &&
                             norm(x - nearest_on_triangle(x, a, b, c)) <= reach &&
                             !surface.left_out.holds(t, vertex);
        const unsigned near = __ballot_sync(~0u, is_near);
        if (lists && is_near) {
          candidates[begin[t] + found + __popc(near & ((1u << lane) - 1u))] = {t, vertex};
        }
        found += __popc(near);
      }
    }
    if (!lists && lane == 0) counts[t] = found;
  }
}

constexpr int contact_threads = 1024;
using ContactScan = cub::BlockScan<int, contact_threads>;

// Adds up to one more than there is room for, so that no sum overflows.
struct AddUpTo {
  int most;
  __device__ int operator()(int a, int b) const { return a < most - b ? a + b : most; }
};

// Where the candidates of each triangle begin. By one thread block.
__device__ inline void add_counts_up(const ContactSurface& surface, ContactSearch* search,
                                     const int* counts, int* begin) {
  __shared__ typename ContactScan::TempStorage room;
  const AddUpTo add{surface.capacity + 1};
  const int each = (surface.triangle_count + contact_threads - 1) / contact_threads;
  const int from = min(static_cast<int>(threadIdx.x) * each, surface.triangle_count);
  const int to = min(from + each, surface.triangle_count);
  int sum = 0, all = 0;
  for (int t = from; t < to; ++t) sum = add(sum, counts[t]);
  ContactScan(room).ExclusiveScan(sum, sum, 0, add, all);
  for (int t = from; t < to; ++t) {
    begin[t] = sum;
    sum = add(sum, counts[t]);
  }
  if (threadIdx.x != 0) return;
  search->candidates = all;
  if (all > surface.capacity) search->has_overrun = true;
}

// Candidates anew, where they are no longer known. A cooperative launch.
template <class T>
__global__ void __launch_bounds__(contact_threads)
    find_candidates(ContactSurface surface, ContactBody<T> body, ContactSearch* search, int* counts,
                    int* begin, Candidate* candidates) {
  if (surface.is_known(*search)) return;
  const auto grid = cooperative_groups::this_grid();
  const double reach = surface.thickness + surface.next_margin(*search);
  place_groups(surface, body);
  grid.sync();
  list_candidates(false, surface, reach, counts, begin, candidates);
  grid.sync();
  if (blockIdx.x == 0) add_counts_up(surface, search, counts, begin);
  grid.sync();
  if (search->candidates > surface.capacity) return;
  list_candidates(true, surface, reach, counts, begin, candidates);
}

// Not inlined, so that who asks and who lists finds the same, to the rounding.
template <class T>
__device__ __noinline__ bool touch_in_step(const ContactBody<T>& body, double distance,
                                           double reach, TouchingPair& pair) {
  return touch(pair_of(body, pair.vertex, pair.triangle), distance, reach, pair.over);
}

// Which candidates touch.
template <class T>
__global__ void ask_candidates(ContactSurface surface, ContactBody<T> body, double distance,
                               const ContactSearch* search, const Candidate* candidates,
                               bool* found) {
  const int count = search->candidates;
  if (count > surface.capacity) return;
  const double reach = contact_reach(distance, surface.length(search->now));
  for (int c = global_thread(); c < count; c += static_cast<int>(gridDim.x * blockDim.x)) {
    TouchingPair pair{candidates[c].vertex, candidates[c].triangle, {}, 0.0};
    found[c] = touch_in_step(body, distance, reach, pair);
  }
}

// Lists what touches in the order of the candidates, and moves it apart. By one thread block.
template <class T>
__global__ void __launch_bounds__(contact_threads)
    move_pairs_apart(ContactSurface surface, ContactBody<T> body, double distance,
                     ContactSearch* search, const Candidate* candidates, const bool* found,
                     ContactList list, int* holder) {
  __shared__ typename ContactScan::TempStorage room;
  const int all = search->candidates > surface.capacity ? 0 : search->candidates;
  const double reach = contact_reach(distance, surface.length(search->now));
  int count = 0;
  for (int first = 0; first < all; first += contact_threads) {
    const int c = first + static_cast<int>(threadIdx.x);
    const bool touches = c < all && found[c];
    int before = 0, here = 0;
    ContactScan(room).ExclusiveSum(touches ? 1 : 0, before, here);
    if (touches && count + before < list.capacity) {
      TouchingPair& pair = list.pairs[count + before];
      pair = {candidates[c].vertex, candidates[c].triangle, {}, 0.0};
      touch_in_step(body, distance, reach, pair);
    }
    count += here;
    __syncthreads();
  }
  if (threadIdx.x == 0) {
    if (count > search->most) search->most = count;
    if (!surface.is_known(*search)) search->margin = surface.next_margin(*search);
    search->since = search->now = 0;
    *list.count = count;
  }
  if (count > list.capacity) return;  // the host looks at `most`
  const int rounds =
      keep_all_apart(ContactTeam{}, body, list.pairs, count, distance, list.round_of, holder);
  if (threadIdx.x == 0) *list.rounds = rounds;
}

template <class T>
__global__ void __launch_bounds__(contact_threads)
    resist_pairs(ContactBody<T> body, double friction, ContactList list) {
  const int count = *list.count;
  if (count > list.capacity) return;
  resist_all_slides(ContactTeam{}, body, list.pairs, count, friction, list.round_of, *list.rounds);
}

template <class T>
class CudaSelfContact {
 public:
  CudaSelfContact(const SurfacePairs& pairs, const std::vector<Vec3<double>>& rest,
                  const SelfContact::Params& params)
      : thickness_(params.thickness),
        friction_(params.friction),
        edge_(pairs.mean_edge(rest)),
        triangles_(pairs.triangles()),
        left_out_(pairs.left_out()),
        left_out_begin_(pairs.left_out_begin()),
        vertices_(pairs.vertices()),
        rest_(rest),
        found_at_(rest.size()),
        boxes_(pairs.vertices().size() / one_warp + 1),
        counts_(pairs.triangles().size()),
        begin_(pairs.triangles().size()),
        candidates_(candidates_in(pairs)),
        touches_(candidates_.size()),
        search_(1),
        holder_(std::vector<int>(rest.size(), unclaimed)),
        push_(pairs),
        rub_(pairs) {
    int a_processor = 0;
    check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&a_processor, find_candidates<T>,
                                                        contact_threads, 0),
          "asking for the blocks that run at once");
    const int processors = device_attribute(cudaDevAttrMultiProcessorCount);
    const int wanted = (triangle_count() * one_warp + contact_threads - 1) / contact_threads;
    finding_blocks_ = std::max(1, std::min(wanted, a_processor * processors));
  }

  // Of a body with this many vertices in all.
  static std::size_t bytes(const SurfacePairs& pairs, std::size_t vertices) {
    return vertices * (2 * sizeof(Vec3<double>) + sizeof(int)) +
           pairs.vertices().size() * (sizeof(int) + sizeof(Bounds) / one_warp) +
           pairs.triangles().size() * (sizeof(Triangle) + 3 * sizeof(int)) +
           pairs.left_out().size() * sizeof(int) +
           candidates_in(pairs) * (sizeof(Candidate) + sizeof(bool)) +
           2 * capacity_of(pairs) * (sizeof(TouchingPair) + sizeof(int));
  }

  void retune(const SelfContact::Params& params) { friction_ = params.friction; }

  // Before the elements: leads d out.
  void enqueue_push(cudaStream_t stream, const Vec3<T>* u, Vec3<T>* d, const T* w) const {
    separate(stream, body_of(u, d, w), thickness_, push_);
  }
  // After the elements: friction, and what must be kept in any case.
  void enqueue_rub(cudaStream_t stream, const Vec3<T>* u, Vec3<T>* d, const T* w) const {
    const ContactBody<T> body = body_of(u, d, w);
    if (friction_ > 0.0) {
      resist_pairs<T><<<1, contact_threads, 0, stream>>>(body, friction_, push_.view());
    }
    separate(stream, body, 0.5 * thickness_, rub_);
  }

  // Throws Diverged when more pairs touched, or were near, than there is room for.
  void check_room() const {
    const ContactSearch search = search_.download()[0];
    if (!search.has_overrun && search.most <= push_.capacity) return;
    throw Diverged("self-contact: more than " +
                   (search.has_overrun
                        ? std::to_string(candidates_.size()) + " pairs are near one another"
                        : std::to_string(push_.capacity) + " pairs touch at once") +
                   ": flown apart, or too many for a device (device: cpu)");
  }
  // Of a state that is set, no pair has touched.
  void forget() { search_.clear(0, 1); }

  std::size_t count() const {
    const int pairs = push_.count.download()[0];
    return count_held(push_.pairs.download(0, std::min(pairs, push_.capacity)));
  }

 private:
  static constexpr int threads = 128;
  static constexpr int asking_blocks = 264;  // of a device with 132 multiprocessors, two each

  struct List {
    int capacity;
    DeviceArray<TouchingPair> pairs;
    DeviceArray<int> count, round_of, rounds;

    explicit List(const SurfacePairs& surface)
        : capacity(static_cast<int>(capacity_of(surface))),
          pairs(capacity),
          count(1),
          round_of(capacity),
          rounds(1) {}
    ContactList view() const {
      return {pairs.get(), count.get(), round_of.get(), rounds.get(), capacity};
    }
  };

  // A vertex lies over one triangle of each sheet that it touches, or two at a seam.
  static std::size_t capacity_of(const SurfacePairs& pairs) {
    return 16 * pairs.vertices().size() + 1024;
  }
  // Within an edge of a triangle lie some 20 vertices of a sheet, and there are two triangles a
  // vertex.
  static std::size_t candidates_in(const SurfacePairs& pairs) {
    return 128 * pairs.vertices().size() + 1024;
  }

  static int blocks(int count) { return (count + threads - 1) / threads; }
  int triangle_count() const { return static_cast<int>(triangles_.size()); }

  ContactBody<T> body_of(const Vec3<T>* u, Vec3<T>* d, const T* w) const {
    return {triangles_.get(), rest_.get(), u, d, w};
  }
  ContactSurface surface() const {
    return {triangles_.get(),
            vertices_.get(),
            found_at_.get(),
            boxes_.get(),
            {left_out_.get(), left_out_begin_.get()},
            triangle_count(),
            static_cast<int>(vertices_.size()),
            thickness_,
            edge_,
            static_cast<int>(candidates_.size())};
  }

  // Finds what comes nearer than `distance`, into `list`, and moves it apart.
  void separate(cudaStream_t stream, ContactBody<T> body, double distance, const List& list) const {
    ContactSurface surface = this->surface();
    ContactSearch* search = search_.get();
    measure_motion<T><<<blocks(surface.count), threads, 0, stream>>>(surface, body, search);
    int *counts = counts_.get(), *begin = begin_.get();
    Candidate* candidates = candidates_.get();
    void* arguments[] = {&surface, &body, &search, &counts, &begin, &candidates};
    check(cudaLaunchCooperativeKernel(find_candidates<T>, dim3(finding_blocks_),
                                      dim3(contact_threads), arguments, 0, stream),
          "looking for what may touch");
    ask_candidates<T><<<asking_blocks, threads, 0, stream>>>(surface, body, distance, search,
                                                             candidates_.get(), touches_.get());
    move_pairs_apart<T><<<1, contact_threads, 0, stream>>>(surface, body, distance, search,
                                                           candidates_.get(), touches_.get(),
                                                           list.view(), holder_.get());
  }

  double thickness_, friction_;
  double edge_;  // the mean of the surface, m
  DeviceArray<Triangle> triangles_;
  DeviceArray<int> left_out_, left_out_begin_;
  DeviceArray<int> vertices_;           // of the surface, ascending
  DeviceArray<Vec3<double>> rest_;      // [n] m
  DeviceArray<Vec3<double>> found_at_;  // [n] m
  DeviceArray<Bounds> boxes_;           // of one_warp vertices each
  DeviceArray<int> counts_, begin_;     // [triangles] of candidates
  DeviceArray<Candidate> candidates_;
  DeviceArray<bool> touches_;          // [candidates]
  DeviceArray<ContactSearch> search_;  // [1]
  DeviceArray<int> holder_;            // [n]
  int finding_blocks_;                 // that run at once
  List push_, rub_;                    // before and after the elements
};

}  // namespace viscera::sim
