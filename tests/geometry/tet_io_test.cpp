#include "stages/mesh/tet_io.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

TetMesh two_tets() {
  TetMesh mesh;
  mesh.points = {{0, 0, 0}, {1.5, 0, 0}, {0, 2.25, 0}, {0, 0, 1e-3}, {4, 4, 4}};
  mesh.tets = {{0, 1, 2, 3}, {1, 2, 3, 4}};
  mesh.labels = {1, 7};
  mesh.label_names = {{1, "liver"}, {7, "tumour, left"}};
  mesh.cell_data = {{"quality", {0.25f, 1.0f}}};
  return mesh;
}

std::string refusal(const fs::path& path) {
  try {
    read_vtu(path);
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::bad_input);
    return e.what();
  }
  ADD_FAILURE() << path << " was accepted";
  return "";
}

TEST(TetIo, AMeshComesBackAsItWasWritten) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const TetMesh mesh = two_tets();
  write_vtu(folder.path() / "mesh.vtu", mesh);
  const TetMesh back = read_vtu(folder.path() / "mesh.vtu");
  EXPECT_EQ(back.points, mesh.points);
  EXPECT_EQ(back.tets, mesh.tets);
  EXPECT_EQ(back.labels, mesh.labels);
  EXPECT_EQ(back.label_names, mesh.label_names);
  EXPECT_EQ(back.cell_data, mesh.cell_data);
}

TEST(TetIo, NamesOfAnyLettersStayWhatTheyAreAndOthersAreRefused) {
  const TemporaryFolder folder(fs::temp_directory_path());
  TetMesh mesh = two_tets();
  mesh.label_names = {{1, R"(a\b "c" 'd' <e> & \n)"}, {7, "tumör 肝"}};
  write_vtu(folder.path() / "mesh.vtu", mesh);
  EXPECT_EQ(read_vtu(folder.path() / "mesh.vtu").label_names, mesh.label_names);
  for (const char* name : {"two\nlines", "L\xe4sion", ""}) {
    mesh.label_names[7] = name;
    write_vtu(folder.path() / "mesh.vtu", mesh);
    const std::string said = refusal(folder.path() / "mesh.vtu");
    EXPECT_NE(said.find("mesh.vtu: FieldData/label_names: a"), std::string::npos) << said;
  }
}

TEST(TetIo, TheSameMeshGivesTheSameBytes) {
  const TemporaryFolder folder(fs::temp_directory_path());
  write_vtu(folder.path() / "a.vtu", two_tets());
  write_vtu(folder.path() / "b.vtu", two_tets());
  EXPECT_EQ(read_file(folder.path() / "a.vtu"), read_file(folder.path() / "b.vtu"));
}

TEST(TetIo, NegativeTetsAreTurnedAndFlatOnesRefusedWithTheirCount) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const fs::path path = folder.path() / "mesh.vtu";
  TetMesh mesh = two_tets();
  std::swap(mesh.tets[0][0], mesh.tets[0][1]);
  write_vtu(path, mesh);
  EXPECT_EQ(read_vtu(path).tets[0], (std::array<int, 4>{1, 0, 3, 2}));
  mesh.points[3] = {1, 1, 0};
  write_vtu(path, mesh);
  EXPECT_NE(refusal(path).find("1 tets without volume"), std::string::npos) << refusal(path);
}

TEST(TetIo, BrokenFilesAreRefusedByName) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const fs::path path = folder.path() / "mesh.vtu";
  EXPECT_NE(refusal(path).find("mesh.vtu"), std::string::npos);
  write_atomically(path, "not a mesh at all");
  EXPECT_NE(refusal(path).find("mesh.vtu"), std::string::npos);
  write_vtu(path, two_tets());
  const std::string whole = read_file(path);
  write_atomically(path, whole.substr(0, whole.size() * 3 / 4));
  EXPECT_NE(refusal(path).find("Error parsing"), std::string::npos) << refusal(path);
  TetMesh mesh = two_tets();
  mesh.points[2][1] = std::numeric_limits<double>::quiet_NaN();
  write_vtu(path, mesh);
  EXPECT_NE(refusal(path).find("point 2 is not finite"), std::string::npos) << refusal(path);
}

