// A source without what only looks like code: every byte keeps its place.
#pragma once

#include <string>

namespace viscera::mutate {

struct Masked {
  std::string bare;  // comments are spaces, lines of the preprocessor are '#'
  std::string code;  // the same, and what strings and characters hold is 'q'
};

/// Code between #if with CUDA in it and its #else or #endif counts as the preprocessor's.
Masked mask(const std::string& text);

}  // namespace viscera::mutate
