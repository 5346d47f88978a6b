// The gmsh library for as long as one piece of work lasts. It is a single global model: sessions do
// not nest, and threads wait for one another. Silent, one thread, no configuration files of the
// user, so that equal input gives equal output.
#pragma once

#include <functional>
#include <string>

namespace viscera {

// Runs `work` inside a session. What gmsh throws (texts, numbers, exceptions) becomes a
// std::runtime_error of its last error message; an Error of viscera passes through.
void with_gmsh(const std::function<void()>& work);

std::string gmsh_version();

constexpr int gmsh_triangle = 2, gmsh_tet = 4;  // element types of the MSH format

}  // namespace viscera
