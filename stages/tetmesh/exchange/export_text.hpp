// What the text formats share: a buffer to write into, and the way from SI to mm, N, t, s.
#pragma once

#include <fmt/format.h>

namespace viscera::export_text {

constexpr double mpa_per_pa = 1e-6;        // 1 MPa = 1 N/mm2
constexpr double t_mm3_per_kg_m3 = 1e-12;  // 1 t/mm3

using Buffer = fmt::memory_buffer;

template <class... Args>
void put(Buffer& text, fmt::format_string<Args...> format, Args&&... args) {
  fmt::format_to(std::back_inserter(text), format, std::forward<Args>(args)...);
}

}  // namespace viscera::export_text
