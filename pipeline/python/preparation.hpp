// The stages before a simulation in the memory of another program: labels, surface and tets without
// files, with the bits of viscera-labels, viscera-surface and viscera-tetmesh.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "pipeline/python/named_mesh.hpp"
#include "stages/image/label_image.hpp"
#include "stages/mesh/surface_mesh.hpp"

namespace viscera::python {

struct Labels {
  LabelImage image;
  Said said;
};

struct Surface {
  SurfaceMesh mesh;
  Said said;
};

// All take the params of their stage by name and throw Error as it does.

Labels read_labels(const std::vector<std::filesystem::path>& sources, const Json& params);
// Of a volume that errors call "array": throws Error(bad_input) too for sizes, spacings and axes
// that are refused in files.
Labels labels_of(LabelImage volume, const Json& params);

Surface surface_of(const Labels& labels, const Json& params);

// Of both, or of one where the other is null; cells of the sizes that `size_field` has in its array
// (relative_size), where there is one. Refuses params of files and processes.
NamedMesh mesh_of(const Labels* labels, const Surface* surface, const NamedMesh* size_field,
                  const Json& params);

// Throws Error(bad_input) for triangles of vertices that there are not, and places that are not
// finite.
void check_surface(const SurfaceMesh& surface);

}  // namespace viscera::python
