// Device memory and the check of every CUDA call.
#pragma once

#include <cuda_runtime.h>

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "sim/refusal.hpp"

namespace viscera::sim {

inline void check(cudaError_t status, const char* doing) {
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
    clear(0, size);
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

  void upload(const std::vector<T>& host, std::size_t first = 0) {
    if (host.empty()) return;
    check(cudaMemcpy(data_ + first, host.data(), host.size() * sizeof(T), cudaMemcpyHostToDevice),
          "uploading");
  }
  std::vector<T> download() const { return download(0, size_); }
  std::vector<T> download(std::size_t first, std::size_t count) const {
    std::vector<T> host(count);
    if (count == 0) return host;
    check(cudaMemcpy(host.data(), data_ + first, count * sizeof(T), cudaMemcpyDeviceToHost),
          "downloading");
    return host;
  }
  void clear(std::size_t first, std::size_t count) {
    if (count > 0) check(cudaMemset(data_ + first, 0, count * sizeof(T)), "clearing");
  }
  T* get() const { return data_; }
  std::size_t size() const { return size_; }

 private:
  T* data_ = nullptr;
  std::size_t size_ = 0;
};

// Refuses before the first allocation what will not fit.
inline void require_device_memory(std::size_t bytes) {
  std::size_t free_bytes = 0, total_bytes = 0;
  check(cudaMemGetInfo(&free_bytes, &total_bytes), "asking for the free memory");
  if (bytes <= free_bytes) return;
  throw Refusal(Refusal::Cause::device, "mesh",
                "needs " + std::to_string(bytes >> 20) + " MiB on the device",
                "at most " + std::to_string(free_bytes >> 20) + " MiB, which are free",
                "use a coarser mesh, fewer members or device: cpu");
}

// What elements keep from one substep to the next: `size` numbers of each, on the device in the
// order `element_of`, member after member, in a State in the order of the elements. Appends to
// `all`, and takes from its front; empty stands for zeros.
template <int size, class T>
void save_kept(const DeviceArray<T>& kept, std::span<const int> element_of,
               std::vector<double>& all, std::size_t member = 0) {
  const std::size_t count = element_of.size() * size;
  const std::vector<T> here = kept.download(member * count, count);
  const std::size_t begin = all.size();
  all.resize(begin + count);
  for (std::size_t at = 0; at < count; ++at) {
    all[begin + static_cast<std::size_t>(element_of[at / size]) * size + at % size] = here[at];
  }
}
template <int size, class T>
void load_kept(DeviceArray<T>& kept, std::span<const int> element_of, std::span<const double>& all,
               std::size_t member = 0) {
  std::vector<T> here(element_of.size() * size);
  if (!all.empty()) {
    for (std::size_t at = 0; at < here.size(); ++at) {
      here[at] =
          static_cast<T>(all[static_cast<std::size_t>(element_of[at / size]) * size + at % size]);
    }
    all = all.subspan(here.size());
  }
  kept.upload(here, member * here.size());
}

}  // namespace viscera::sim
