// Self-contact on a device. Candidates are kept as on the CPU (backend/self_contact_step.hpp) and
// found anew, by the device alone, where a vertex has moved too far for them: a group of vertices
// has a box, and a warp a triangle. A substep asks all candidates whether they touch, and one
// thread block moves those that do apart and resists their slide, in rounds. Candidates and pairs
// are in the order of their triangles and vertices: results do not depend on which thread came
// first. All of it is done by a grid whose thread blocks run at once and meet in between: one of
// its own, or that of a frame in blocks (cuda/block_contact.cuh).
#pragma once

#include <cooperative_groups/reduce.h>
#include <cooperative_groups/scan.h>

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
  Neighbours neighbours;
  const Vec3<double>* rest;  // m
  const Vec3<T>* u;          // m
  Vec3<T>* d;                // m
  const T* w;                // inverse mass, 1/kg

  SIM_HD Vec3<double> start(int v) const { return rest[v] + cast<double>(u[v]); }
  SIM_HD Vec3<double> motion(int v) const { return cast<double>(d[v]); }
  SIM_HD double mobility(int v) const { return static_cast<double>(w[v]); }
  SIM_HD void move(int v, const Vec3<double>& by) const { d[v] += cast<T>(by); }
};

// The pairs that touch in a substep, on the device.
struct ContactList {
  TouchingPair* pairs;  // [capacity]
  int* count;           // [1]
  int* round_of;        // [capacity]
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
  __device__ void lower(Claim& a, Claim b) const {
    atomicMin(reinterpret_cast<long long*>(&a), static_cast<long long>(b));
  }
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

__device__ inline int threads_of_grid() {
  return static_cast<int>(gridDim.x * blockDim.x);
}
__device__ inline int global_warp() {
  return global_thread() / one_warp;
}
__device__ inline int warps_of_grid() {
  return threads_of_grid() / one_warp;
}

// One self-contact of a body: what a grid works on whose threads are all there at once.
template <class T>
struct SelfContactView {
  ContactSurface surface;
  ContactBody<T> body;
  double friction;
  ContactSearch* search;
  int *counts, *begin;  // [triangles] of candidates
  Candidate* candidates;
  int* touching;                          // [candidates] which touch: each warp lists its part
  int *touching_counts, *touching_begin;  // [warps]
  Claim* holder;                          // [n]
  ContactList list;
};

template <class T>
__device__ void measure_motion(const SelfContactView<T>& contact) {
  const ContactSurface& surface = contact.surface;
  const ContactBody<T>& body = contact.body;
  const int first = surface.vertices[0];
  // All distances are as they were where all have moved as the first one has.
  const Vec3<double> alike = body.start(first) - surface.found_at[first];
  double since = 0.0, now = 0.0;
  for (int k = global_thread(); k < surface.count; k += threads_of_grid()) {
    const int vertex = surface.vertices[k];
    since = fmax(since, norm(body.start(vertex) - surface.found_at[vertex] - alike));
    now = fmax(now, norm(body.motion(vertex)));
  }
  const auto raise = [](double length, unsigned& most) {
    const unsigned bits = length > 0.0 ? __float_as_uint(__double2float_ru(length)) : 0u;
    const unsigned of_warp =
        cooperative_groups::reduce(this_warp(), bits, cooperative_groups::greater<unsigned>());
    if (threadIdx.x % one_warp == 0 && of_warp > 0) atomicMax(&most, of_warp);
  };
  raise(since, contact.search->since);
  raise(now, contact.search->now);
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

inline constexpr int room_for_sums = one_warp;

// The sum over the threads of a block before this one; `all` is that over all of them. `room` in
// shared memory, [room_for_sums].
template <class Add>
__device__ int sum_before(int own, const Add& add, int* room, int& all) {
  const int warp = static_cast<int>(threadIdx.x) / one_warp;
  const int in_warp = cooperative_groups::exclusive_scan(this_warp(), own, add);
  if (threadIdx.x % one_warp == one_warp - 1) room[warp] = add(in_warp, own);
  __syncthreads();
  int before = 0;
  all = 0;
  for (int k = 0; k < static_cast<int>(blockDim.x) / one_warp; ++k) {
    if (k == warp) before = all;
    all = add(all, room[k]);
  }
  __syncthreads();
  return add(before, in_warp);
}

// Adds up to one more than there is room for, so that no sum overflows.
struct AddUpTo {
  int most;
  __device__ int operator()(int a, int b) const { return a < most - b ? a + b : most; }
};

// Where the candidates of each triangle begin. By one thread block.
__device__ inline void add_counts_up(const ContactSurface& surface, ContactSearch* search,
                                     const int* counts, int* begin, int* room) {
  const AddUpTo add{surface.capacity + 1};
  const int threads = static_cast<int>(blockDim.x);
  const int each = (surface.triangle_count + threads - 1) / threads;
  const int from = min(static_cast<int>(threadIdx.x) * each, surface.triangle_count);
  const int to = min(from + each, surface.triangle_count);
  int sum = 0, all = 0;
  for (int t = from; t < to; ++t) sum = add(sum, counts[t]);
  sum = sum_before(sum, add, room, all);
  for (int t = from; t < to; ++t) {
    begin[t] = sum;
    sum = add(sum, counts[t]);
  }
  if (threadIdx.x != 0) return;
  search->candidates = all;
  if (all > surface.capacity) search->has_overrun = true;
}

template <class T>
__device__ void find_candidates(const SelfContactView<T>& contact, int* room) {
  const auto grid = cooperative_groups::this_grid();
  const ContactSurface& surface = contact.surface;
  const double reach = surface.thickness + surface.next_margin(*contact.search);
  place_groups(surface, contact.body);
  grid.sync();
  list_candidates(false, surface, reach, contact.counts, contact.begin, contact.candidates);
  grid.sync();
  if (blockIdx.x == 0) {
    add_counts_up(surface, contact.search, contact.counts, contact.begin, room);
  }
  grid.sync();
  if (contact.search->candidates <= surface.capacity) {
    list_candidates(true, surface, reach, contact.counts, contact.begin, contact.candidates);
  }
  grid.sync();
}

// None where there are more than there is room for.
__device__ inline int listed(const ContactSurface& surface, const ContactSearch& search) {
  return search.candidates > surface.capacity ? 0 : search.candidates;
}
// Of the candidates, for each warp of the grid.
__device__ inline int share_of_warp(int candidates) {
  return round_up((candidates + warps_of_grid() - 1) / warps_of_grid(), one_warp);
}

// Not inlined, so that who asks and who lists finds the same, to the rounding.
template <class T>
__device__ __noinline__ bool touch_in_step(const ContactBody<T>& body, double thickness,
                                           double reach, TouchingPair& pair) {
  return touch(body, pair.vertex, pair.triangle, thickness, reach, pair.over);
}

// Which candidates touch.
template <class T>
__device__ void ask_candidates(const SelfContactView<T>& contact) {
  const double thickness = contact.surface.thickness;
  const double reach = contact_reach(thickness, ContactSurface::length(contact.search->now));
  const int all = listed(contact.surface, *contact.search), share = share_of_warp(all);
  const int lane = static_cast<int>(threadIdx.x) % one_warp;
  const int begin = global_warp() * share, end = min(begin + share, all);
  int found = 0;
  for (int first = begin; first < end; first += one_warp) {
    const int c = first + lane;
    bool touches = false;
    if (c < end) {
      TouchingPair pair{contact.candidates[c].vertex, contact.candidates[c].triangle, {}, 0.0};
      touches = touch_in_step(contact.body, thickness, reach, pair);
    }
    const unsigned touching = __ballot_sync(~0u, touches);
    if (touches) contact.touching[begin + found + __popc(touching & ((1u << lane) - 1u))] = c;
    found += __popc(touching);
  }
  if (lane == 0) contact.touching_counts[global_warp()] = found;
}

// Lists what touches in the order of the candidates, moves it apart and resists its slide. By one
// thread block.
template <class T>
__device__ void move_pairs_apart(const SelfContactView<T>& contact, int* room) {
  const ContactSurface& surface = contact.surface;
  const ContactList& list = contact.list;
  ContactSearch& search = *contact.search;
  const double reach = contact_reach(surface.thickness, surface.length(search.now));
  const int share = share_of_warp(listed(surface, search)), warps = warps_of_grid();
  const int threads = static_cast<int>(blockDim.x);
  int* const begin = contact.touching_begin;
  int count = 0;
  for (int first = 0; first < warps; first += threads) {
    const int warp = first + static_cast<int>(threadIdx.x);
    int here = 0;
    const int before = sum_before(warp < warps ? contact.touching_counts[warp] : 0,
                                  cooperative_groups::plus<int>(), room, here);
    if (warp < warps) begin[warp] = count + before;
    count += here;
  }
  if (threadIdx.x == 0) {
    if (count > search.most) search.most = count;
    if (!surface.is_known(search)) search.margin = surface.next_margin(search);
    search.since = search.now = 0;
    *list.count = count;
  }
  __syncthreads();
  if (count > list.capacity) return;  // the host looks at `most`
  for (int p = static_cast<int>(threadIdx.x); p < count; p += threads) {
    int warp = 0;  // the last that begins at p or before
    for (int after = warps; after - warp > 1;) {
      const int middle = (warp + after) / 2;
      (begin[middle] <= p ? warp : after) = middle;
    }
    const Candidate& candidate =
        contact.candidates[contact.touching[warp * share + p - begin[warp]]];
    list.pairs[p] = {candidate.vertex, candidate.triangle, {}, 0.0};
    touch_in_step(contact.body, surface.thickness, reach, list.pairs[p]);
    prepare(contact.body, surface.thickness, list.pairs[p]);
  }
  __syncthreads();
  const ContactTeam team;
  const int rounds =
      keep_all_apart(team, contact.body, list.pairs, count, list.round_of, contact.holder);
  if (!(contact.friction > 0.0)) return;
  resist_all_slides(team, contact.body, list.pairs, count, contact.friction, list.round_of, rounds);
}

// Holds surfaces apart after the elements.
template <class T>
__device__ __noinline__ void separate(const SelfContactView<T>& contact, int* room) {
  const auto grid = cooperative_groups::this_grid();
  measure_motion(contact);
  grid.sync();
  if (!contact.surface.is_known(*contact.search)) find_candidates(contact, room);
  ask_candidates(contact);
  grid.sync();
  if (blockIdx.x == 0) move_pairs_apart(contact, room);
  grid.sync();
}

inline constexpr int contact_threads = 512;

// A cooperative launch.
template <class T>
__global__ void __launch_bounds__(contact_threads)
    separate_surface(const __grid_constant__ SelfContactView<T> contact) {
  __shared__ int room[room_for_sums];
  separate(contact, room);
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
        neighbours_(pairs.neighbours()),
        neighbours_begin_(pairs.neighbours_begin()),
        vertices_(pairs.vertices()),
        rest_(rest),
        found_at_(rest.size()),
        boxes_(pairs.vertices().size() / one_warp + 1),
        counts_(pairs.triangles().size()),
        begin_(pairs.triangles().size()),
        candidates_(candidates_in(pairs)),
        touching_(candidates_.size()),
        touching_counts_(warps_at_once()),
        touching_begin_(touching_counts_.size()),
        search_(1),
        holder_(std::vector<Claim>(rest.size(), unclaimed)),
        list_(pairs) {
    const int wanted = (triangle_count() * one_warp + contact_threads - 1) / contact_threads;
    blocks_ = std::min(wanted, device_attribute(cudaDevAttrMultiProcessorCount));
  }

  // Of a body with this many vertices in all.
  static std::size_t bytes(const SurfacePairs& pairs, std::size_t vertices) {
    return vertices * (2 * sizeof(Vec3<double>) + sizeof(Claim) + sizeof(int)) +
           pairs.vertices().size() * (sizeof(int) + sizeof(Bounds) / one_warp) +
           pairs.triangles().size() * (sizeof(Triangle) + 3 * sizeof(int)) +
           (pairs.left_out().size() + pairs.neighbours().size()) * sizeof(int) +
           candidates_in(pairs) * (sizeof(Candidate) + sizeof(int)) +
           capacity_of(pairs) * (sizeof(TouchingPair) + sizeof(int));
  }

  void retune(const SelfContact::Params& params) { friction_ = params.friction; }

  // Of the motion `d` over a substep that begins at `u`.
  SelfContactView<T> view(const Vec3<T>* u, Vec3<T>* d, const T* w) const {
    const ContactSurface surface = {triangles_.get(),
                                    vertices_.get(),
                                    found_at_.get(),
                                    boxes_.get(),
                                    {left_out_.get(), left_out_begin_.get()},
                                    triangle_count(),
                                    static_cast<int>(vertices_.size()),
                                    thickness_,
                                    edge_,
                                    static_cast<int>(candidates_.size())};
    return {surface,
            {triangles_.get(), {neighbours_.get(), neighbours_begin_.get()}, rest_.get(), u, d, w},
            friction_,
            search_.get(),
            counts_.get(),
            begin_.get(),
            candidates_.get(),
            touching_.get(),
            touching_counts_.get(),
            touching_begin_.get(),
            holder_.get(),
            list_.view()};
  }
  // In a launch of its own.
  void enqueue(cudaStream_t stream, const Vec3<T>* u, Vec3<T>* d, const T* w) const {
    SelfContactView<T> contact = view(u, d, w);
    void* arguments[] = {&contact};
    check(cudaLaunchCooperativeKernel(separate_surface<T>, dim3(blocks_), dim3(contact_threads),
                                      arguments, 0, stream),
          "moving a surface apart");
  }

  // Throws Diverged when more pairs touched, or were near, than there is room for.
  void check_room() const {
    const ContactSearch search = search_.download()[0];
    if (!search.has_overrun && search.most <= list_.capacity) return;
    throw Diverged("self-contact: more than " +
                   (search.has_overrun
                        ? std::to_string(candidates_.size()) + " pairs are near one another"
                        : std::to_string(list_.capacity) + " pairs touch at once") +
                   ": flown apart, or too many for a device (device: cpu)");
  }
  // Of a state that is set, no pair has touched.
  void forget() { search_.clear(0, 1); }

  std::size_t count() const {
    const int pairs = list_.count.download()[0];
    return count_held(list_.pairs.download(0, std::min(pairs, list_.capacity)));
  }

 private:
  struct List {
    int capacity;
    DeviceArray<TouchingPair> pairs;
    DeviceArray<int> count, round_of;

    explicit List(const SurfacePairs& surface)
        : capacity(static_cast<int>(capacity_of(surface))),
          pairs(capacity),
          count(1),
          round_of(capacity) {}
    ContactList view() const { return {pairs.get(), count.get(), round_of.get(), capacity}; }
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

  static int warps_at_once() {
    return device_attribute(cudaDevAttrMultiProcessorCount) *
           device_attribute(cudaDevAttrMaxThreadsPerMultiProcessor) / one_warp;
  }
  int triangle_count() const { return static_cast<int>(triangles_.size()); }

  double thickness_, friction_;
  double edge_;  // the mean of the surface, m
  DeviceArray<Triangle> triangles_;
  DeviceArray<int> left_out_, left_out_begin_;
  DeviceArray<int> neighbours_, neighbours_begin_;
  DeviceArray<int> vertices_;           // of the surface, ascending
  DeviceArray<Vec3<double>> rest_;      // [n] m
  DeviceArray<Vec3<double>> found_at_;  // [n] m
  DeviceArray<Bounds> boxes_;           // of one_warp vertices each
  DeviceArray<int> counts_, begin_;     // [triangles] of candidates
  DeviceArray<Candidate> candidates_;
  DeviceArray<int> touching_;                          // [candidates]
  DeviceArray<int> touching_counts_, touching_begin_;  // [warps that run at once]
  DeviceArray<ContactSearch> search_;                  // [1]
  DeviceArray<Claim> holder_;                          // [n]
  List list_;
  int blocks_;  // of a launch of its own
};

}  // namespace viscera::sim
