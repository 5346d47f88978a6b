#include "sim/partition.hpp"

#include <algorithm>
#include <numeric>

namespace viscera::sim {
namespace {

// Every third bit of a number below 2^21.
std::uint64_t spread(std::uint64_t a) {
  a = (a | a << 32) & 0x1f00000000ffffull;
  a = (a | a << 16) & 0x1f0000ff0000ffull;
  a = (a | a << 8) & 0x100f00f00f00f00full;
  a = (a | a << 4) & 0x10c30c30c30c30c3ull;
  return (a | a << 2) & 0x1249249249249249ull;
}

}  // namespace

Blocks::Blocks(const Model& model, int tets_per_block) : model_(model), low_(model.rest.front()) {
  for (const auto& p : model.rest) {
    low_ = {std::min(low_.x, p.x), std::min(low_.y, p.y), std::min(low_.z, p.z)};
  }
  scale_ = ((1 << 21) - 1) / model.size();
  std::vector<std::uint64_t> codes;
  for (const auto& tet : model.tets) codes.push_back(code_of(tet));
  std::ranges::sort(codes);
  for (std::size_t t = 0; t < codes.size(); t += tets_per_block) first_code_.push_back(codes[t]);
}

std::uint64_t Blocks::code_of(std::span<const int> vertices) const {
  Vec3<double> sum;
  for (const int v : vertices) sum += model_.rest[v] - low_;
  const double cells = scale_ / static_cast<double>(vertices.size());
  const auto cell = [cells](double x) { return spread(static_cast<std::uint64_t>(cells * x)); };
  return cell(sum.x) | cell(sum.y) << 1 | cell(sum.z) << 2;
}

int Blocks::block_of(std::span<const int> vertices) const {
  const auto after = std::ranges::upper_bound(first_code_, code_of(vertices));
  return std::max(0, static_cast<int>(after - first_code_.begin()) - 1);
}

void SplitVertices::number_copies() {
  for (std::size_t block = 0; block < touched_.size(); ++block) {
    auto& vertices = touched_[block];
    std::ranges::sort(vertices);
    vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
    vertices.insert(vertices.end(), again_[block].begin(), again_[block].end());
    std::ranges::sort(vertices);
    block_begin_.push_back(static_cast<int>(vertex_of_.size()));
    vertex_of_.insert(vertex_of_.end(), vertices.begin(), vertices.end());
  }
  block_begin_.push_back(static_cast<int>(vertex_of_.size()));
  for (const int v : vertex_of_) ++copies_begin_[v + 1];
  std::partial_sum(copies_begin_.begin(), copies_begin_.end(), copies_begin_.begin());
  copies_.resize(vertex_of_.size());
  auto next = copies_begin_;
  for (std::size_t copy = 0; copy < vertex_of_.size(); ++copy) {
    copies_[next[vertex_of_[copy]]++] = static_cast<int>(copy);
  }
}

int SplitVertices::copy_of(int block, int vertex) const {
  const auto& vertices = touched_[block];
  const auto at = std::ranges::lower_bound(vertices, vertex);
  return block_begin_[block] + static_cast<int>(at - vertices.begin());
}

}  // namespace viscera::sim
