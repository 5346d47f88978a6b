#include "pipeline/contract/json_text.hpp"

#include <algorithm>

namespace viscera {
namespace {

// The most brackets open at once outside of texts.
int depth_of(std::string_view text) {
  int depth = 0, deepest = 0;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '"') quoted = !quoted;
    if (quoted) {
      if (c == '\\') ++i;
      continue;
    }
    if (c == '[' || c == '{') deepest = std::max(deepest, ++depth);
    if (c == ']' || c == '}') --depth;
  }
  return deepest;
}

}  // namespace

Json parse_json(std::string_view text) {
  if (depth_of(text) > max_json_depth) return Json(Json::value_t::discarded);
  return Json::parse(text, nullptr, false);
}

}  // namespace viscera
