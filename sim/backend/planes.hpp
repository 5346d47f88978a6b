// Constant data of elements in planes: of every element 16 bytes side by side, plane after plane.
// Lanes that load an element each, one after the other, then read whole lines of a cache, and
// planes in which two models do not differ are kept once.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "sim/base/math.hpp"

namespace viscera::sim {

struct alignas(16) Piece {
  std::uint32_t words[4];
  bool operator==(const Piece&) const = default;
};

// sizeof(Item) is a multiple of sizeof(Piece), and its bytes are all there is to it.
template <class Item>
struct PlanesView {
  static constexpr int count = sizeof(Item) / sizeof(Piece);
  const Piece* planes[count];

  // From the piece that `load` brings of each plane.
  template <class Load>
  SIM_HD Item assembled(Load&& load) const {
    std::array<Piece, count> pieces;
    for (int p = 0; p < count; ++p) pieces[p] = load(planes[p]);
    return std::bit_cast<Item>(pieces);
  }
  SIM_HD Item operator[](int e) const {
    return assembled([e](const Piece* plane) { return plane[e]; });
  }
  SIM_HD PlanesView from(int first) const {
    PlanesView later;
    for (int p = 0; p < count; ++p) later.planes[p] = planes[p] + first;
    return later;
  }
};

template <class Item>
using Planes = std::array<std::vector<Piece>, PlanesView<Item>::count>;

template <class Item>
Planes<Item> planes_of(const std::vector<Item>& items) {
  Planes<Item> planes;
  for (const Item& item : items) {
    const auto pieces = std::bit_cast<std::array<Piece, PlanesView<Item>::count>>(item);
    for (std::size_t p = 0; p < planes.size(); ++p) planes[p].push_back(pieces[p]);
  }
  return planes;
}

}  // namespace viscera::sim
