// make-fuzz-seeds FOLDER: writes small whole files that the fuzzers of meshes, trajectories and
// replayed input begin with, into a folder for each.
#include <exception>
#include <filesystem>
#include <iostream>

#include "pipeline/base/atomic_file.hpp"
#include "stages/mesh/landmark_io.hpp"
#include "stages/mesh/surface_io.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/tetmesh/exchange/export.hpp"
#include "stages/trajectory/trajectory_io.hpp"

namespace {

namespace fs = std::filesystem;
using namespace viscera;

// Two tets that share a face, of two materials.
TetMesh two_tets() {
  return {.points = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}, {0, 0, 10}, {10, 10, 10}},
          .tets = {{0, 1, 2, 3}, {1, 4, 2, 3}},
          .labels = {1, 7},
          .label_names = {{1, "liver"}, {7, "tumour"}},
          .cell_data = {{"quality", {0.25f, 1.0f}}}};
}

constexpr const char* ascii_vtu = R"(<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>
<FieldData><DataArray type="Int32" Name="label_ids" NumberOfTuples="1" format="ascii">4</DataArray>
<Array type="String" Name="label_names" NumberOfTuples="1" format="ascii">108 0</Array></FieldData>
<Piece NumberOfPoints="5" NumberOfCells="3"><Points>
<DataArray type="Float64" NumberOfComponents="3" format="ascii">
0 0 0 1 0 0 0 1 0 0 0 1 1 1 1</DataArray></Points><Cells>
<DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 0 1 2 3 1 2 4 3</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">3 7 11</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">5 10 10</DataArray></Cells>
<CellData><DataArray type="Int64" Name="label" format="ascii">9 4 7</DataArray></CellData>
</Piece></UnstructuredGrid></VTKFile>
)";

constexpr const char* ascii_vtp = R"(<?xml version="1.0"?>
<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian"><PolyData>
<FieldData><DataArray type="Int32" Name="label_ids" NumberOfTuples="1" format="ascii">4</DataArray>
<Array type="String" Name="label_names" NumberOfTuples="1" format="ascii">108 0</Array></FieldData>
<Piece NumberOfPoints="4" NumberOfPolys="4"><Points>
<DataArray type="Float32" NumberOfComponents="3" format="ascii">0 0 0 1 0 0 0 1 0 0 0 1</DataArray>
</Points><Polys>
<DataArray type="Int32" Name="connectivity" format="ascii">0 2 1 0 1 3 1 2 3 0 3 2</DataArray>
<DataArray type="Int32" Name="offsets" format="ascii">3 6 9 12</DataArray></Polys>
<CellData><DataArray type="Float64" Name="label" format="ascii">4 4 4 4</DataArray></CellData>
</Piece></PolyData></VTKFile>
)";

constexpr const char* msh_2 = R"($MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
3 4 "liver"
$EndPhysicalNames
$Nodes
5
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
5 1 1 1
$EndNodes
$Elements
3
1 2 2 9 1 1 2 3
2 4 2 4 1 1 2 3 4
3 4 2 7 2 2 5 3 4
$EndElements
)";

constexpr const char* msh_1 =
    "$NOD\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$ENDNOD\n"
    "$ELM\n1\n1 4 1 1 4 1 2 3 4\n$ENDELM\n";

constexpr const char* input_log = R"({"frame":0,"grab":3}
{"frame":1,"drag":[0,5,12.5]}
{"frame":2,"release":true}
{"frame":2,"tool":[10,-90,180]}
{"frame":3,"tool":[10,-80,150]}
{"frame":4,"lift":true}
{"frame":4,"change":{"materials.liver.E":"7 kPa","effects.ground.friction":0.1}}
{"frame":5,"change":{"materials.liver.nu":0.3,"effects.gravity":"off"}}
{"frame":6,"drop":true}
{"frame":7,"reset":true}
)";

void write_seeds(const fs::path& folder) {
  for (const char* format : {"vtu", "vtp", "msh", "trajectory_bytes", "replay", "landmarks"})
    fs::create_directories(folder / format);
  const TetMesh mesh = two_tets();
  write_vtu(folder / "vtu/packed.vtu", mesh);
  write_atomically(folder / "vtu/ascii.vtu", ascii_vtu);
  write_vtp(folder / "vtp/packed.vtp", {.points = mesh.points,
                                        .triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}},
                                        .labels = {1, 1, 1, 1},
                                        .label_names = {{1, "liver"}}});
  write_atomically(folder / "vtp/ascii.vtp", ascii_vtp);
  write_msh(folder / "msh/binary.msh", prepare_export(mesh, {}));
  write_atomically(folder / "msh/version_2.msh", msh_2);
  write_atomically(folder / "msh/version_1.msh", msh_1);
  write_atomically(folder / "replay/hand.jsonl", input_log);
  const std::vector<Landmark> landmarks = {{"tip", {1, -2, 3}}, {"F-1", {4.5, 5, -6}}};
  write_atomically(folder / "landmarks/a.csv", landmarks_as_table(landmarks));
  write_atomically(folder / "landmarks/a.mrk.json", landmarks_as_markups(landmarks));
  write_atomically(folder / "landmarks/a.annot", landmarks_as_annotations(landmarks));
  write_atomically(folder / "landmarks/a.fcsv",
                   "# CoordinateSystem = RAS\n# columns = id,x,y,z,label\n1,2,3,4,tip\n");
  TrajectoryWriter writer(folder / "trajectory_bytes", mesh);
  const std::vector<float> rest(3 * mesh.points.size(), 1.0f);
  for (const double time : {0.0, 0.04}) writer.append(time, rest);
  writer.finish();
  fs::remove(folder / "trajectory_bytes/trajectory.xdmf");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2 || argv[1][0] == '-') {
    std::cerr << "usage: make-fuzz-seeds FOLDER\n";
    return 2;
  }
  try {
    write_seeds(argv[1]);
  } catch (const std::exception& e) {
    std::cerr << "make-fuzz-seeds: " << e.what() << "\n";
    return 1;
  }
  return 0;
}
