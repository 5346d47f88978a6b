#include "stages/program/param_values.hpp"

#include <algorithm>
#include <cctype>

#include "pipeline/contract/label_name.hpp"

namespace viscera {

std::array<double, 3> read_place(const Json& given, const std::string& field) {
  if (!given.is_array() || given.size() != 3) {
    throw Error(ExitCode::bad_config, {.where = "parameters",
                                       .field = field,
                                       .found = given.is_null() ? "nothing" : given.dump(),
                                       .allowed = "three coordinates, as [0 mm, -40 mm, 870 mm]"});
  }
  const Param coordinate = quantity("", nullptr, "mm", -1e6, 1e6, "");
  std::array<double, 3> place{};
  for (std::size_t axis = 0; axis < 3; ++axis)
    place[axis] = resolve_required(coordinate, given[axis], "parameters", field).get<double>();
  return place;
}

void check_plain_name(const std::string& name, const std::string& field, const std::string& what) {
  const auto is_plain = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '-' || c == '.';
  };
  if (!name.empty() && name.size() <= max_label_name && std::ranges::all_of(name, is_plain)) return;
  throw Error(ExitCode::bad_config, {.where = "parameters",
                                     .field = field,
                                     .found = "a " + what + " named '" + name + "'",
                                     .allowed = "letters, digits, _ - and ., at most 100"});
}

}  // namespace viscera
