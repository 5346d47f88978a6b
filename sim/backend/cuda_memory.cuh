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

// What elements keep from one substep to the next: `size` numbers of each, on the device in the
// order `element_of`, in a State in the order of the elements. Appends to `all`, and takes from its
// front; empty stands for zeros.
template <int size, class T>
void save_kept(const DeviceArray<T>& kept, std::span<const int> element_of,
               std::vector<double>& all) {
  const std::vector<T> here = kept.download();
  const std::size_t begin = all.size();
  all.resize(begin + here.size());
  for (std::size_t at = 0; at < here.size(); ++at) {
    all[begin + static_cast<std::size_t>(element_of[at / size]) * size + at % size] = here[at];
  }
}
template <int size, class T>
void load_kept(DeviceArray<T>& kept, std::span<const int> element_of,
               std::span<const double>& all) {
  std::vector<T> here(kept.size());
  if (!all.empty()) {
    for (std::size_t at = 0; at < here.size(); ++at) {
      here[at] =
          static_cast<T>(all[static_cast<std::size_t>(element_of[at / size]) * size + at % size]);
    }
    all = all.subspan(here.size());
  }
  kept.upload(here);
}

}  // namespace viscera::sim
