// Quantities as people write them ("5mm", "20 kPa", "9.81 m/s^2") to numbers in a named unit.
// A quantity with a dimension must carry its unit; a bare number is accepted only for unit "1".
#pragma once

#include <string>
#include <string_view>

#include "pipeline/base/error.hpp"

namespace viscera {

// The value of `text` in `unit`. Throws Error(bad_config) naming `where` and `field` when the
// number is not finite or malformed, or the unit is missing, unknown or of another dimension.
double parse_quantity(std::string_view text, std::string_view unit, const std::string& where,
                      const std::string& field);

}  // namespace viscera
