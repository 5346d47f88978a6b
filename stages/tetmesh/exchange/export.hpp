// The mesh for other programs: one table of formats, each with its writer in a file of its own, and
// what all of them are given: names, boundary patches, materials. Coordinates in LPS mm.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "pipeline/base/param.hpp"
#include "stages/mesh/material_params.hpp"
#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

// The triangles between two labels, or between one and the outside.
struct Patch {
  struct Facet {
    int tet, opposite;           // the tet of label `inside`, and the corner that the facet lacks
    std::array<int, 3> corners;  // counter-clockwise seen from label `outside`
  };
  std::string name;             // "surface_liver", "interface_liver_tumour"
  int inside = 0, outside = 0;  // labels; outside is 0 on the body's boundary, else the larger one
  std::vector<Facet> facets;    // in the order of their corners
};

std::vector<Patch> find_patches(const TetMesh& mesh);

struct TetExport {
  const TetMesh& mesh;
  std::map<int, std::string> names;  // of the labels that have tets
  std::vector<Patch> patches;
  std::map<int, Elastic> materials;  // of the labels for which they were given

  std::vector<int> tets_of(int label) const;
};

// Keeps a reference to the mesh.
TetExport prepare_export(const TetMesh& mesh, std::map<int, Elastic> materials);

struct TetFormat {
  const char* name;
  const char* file;
  const char* doc;
  void (*write)(const std::filesystem::path&, const TetExport&);
};

const std::vector<TetFormat>& tet_formats();

// The formats that the param `formats` asks for; vtu is always among them. Throws Error(bad_config)
// for an unknown one.
std::vector<TetFormat> chosen_formats(const Json& formats);

// {label name: {E, nu, density}} for labels of this mesh. Throws Error(bad_config) for a name that
// the mesh does not have and for bad quantities.
std::map<int, Elastic> read_materials(const Json& given, const std::map<int, std::string>& names);

// Into the current gmsh session: the patches as discrete surfaces 1, 2, ... with their nodes, whose
// tags are the points' numbers plus 1.
void add_surfaces(const TetExport& body);

void write_msh(const std::filesystem::path& path, const TetExport& body);
void write_inp(const std::filesystem::path& path, const TetExport& body);
void write_feb(const std::filesystem::path& path, const TetExport& body);

}  // namespace viscera
