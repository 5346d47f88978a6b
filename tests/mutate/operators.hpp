// The small changes that are made to an expression: what one looks like in the text.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace viscera::mutate {

struct Edit {
  std::string kind;
  std::size_t at, length;  // of what goes, within the expression
  std::string with;        // what comes in its place
};

/// Every change that the patterns find. `masked` holds no comments and no text of strings.
std::vector<Edit> edits_of(std::string_view masked);

}  // namespace viscera::mutate
