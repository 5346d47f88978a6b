// What CalculiX leaves in its file of results (.frd).
#pragma once

#include <array>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>

namespace viscera {

// A field of `n` numbers by node, counted from 0: lines ` -1`, a node in 10 columns and numbers in
// 12 each, after the line that names the field, such as DISP or STRESS. Of several the last.
template <std::size_t n>
std::map<int, std::array<double, n>> calculix_field(const std::filesystem::path& file,
                                                    const char* name) {
  std::map<int, std::array<double, n>> field;
  std::ifstream in(file);
  bool is_wanted = false;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with(" -4")) is_wanted = line.find(name) != std::string::npos;
    if (!is_wanted || !line.starts_with(" -1") || line.size() < 13 + n * 12) continue;
    auto& values = field[std::stoi(line.substr(3, 10)) - 1];
    for (std::size_t k = 0; k < n; ++k) values[k] = std::stod(line.substr(13 + 12 * k, 12));
  }
  return field;
}

}  // namespace viscera
