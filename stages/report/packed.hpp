// Arrays as they stand in the page: zlib's deflate, which browsers inflate by themselves.
#pragma once

#include <string>

namespace viscera {

std::string deflated(const std::string& bytes);

}  // namespace viscera
