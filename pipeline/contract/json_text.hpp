// Reads JSON that a stranger may have written. Nothing else calls the library's parser.
#pragma once

#include <string_view>

#include "pipeline/contract/param.hpp"

namespace viscera {

// What we write ourselves is no deeper than 10; the library's values are copied and destroyed
// recursively, so that 200,000 levels would exhaust the stack.
inline constexpr int max_json_depth = 64;

// The value; a discarded one (`is_discarded`, of no type) for a text that is not JSON or is nested
// deeper than max_json_depth. Never throws.
Json parse_json(std::string_view text);

}  // namespace viscera