// One tet in the words of the format, with what is written of its counts and of its label.
std::string one_tet(const std::string& points, const std::string& cells, const std::string& label) {
  return "<?xml version=\"1.0\"?>\n"
         "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">"
         "<UnstructuredGrid><Piece NumberOfPoints=\"" +
         points + "\" NumberOfCells=\"" + cells +
         "\">"
         "<Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">"
         "0 0 0 10 0 0 0 10 0 0 0 10</DataArray></Points>"
         "<Cells><DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 1 2 "
         "3</DataArray>"
         "<DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">4</DataArray>"
         "<DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">10</DataArray></Cells>"
         "<CellData><DataArray type=\"Float64\" Name=\"label\" format=\"ascii\">" +
         label + "</DataArray></CellData></Piece></UnstructuredGrid></VTKFile>\n";
}

// The reader of VTK 9.1 itself crashes on some of these, or takes memory until there is none.
TEST(TetIo, CountsThatTheArraysDoNotFillAndLabelsThatAreNoNumbersAreRefused) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const fs::path path = folder.path() / "mesh.vtu";
  write_atomically(path, one_tet("4", "1", "3"));
  EXPECT_EQ(read_vtu(path).labels, std::vector<int>{3});
  const struct {
    const char *points, *cells, *label;
  } broken[] = {{"4", "1", "nan"},         {"4", "1", ""},           {"4", "100", "3"},
                {"5", "1", "3"},           {"1073741824", "1", "3"}, {"4", "1073741824", "3"},
                {"99999999999", "1", "3"}, {"4", "99999999999", "3"}};
  for (const auto& [points, cells, label] : broken) {
    write_atomically(path, one_tet(points, cells, label));
    EXPECT_NE(refusal(path).find("mesh.vtu"), std::string::npos) << points << ' ' << cells;
  }
}

TEST(TetIo, ACellOfATypeThatThereIsNotIsRefusedAlsoInAMeshMadeElsewhere) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const fs::path path = folder.path() / "mesh.vtu";
  std::string text = one_tet("4", "1", "3");
  text.replace(text.find(">10<"), 4, ">255<");
  write_atomically(path, text);
  EXPECT_NE(refusal(path).find("VTK type 255"), std::string::npos);
  EXPECT_THROW(read_foreign_vtu(path), Error);
}

// A mesh without points: what such cells are is looked up before what they name is.
TEST(TetIo, CellsWithoutVolumeThatNamePointsThatAreNotThereDoNotCrashAMeshMadeElsewhere) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const fs::path path = folder.path() / "mesh.vtu";
  std::string text = one_tet("0", "1", "3");
  const auto put = [&](const std::string& old, const std::string& replacement) {
    text.replace(text.find(old), old.size(), replacement);
  };
  put(">0 1 2 3<", ">0 1 2<");
  put(">4<", ">3<");
  put(">10<", ">5<");  // a triangle
  write_atomically(path, text);
  EXPECT_THROW(read_foreign_vtu(path), Error);
}

TEST(TetIo, ATetrahedronOfAnotherNumberOfPointsIsRefused) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const fs::path path = folder.path() / "mesh.vtu";
  for (const auto& [ids, count] : {std::pair{"0 1 2", "3"}, {"0 1 2 3 0", "5"}}) {
    std::string text = one_tet("4", "1", "3");
    const auto put = [&](const std::string& old, const std::string& replacement) {
      text.replace(text.find(old), old.size(), replacement);
    };
    put(">0 1 2 3<", std::string(">") + ids + "<");
    put(">4<", std::string(">") + count + "<");
    write_atomically(path, text);
    const std::string said = refusal(path);
    EXPECT_NE(said.find(std::string("cell 0 has ") + count + " points"), std::string::npos) << said;
  }
}

}  // namespace
}  // namespace viscera
