// The implicit step of the rate forces (solvers/xpbd/viscous_step.hpp) on a device, colour by
// colour's companion: the same sums as on the CPU, in a fixed order. A few iterations are one
// graph; once the residual is small enough what is left of them does nothing, and the host asks
// after each.
#pragma once

#include <cuda_runtime.h>

#include "sim/backend/cuda/kernels.cuh"
#include "sim/backend/cuda/memory.cuh"
#include "sim/solvers/xpbd/damping_choice.hpp"

namespace viscera::sim {

// Of conjugate gradients, J.
struct DampingSums {
  double rr, pq, left;
  double size;  // of the change, squared
  SIM_HD bool goes_on() const { return rr > ViscousStep::enough(size); }
};

template <class T>
__global__ void move_by(int n, const Vec3<T>* velocity, T dt, Vec3<T>* d) {
  const int i = global_thread();
  if (i < n) d[i] = dt * velocity[i];
}

// out += tau M^-1 f of the impulses that elements have left
template <class T>
__global__ void add_decay(int n, const int* begin, const int* slots, const Vec3<T>* impulses,
                          const T* w, T tau, Vec3<T>* out) {
  const int i = global_thread();
  if (i < n) out[i] += (tau * w[i]) * impulse_on(i, begin, slots, impulses);
}

// A block's part of sum m a . b
template <class T>
__global__ void inner_parts(int n, const T* w, const Vec3<T>* a, const Vec3<T>* b, double* parts) {
  __shared__ double sums[block_size];
  const int i = global_thread();
  sums[threadIdx.x] =
      i < n && w[i] > T(0) ? static_cast<double>(dot(a[i], b[i])) / static_cast<double>(w[i]) : 0.0;
  for (int half = block_size / 2; half > 0; half /= 2) {
    __syncthreads();
    if (threadIdx.x < half) sums[threadIdx.x] += sums[threadIdx.x + half];
  }
  if (threadIdx.x == 0) parts[blockIdx.x] = sums[0];
}
// By one block.
static __global__ void inner_total(int count, const double* parts, double* total) {
  __shared__ double sums[block_size];
  double sum = 0.0;
  for (int k = threadIdx.x; k < count; k += block_size) sum += parts[k];
  sums[threadIdx.x] = sum;
  for (int half = block_size / 2; half > 0; half /= 2) {
    __syncthreads();
    if (threadIdx.x < half) sums[threadIdx.x] += sums[threadIdx.x + half];
  }
  if (threadIdx.x == 0) *total = sums[0];
}

static __global__ void begin_sums(DampingSums* sums) {
  sums->size = 0.0;
}
// q is what p loses on entry, and A p from then on.
template <class T>
__global__ void complete_product(int n, const Vec3<T>* p, Vec3<T>* q) {
  const int i = global_thread();
  if (i < n) q[i] = p[i] - q[i];
}
template <class T>
__global__ void descend(int n, const T* w, const DampingSums* sums, const Vec3<T>* p,
                        const Vec3<T>* q, Vec3<T>* change, Vec3<T>* r) {
  const int i = global_thread();
  if (i >= n || !(w[i] > T(0)) || !sums->goes_on()) return;
  const T alpha = static_cast<T>(sums->rr / sums->pq);
  change[i] += alpha * p[i];
  r[i] -= alpha * q[i];
}
template <class T>
__global__ void turn(int n, const T* w, const DampingSums* sums, const Vec3<T>* r, Vec3<T>* p) {
  const int i = global_thread();
  if (i >= n || !(w[i] > T(0)) || !sums->goes_on()) return;
  p[i] = r[i] + static_cast<T>(sums->left / sums->rr) * p[i];
}
static __global__ void end_iteration(DampingSums* sums) {
  if (sums->goes_on()) sums->rr = sums->left;
}

// With <v, change> in pq.
template <class T>
__global__ void take_change(int n, const DampingSums* sums, const Vec3<T>* change, TimeRule<T> rule,
                            Vec3<T>* v, Added<T>* last) {
  const int i = global_thread();
  if (i >= n) return;
  const Vec3<T> taken = static_cast<T>(share_that_loses_energy(-sums->pq, sums->size)) * change[i];
  v[i] += taken;
  last[i].u += rule.dt * taken;
}

template <class T>
class CudaViscousStep {
 public:
  CudaViscousStep(int vertices, const T* inverse_mass)
      : n_(vertices),
        w_(inverse_mass),
        change_(vertices),
        r_(vertices),
        p_(vertices),
        q_(vertices),
        parts_(blocks()),
        sums_(1) {}

