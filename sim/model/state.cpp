#include "sim/model/state.hpp"

#include <bit>

namespace viscera::sim {

bool State::finite() const {
  for (const auto* field : {&u, &v}) {
    for (const auto& a : *field) {
      if (!(std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z))) return false;
    }
  }
  return true;
}

std::uint64_t State::hash() const {
  std::uint64_t h = 0xcbf29ce484222325ull;
  const auto add = [&h](double value) {
    h = (h ^ std::bit_cast<std::uint64_t>(value)) * 0x100000001b3ull;
    h ^= h >> 32;
  };
  for (const auto* field : {&u, &v}) {
    for (const auto& a : *field) {
      add(a.x);
      add(a.y);
      add(a.z);
    }
  }
  return h;
}

}  // namespace viscera::sim
