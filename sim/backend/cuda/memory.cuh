// Device memory and the check of every CUDA call.
#pragma once

#include <cuda_runtime.h>

#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "sim/base/refusal.hpp"

namespace viscera::sim {

inline void check(cudaError_t status, const char* doing) {
  if (status == cudaSuccess) return;
  cudaGetLastError();  // told here, and not once more to whoever asks next on this thread
  throw Refusal(Refusal::Cause::device, "cuda",
                std::string(doing) + ": " + cudaGetErrorString(status), "a working CUDA device",
                "use device: cpu, or mend the driver");
}

inline int current_device() {
  int device = 0;
  check(cudaGetDevice(&device), "asking for the device");
  return device;
}

inline int device_attribute(cudaDeviceAttr which) {
  int value = 0;
  check(cudaDeviceGetAttribute(&value, which, current_device()), "asking what the device has");
  return value;
}

// work() with another device; the calling thread then goes on with its own.
inline void on_device(int device, const std::function<void()>& work) {
  struct Back {
    int device = current_device();
    ~Back() { cudaSetDevice(device); }
  } back;
  check(cudaSetDevice(device), "going on with another device");
  work();
}

// A solver's own order of things: solvers of several threads do not wait for one another.
class Stream {
 public:
  Stream() {
    check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "creating a stream");
  }
  Stream(const Stream&) = delete;
  ~Stream() { cudaStreamDestroy(stream_); }
  operator cudaStream_t() const { return stream_; }
  void finish(const char* doing) const { check(cudaStreamSynchronize(stream_), doing); }

 private:
  cudaStream_t stream_ = nullptr;
};

// What is enqueued once and launched again and again.
class Graph {
 public:
  Graph() = default;
  template <class Enqueue>
  Graph(cudaStream_t stream, Enqueue&& enqueue) : Graph() {
    check(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal), "capturing a graph");
    enqueue();
    check(cudaStreamEndCapture(stream, &graph_), "capturing a graph");
    check(cudaGraphInstantiate(&executable_, graph_, 0), "preparing a graph");
    std::size_t count = 0;
    check(cudaGraphGetNodes(graph_, nullptr, &count), "looking at a graph");
    nodes_.resize(count);
    check(cudaGraphGetNodes(graph_, nodes_.data(), &count), "looking at a graph");
  }
  Graph(Graph&& other) noexcept { *this = std::move(other); }
  Graph& operator=(Graph&& other) noexcept {
    std::swap(graph_, other.graph_);
    std::swap(executable_, other.executable_);
    std::swap(nodes_, other.nodes_);
    return *this;
  }
  ~Graph() {
    if (executable_) cudaGraphExecDestroy(executable_);
    if (graph_) cudaGraphDestroy(graph_);
  }

  std::size_t size() const { return nodes_.size(); }
  // Where all nodes are kernels of one argument: change(argument) from what it was when captured to
  // what it is from the next launch on.
  template <class Argument, class Change>
  void change_argument(Change&& change) {
    for (const cudaGraphNode_t node : nodes_) {
      cudaKernelNodeParams kernel{};
      check(cudaGraphKernelNodeGetParams(node, &kernel), "looking at a kernel");
      Argument argument = *static_cast<const Argument*>(kernel.kernelParams[0]);
      change(argument);
      void* arguments[] = {&argument};
      kernel.kernelParams = arguments;
      check(cudaGraphExecKernelNodeSetParams(executable_, node, &kernel), "changing an argument");
    }
  }
  void launch(cudaStream_t stream, const char* doing) const {
    check(cudaGraphLaunch(executable_, stream), doing);
  }

 private:
  cudaGraph_t graph_ = nullptr;
  cudaGraphExec_t executable_ = nullptr;
  std::vector<cudaGraphNode_t> nodes_;
};

// Device memory that is freed with its owner. What it does is done when it returns, for every
// stream.
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
    check(cudaStreamSynchronize(nullptr), "uploading");
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
    if (count == 0) return;
    check(cudaMemset(data_ + first, 0, count * sizeof(T)), "clearing");
    check(cudaStreamSynchronize(nullptr), "clearing");
  }
  // When the stream comes to it.
  void copy_to(const DeviceArray& other, cudaStream_t stream) const {
    copy_to(other, 0, size_, stream);
  }
  void copy_to(const DeviceArray& other, std::size_t first, std::size_t count,
               cudaStream_t stream) const {
    if (count == 0) return;
    check(cudaMemcpyAsync(other.data_ + first, data_ + first, count * sizeof(T),
                          cudaMemcpyDeviceToDevice, stream),
          "copying");
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