  // enqueue_decay(arithmetic, velocity, out) adds tau M^-1 f(velocity) to out, with f the rate
  // forces; `v` are the velocities that are damped, `last` what goes with them.
  template <class EnqueueDecay>
  void capture(cudaStream_t stream, const TimeRule<T>& rule, Vec3<T>* v, Added<T>* last,
               EnqueueDecay&& enqueue_decay) {
    DampingSums* const sums = sums_.get();
    begin_ = Graph(stream, [&] {
      clear(stream, r_);
      clear(stream, change_);
      enqueue_decay(Arithmetic::in_full, v, r_.get());
      check(cudaMemcpyAsync(p_.get(), r_.get(), n_ * sizeof(Vec3<T>), cudaMemcpyDeviceToDevice,
                            stream),
            "copying");
      enqueue_inner(stream, r_.get(), r_.get(), &sums->rr);
      begin_sums<<<1, 1, 0, stream>>>(sums);
    });
    iterate_ = Graph(stream, [&] {
      for (int k = 0; k < at_once; ++k) {
        clear(stream, q_);
        enqueue_decay(Arithmetic::resisted, p_.get(), q_.get());
        complete_product<T><<<blocks(), block_size, 0, stream>>>(n_, p_.get(), q_.get());
        enqueue_inner(stream, p_.get(), q_.get(), &sums->pq);
        descend<T><<<blocks(), block_size, 0, stream>>>(n_, w_, sums, p_.get(), q_.get(),
                                                        change_.get(), r_.get());
        enqueue_inner(stream, r_.get(), r_.get(), &sums->left);
        turn<T><<<blocks(), block_size, 0, stream>>>(n_, w_, sums, r_.get(), p_.get());
        end_iteration<<<1, 1, 0, stream>>>(sums);
        enqueue_inner(stream, change_.get(), change_.get(), &sums->size);
      }
    });
    end_ = Graph(stream, [&] {
      enqueue_inner(stream, v, change_.get(), &sums->pq);
      take_change<T><<<blocks(), block_size, 0, stream>>>(n_, sums, change_.get(), rule, v, last);
    });
  }

  void apply(const Stream& stream) const {
    begin_.launch(stream, "launching a step of damping");
    for (int k = 0; k < ViscousStep::max_iterations; k += at_once) {
      iterate_.launch(stream, "launching a step of damping");
      stream.finish("running a step of damping");
      const DampingSums sums = sums_.download()[0];
      if (!sums.goes_on()) break;
    }
    end_.launch(stream, "launching a step of damping");
  }

  static std::size_t bytes(std::size_t vertices) { return vertices * 4 * sizeof(Vec3<T>); }

 private:
  static constexpr int at_once = 8;

  int blocks() const { return (n_ + block_size - 1) / block_size; }
  void clear(cudaStream_t stream, DeviceArray<Vec3<T>>& field) {
    check(cudaMemsetAsync(field.get(), 0, n_ * sizeof(Vec3<T>), stream), "clearing");
  }
  void enqueue_inner(cudaStream_t stream, const Vec3<T>* a, const Vec3<T>* b, double* total) {
    inner_parts<T><<<blocks(), block_size, 0, stream>>>(n_, w_, a, b, parts_.get());
    inner_total<<<1, block_size, 0, stream>>>(blocks(), parts_.get(), total);
  }

  int n_;
  const T* w_;                               // [n] 1/kg, 0 for vertices that no force moves
  DeviceArray<Vec3<T>> change_, r_, p_, q_;  // [n] m/s
  DeviceArray<double> parts_;
  DeviceArray<DampingSums> sums_;
  Graph begin_, iterate_, end_;
};

}  // namespace viscera::sim
