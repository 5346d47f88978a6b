#include "pipeline/engine/run/devices.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <thread>

namespace viscera::engine {
namespace {

// Those that somebody (a batch system) has given us, else all that the driver has.
std::vector<std::string> device_names() {
  std::vector<std::string> names;
  if (const char* given = std::getenv("CUDA_VISIBLE_DEVICES")) {
    std::istringstream list(given);
    for (std::string name; std::getline(list, name, ',');) names.push_back(name);
    return names;
  }
  while (std::filesystem::exists(fmt::format("/dev/nvidia{}", names.size()))) {
    names.push_back(std::to_string(names.size()));
  }
  return names;
}

}  // namespace

Devices::Devices(std::optional<std::size_t> gpus)
    : names_(device_names()),
      count_(gpus.value_or(names_.size())),
      unlimited_(!gpus && names_.empty()) {}

std::optional<std::size_t> Devices::free_one(const std::vector<std::size_t>& busy) const {
  if (unlimited_) return 0;
  for (std::size_t gpu = 0; gpu < count_; ++gpu) {
    if (!std::ranges::count(busy, gpu)) return gpu;
  }
  return std::nullopt;
}

std::vector<std::string> Devices::environment(std::size_t gpu) const {
  if (names_.size() < 2) return {};
  return {"CUDA_VISIBLE_DEVICES=" + names_[gpu % names_.size()]};
}

unsigned Devices::threads_each(std::size_t jobs, unsigned asked) {
  if (asked > 0 || jobs == 1) return asked;
  return std::max(1u, std::thread::hardware_concurrency() / static_cast<unsigned>(jobs));
}

}  // namespace viscera::engine
