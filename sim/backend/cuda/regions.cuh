// The regions of one effect on a device: a thread block sums over a region in a fixed order and
// fits it, then each vertex is pulled by those that it is in.
#pragma once

#include "sim/backend/cuda/memory.cuh"
#include "sim/backend/region_step.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

// What regions read of a body and its substep.
template <class T>
struct RegionBody {
  const Vec3<T>* u;  // m
  Vec3<T>* d;        // m
  const T* w;        // inverse mass, 1/kg

  SIM_HD Vec3<double> moved(int v, Arithmetic arithmetic) const {
    return seen_by_regions(u[v], d[v], arithmetic);
  }
};

constexpr int region_threads = 256;

template <class T>
__global__ void __launch_bounds__(region_threads)
    fit_regions(const Region* regions, const RegionMember* members, RegionBody<T> body,
                Arithmetic arithmetic, RegionFit* fits) {
  __shared__ alignas(RegionSums) unsigned char storage[region_threads * sizeof(RegionSums)];
  auto* const sums = reinterpret_cast<RegionSums*>(storage);
  const Region& region = regions[blockIdx.x];
  const int rank = static_cast<int>(threadIdx.x);
  RegionSums own;
  for (int m = region.begin + rank; m < region.end; m += region_threads) {
    own.add(members[m], body.moved(members[m].vertex, arithmetic));
  }
  sums[rank] = own;
  for (int half = region_threads / 2; half > 0; half /= 2) {
    __syncthreads();
    if (rank < half) sums[rank] += sums[rank + half];
  }
  if (rank > 0) return;
  RegionSums all = RegionFit::begin(region);
  all += sums[0];
  fits[blockIdx.x] = {region, all};
}

template <class T>
__global__ void pull_vertices(int n, const int* begin, const int* of_vertex,
                              const RegionMember* members, const int* region_of,
                              const double* squared_phase, const RegionFit* fits,
                              Arithmetic arithmetic, double pbd_stiffness, Vec3<double>* so_far,
                              RegionBody<T> body) {
  const int i = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (i >= n || !(body.w[i] > T(0))) return;
  const Vec3<double> moved = body.moved(i, arithmetic);
  Vec3<double> sum;
  for (int k = begin[i]; k < begin[i + 1]; ++k) {
    const int m = of_vertex[k], r = region_of[m];
    sum += members[m].share * pull_member(fits[r], members[m], moved, squared_phase[r], arithmetic,
                                          pbd_stiffness, so_far ? so_far + m : nullptr);
  }
  body.d[i] += cast<T>(sum);
}

template <class T>
class CudaRegions {
 public:
  // `iterates`: a substep has several iterations.
  CudaRegions(const Regions& host, const std::vector<double>& squared_phase, bool iterates)
      : n_(static_cast<int>(host.begin.size()) - 1),
        regions_(host.regions),
        members_(host.members),
        begin_(host.begin),
        of_vertex_(host.of_vertex),
        squared_phase_(squared_phase),
        region_of_(regions_of_members(host)),
        fits_(host.regions.size()),
        so_far_(iterates ? host.members.size() : 0) {}

  static std::size_t bytes(const Regions& host, bool iterates) {
    return host.members.size() * (sizeof(RegionMember) + 2 * sizeof(int)) +
           host.begin.size() * sizeof(int) +
           host.regions.size() * (sizeof(Region) + sizeof(RegionFit) + sizeof(double)) +
           (iterates ? host.members.size() * sizeof(Vec3<double>) : 0);
  }

  void retune(const std::vector<double>& squared_phase) { squared_phase_.upload(squared_phase); }

  // One iteration.
  void enqueue(cudaStream_t stream, Arithmetic arithmetic, double pbd_stiffness,
               const RegionBody<T>& body) const {
    const int regions = static_cast<int>(regions_.size());
    fit_regions<T><<<regions, region_threads, 0, stream>>>(regions_.get(), members_.get(), body,
                                                           arithmetic, fits_.get());
    const int blocks = (n_ + region_threads - 1) / region_threads;
    pull_vertices<T><<<blocks, region_threads, 0, stream>>>(
        n_, begin_.get(), of_vertex_.get(), members_.get(), region_of_.get(), squared_phase_.get(),
        fits_.get(), arithmetic, pbd_stiffness, so_far_.get(), body);
  }

 private:
  int n_;
  DeviceArray<Region> regions_;
  DeviceArray<RegionMember> members_;
  DeviceArray<int> begin_, of_vertex_;
  DeviceArray<double> squared_phase_;  // [regions] omega^2 dt^2
  DeviceArray<int> region_of_;         // [members]
  DeviceArray<RegionFit> fits_;        // [regions]
  DeviceArray<Vec3<double>> so_far_;   // [members], where a substep has several iterations, m
};

}  // namespace viscera::sim
