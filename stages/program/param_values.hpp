// Values of parameters that are more than a number or a word.
#pragma once

#include <array>
#include <string>

#include "pipeline/base/param.hpp"

namespace viscera {

// Three coordinates with their units, in mm. Throws Error(bad_config) in the name of `field`.
std::array<double, 3> read_place(const Json& given, const std::string& field);

// For names that become those of arrays and columns: letters, digits, _ - and ., at most
// max_label_name. Throws Error(bad_config) in the name of `field`, whose maps have `what` as keys.
void check_plain_name(const std::string& name, const std::string& field, const std::string& what);

}  // namespace viscera
