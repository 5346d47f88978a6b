// What a body is made of: tets with a strain of their own, tets whose strain is averaged around
// edges (edge_domains.hpp), or tets of ten nodes.
#pragma once

namespace viscera::sim {

enum class Element { linear, smoothed, quadratic };

}  // namespace viscera::sim
