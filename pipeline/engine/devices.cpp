#include "pipeline/engine/devices.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <thread>

namespace viscera {
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

Devices::Devices(std::optional<std::size_t> gpus) : names_(device_names()) {
  unlimited_ = !gpus && names_.empty();
  busy_.assign(gpus.value_or(names_.size()), false);
}

bool Devices::one_is_free() const {
  return unlimited_ || std::ranges::count(busy_, false) > 0;
}

std::size_t Devices::take() {
  const auto free = static_cast<std::size_t>(std::ranges::find(busy_, false) - busy_.begin());
  if (free < busy_.size()) busy_[free] = true;
  return free;
}

void Devices::give_back(std::size_t gpu) {
  if (gpu < busy_.size()) busy_[gpu] = false;
}

std::vector<std::string> Devices::environment(std::optional<std::size_t> gpu) const {
  if (!gpu || names_.size() < 2) return {};
  return {"CUDA_VISIBLE_DEVICES=" + names_[*gpu % names_.size()]};
}

unsigned Devices::threads_each(std::size_t jobs, unsigned asked) {
  if (asked > 0 || jobs == 1) return asked;
  return std::max(1u, std::thread::hardware_concurrency() / static_cast<unsigned>(jobs));
}

}  // namespace viscera
