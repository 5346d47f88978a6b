// What files for other finite element programs share: a buffer to write into, names that they take,
// and the way from SI to mm, N, t, s.
#pragma once

#include <fmt/format.h>

#include <map>
#include <set>
#include <string>
#include <vector>

#include "pipeline/base/param.hpp"

namespace viscera::export_text {

constexpr double mm_per_m = 1e3;
constexpr double mpa_per_pa = 1e-6;        // 1 MPa = 1 N/mm2
constexpr double t_mm3_per_kg_m3 = 1e-12;  // 1 t/mm3

using Buffer = fmt::memory_buffer;

template <class... Args>
void put(Buffer& text, fmt::format_string<Args...> format, Args&&... args) {
  fmt::format_to(std::back_inserter(text), format, std::forward<Args>(args)...);
}

// Letters, digits and underscores, a letter first, at most 60 of them, and different for every id
// whatever the case of the letters: what the strictest format takes for a name.
std::map<int, std::string> identifiers(const std::map<int, std::string>& names);

// The names in a list of formats. Throws Error(bad_config) for one that is not known.
std::set<std::string> names_of_formats(const Json& asked, const std::vector<std::string>& known);

// Those of a table of formats, which have names, that are in a list.
template <class Format>
std::vector<Format> asked_formats(const Json& asked, const std::vector<Format>& table) {
  std::vector<std::string> known;
  for (const Format& format : table) known.push_back(format.name);
  const std::set<std::string> names = names_of_formats(asked, known);
  std::vector<Format> formats;
  for (const Format& format : table)
    if (names.count(format.name)) formats.push_back(format);
  return formats;
}

// The number of a tet's face in Abaqus and CalculiX, by the corner that it lacks: 1-2-3, 1-4-2,
// 2-4-3 and 3-4-1 are the faces 1 to 4.
constexpr int face_without[4] = {3, 4, 2, 1};

}  // namespace viscera::export_text
