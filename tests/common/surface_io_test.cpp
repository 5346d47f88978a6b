// surface.vtp of others: what is no label is refused before it becomes an integer.
#include "stages/mesh/surface_io.hpp"

#include <gtest/gtest.h>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"

namespace viscera {
namespace {

// A tetrahedron's surface, with what is written of its labels and of the number of their name.
std::string tetrahedron(const std::string& label, const std::string& id) {
  return R"(<?xml version="1.0"?>
<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian"><PolyData><FieldData>
<DataArray type="Float64" Name="label_ids" NumberOfTuples="1" format="ascii">)" +
         id + R"(</DataArray>
<Array type="String" Name="label_names" NumberOfTuples="1" format="ascii">108 0</Array></FieldData>
<Piece NumberOfPoints="4" NumberOfPolys="4"><Points>
<DataArray type="Float32" NumberOfComponents="3" format="ascii">0 0 0 1 0 0 0 1 0 0 0 1</DataArray>
</Points><Polys>
<DataArray type="Int32" Name="connectivity" format="ascii">0 2 1 0 1 3 1 2 3 0 3 2</DataArray>
<DataArray type="Int32" Name="offsets" format="ascii">3 6 9 12</DataArray></Polys>
<CellData><DataArray type="Float64" Name="label" format="ascii">4 4 4 )" +
         label + "</DataArray></CellData></Piece></PolyData></VTKFile>\n";
}

TEST(SurfaceIo, LabelsAndTheirNumbersAreWholeNumbersThatFit) {
  const TemporaryFolder folder(std::filesystem::temp_directory_path());
  const auto path = folder.path() / "surface.vtp";
  const auto refused_field = [&](const std::string& label, const std::string& id) -> std::string {
    write_atomically(path, tetrahedron(label, id));
    try {
      read_vtp(path);
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::bad_input);
      return e.problem().field;
    }
    return "accepted";
  };
  EXPECT_EQ(refused_field("4", "4"), "accepted");
  for (const char* value : {"-1", "4.5", "65536", "1e39"}) {
    EXPECT_EQ(refused_field(value, "4"), "CellData/label") << value;
    EXPECT_EQ(refused_field("4", value), "FieldData/label_ids") << value;
  }
}

}  // namespace
}  // namespace viscera
