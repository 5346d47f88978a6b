#include "pipeline/base/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <numeric>

namespace viscera {
namespace {

std::string message(const Problem& p) {
  std::string text = p.where;
  for (const auto* part : {&p.field, &p.found}) {
    if (!part->empty()) text += (text.empty() ? "" : ": ") + *part;
  }
  if (!p.allowed.empty()) text += "\n  allowed: " + p.allowed;
  if (!p.remedy.empty()) text += "\n  remedy:  " + p.remedy;
  return text;
}

// Levenshtein distance, two rows.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t substituted = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, substituted});
    }
  }
  return row.back();
}

}  // namespace

Error::Error(ExitCode code, Problem problem)
    : std::runtime_error(message(problem)), code_(code), problem_(std::move(problem)) {}

std::string nearest(std::string_view name, const std::vector<std::string>& candidates) {
  std::string best;
  std::size_t best_distance = std::max<std::size_t>(2, name.size() / 3) + 1;
  for (const auto& candidate : candidates) {
    const auto distance = edit_distance(name, candidate);
    if (distance < best_distance) {
      best_distance = distance;
      best = candidate;
    }
  }
  return best;
}

std::string suggest(std::string_view name, const std::vector<std::string>& candidates) {
  const auto near = nearest(name, candidates);
  if (!near.empty()) return fmt::format("did you mean '{}'?", near);
  return fmt::format("use one of: {}", fmt::join(candidates, ", "));
}

}  // namespace viscera
