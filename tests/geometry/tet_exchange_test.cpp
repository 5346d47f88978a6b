// Meshes on their way to and from other programs: what is written comes back, solvers read it, and
// what comes from elsewhere is mended or refused.
#include <gmsh.h>
#include <gtest/gtest.h>
#include <vtkSmartPointer.h>
#include <vtkXMLDataElement.h>
#include <vtkXMLUtilities.h>

#include <cstdlib>
#include <fstream>
#include <set>
#include <sstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "stages/mesh/export_text.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/mesh/tet_topology.hpp"
#include "stages/tetmesh/exchange/export.hpp"
#include "stages/tetmesh/exchange/import.hpp"
#include "stages/tetmesh/quality/distance.hpp"
#include "tests/common/needs.hpp"
#include "tests/geometry/shapes.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;
using Vec = std::array<double, 3>;

// In order of first use, as every mesh of viscera-tetmesh is.
TetMesh two_materials(int n = 4) {
  TetMesh mesh = testing::shaken_cube(n, 0.2, 1);
  mesh.label_names = {{1, "liver"}, {2, "tumour, \"left\" & <hot>"}};
  keep_tets(mesh, [](std::size_t) { return true; });
  return mesh;
}

class TetExchange : public ::testing::Test {
 protected:
  fs::path path(const char* name) const { return folder_.path() / name; }
  TemporaryFolder folder_{fs::temp_directory_path()};
};

std::string refusal(TetMesh mesh) {
  try {
    repair(mesh, "mesh.msh");
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::bad_input);
    return e.what();
  }
  ADD_FAILURE() << "accepted";
  return "";
}

TEST(Patches, EveryBoundaryAndInterfaceTriangleIsInOneNamedPatchAndPointsOut) {
  const TetMesh mesh = two_materials();
  const auto patches = find_patches(mesh);
  ASSERT_EQ(patches.size(), 3u);
  EXPECT_EQ(patches[0].name, "surface_liver");
  EXPECT_EQ(patches[1].inside, 1);
  EXPECT_EQ(patches[1].outside, 2);
  EXPECT_EQ(patches[1].facets.size(), 32u);
  EXPECT_EQ(patches[0].facets.size() + patches[2].facets.size(), boundary_triangles(mesh).size());
  for (const auto& patch : patches)
    for (const auto& facet : patch.facets) {
      const auto &a = mesh.points[facet.corners[0]], &b = mesh.points[facet.corners[1]],
                 &c = mesh.points[facet.corners[2]];
      const auto& apex = mesh.points[mesh.tets[facet.tet][facet.opposite]];
      double e[3][3];
      for (int k = 0; k < 3; ++k) {
        e[0][k] = b[k] - a[k];
        e[1][k] = c[k] - a[k];
        e[2][k] = apex[k] - a[k];
      }
      EXPECT_LT(e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
                    e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
                    e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]),
                0.0);
      EXPECT_EQ(mesh.labels[facet.tet], patch.inside);
    }
}

TEST(Identifiers, AreWhatTheStrictestFormatTakesAndNeverCollide) {
  const auto names =
      export_text::identifiers({{1, "Liver"}, {2, "liver"}, {3, "7 up"}, {4, ""}, {5, "a b"}});
  EXPECT_EQ(names.at(1), "Liver");
  EXPECT_EQ(names.at(2), "liver_2");
  EXPECT_EQ(names.at(3), "m_7_up");
  EXPECT_EQ(names.at(4), "m_");
  EXPECT_EQ(names.at(5), "a_b");
}

TEST_F(TetExchange, MshComesBackToTheLastBitWithItsGroups) {
  const TetMesh mesh = two_materials();
  write_msh(path("mesh.msh"), prepare_export(mesh, {}));
  EXPECT_EQ(read_file(path("mesh.msh")).substr(0, 19), "$MeshFormat\n4.1 1 8");
  const Imported back = import_mesh(path("mesh.msh"));
  EXPECT_EQ(back.mesh.points, mesh.points);
  EXPECT_EQ(back.mesh.tets, mesh.tets);
  EXPECT_EQ(back.mesh.labels, mesh.labels);
  EXPECT_EQ(back.mesh.label_names.at(1), "liver");
  EXPECT_EQ(back.mesh.label_names.at(2), "tumour, 'left' & <hot>");
  EXPECT_EQ(back.labels_from, "physical volumes");
  EXPECT_EQ(back.repairs.cells_skipped, boundary_triangles(mesh).size() + 32);
  EXPECT_EQ(back.repairs.points_merged + back.repairs.tets_turned + back.repairs.duplicate_tets +
                back.repairs.stray_points,
            0u);
}

TEST_F(TetExchange, EveryFormatWritesTheSameBytesTwice) {
  const TetMesh mesh = two_materials();
  const TetExport body = prepare_export(mesh, {{1, {5e3, 0.45, 1060.0}}});
  for (const auto& format : tet_formats()) {
    std::string bytes[2];
    for (auto& once : bytes) {
      format.write(path(format.file), body);
      once = read_file(path(format.file));
    }
    EXPECT_TRUE(bytes[0] == bytes[1]) << format.name;
    EXPECT_FALSE(bytes[0].empty());
  }
}

// A linear displacement given on the whole boundary must come out linear inside, with the stress of
// Hooke's law: node order, sets, materials and units as CalculiX understands them.
TEST_F(TetExchange, CalculixSolvesThePatchTestOnTheAbaqusFile) {
  VISCERA_NEEDS(installed("ccx"), "calculix-ccx is not installed");
  const TetMesh mesh = two_materials(3);
  const double youngs = 20e3, poisson = 0.3, stretch = 1e-3;
  const Elastic soft{youngs, poisson, 1060.0};
  write_inp(path("mesh.inp"), prepare_export(mesh, {{1, soft}, {2, soft}}));
  std::ofstream deck(path("patch.inp"));
  deck << "*INCLUDE, INPUT=mesh.inp\n*STEP\n*STATIC\n*BOUNDARY\n";
  std::set<int> held;
  for (const auto& triangle : boundary_triangles(mesh))
    held.insert(triangle.begin(), triangle.end());
  for (const int p : held)
    for (int axis = 0; axis < 3; ++axis)
      deck << p + 1 << ", " << axis + 1 << ", " << axis + 1 << ", "
           << (axis == 0 ? stretch * mesh.points[p][0] : 0.0) << "\n";
  deck << "*NODE PRINT, NSET=inner\nU\n*EL PRINT, ELSET=liver\nS\n*END STEP\n";
  deck.close();
  std::string inner = "*NSET, NSET=inner\n";
  for (int p = 0; p < static_cast<int>(mesh.points.size()); ++p)
    if (!held.count(p)) inner += std::to_string(p + 1) + "\n";
  write_atomically(path("mesh.inp"), read_file(path("mesh.inp")) + inner);
  const std::string command = "cd '" + folder_.path().string() + "' && ccx patch > ccx.log 2>&1";
  ASSERT_EQ(std::system(command.c_str()), 0) << read_file(path("ccx.log"));
  EXPECT_EQ(read_file(path("ccx.log")).find("*ERROR"), std::string::npos);

  std::istringstream lines(read_file(path("patch.dat")));
  const double lame = youngs * poisson / ((1 + poisson) * (1 - 2 * poisson)) * 1e-6 * stretch;
  const double across = youngs / (1 + poisson) * 1e-6 * stretch;
  std::size_t points = 0, tets = 0;
  bool stresses = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.find("stresses") != std::string::npos) stresses = true;
    std::istringstream words(line);
    int id = 0, place = 0;
    double v[6];
    if (!stresses && words >> id >> v[0] >> v[1] >> v[2]) {
      ++points;
      EXPECT_NEAR(v[0], stretch * mesh.points[id - 1][0], 1e-8);
      EXPECT_NEAR(v[1], 0.0, 1e-8);
    } else if (stresses && words >> id >> place >> v[0] >> v[1] >> v[2]) {
      ++tets;
      EXPECT_NEAR(v[0] / (lame + across), 1.0, 1e-4);  // MPa
      EXPECT_NEAR(v[1] / lame, 1.0, 1e-4);
    }
  }
  EXPECT_EQ(points, mesh.points.size() - held.size());
  EXPECT_EQ(tets, static_cast<std::size_t>(std::count(mesh.labels.begin(), mesh.labels.end(), 1)));
}

TEST_F(TetExchange, TheFebioFileIsWellFormedAndComplete) {
  const TetMesh mesh = two_materials();
  write_feb(path("mesh.feb"), prepare_export(mesh, {{1, {5e3, 0.45, 1060.0}}}));
  const auto root = vtkSmartPointer<vtkXMLDataElement>::Take(
      vtkXMLUtilities::ReadElementFromFile(path("mesh.feb").c_str()));
  ASSERT_NE(root, nullptr);
  EXPECT_STREQ(root->GetName(), "febio_spec");
  EXPECT_STREQ(root->GetAttribute("version"), "4.0");
  auto* materials = root->FindNestedElementWithName("Material");
  ASSERT_EQ(materials->GetNumberOfNestedElements(), 2);
  auto* liver = materials->GetNestedElement(0);
  EXPECT_EQ(std::string(liver->FindNestedElementWithName("E")->GetCharacterData()), "0.005");
  EXPECT_EQ(materials->GetNestedElement(1)->GetNumberOfNestedElements(), 0);  // none invented
  EXPECT_STREQ(materials->GetNestedElement(1)->GetAttribute("name"), "tumour, \"left\" & <hot>");
  auto* body = root->FindNestedElementWithName("Mesh");
  std::map<std::string, int> items;
  for (int e = 0; e < body->GetNumberOfNestedElements(); ++e)
    items[body->GetNestedElement(e)->GetName()] +=
        body->GetNestedElement(e)->GetNumberOfNestedElements();
  EXPECT_EQ(items["Nodes"], static_cast<int>(mesh.points.size()));
  EXPECT_EQ(items["Elements"], static_cast<int>(mesh.tets.size()));
  EXPECT_EQ(items["Surface"], static_cast<int>(boundary_triangles(mesh).size() + 32));
  EXPECT_EQ(root->FindNestedElementWithName("MeshDomains")->GetNumberOfNestedElements(), 2);
}

TEST(Materials, AreReadWithTheirUnitsAndUnknownLabelsRefused) {
  const std::map<int, std::string> names{{1, "liver"}};
  const Json values{{"E", "5 kPa"}, {"nu", 0.45}, {"density", "1060 kg/m3"}};
  const auto known = read_materials({{"liver", values}}, names);
  EXPECT_EQ(known.at(1).youngs_modulus, 5000.0);
  EXPECT_THROW(read_materials({{"livre", values}}, names), Error);
  EXPECT_THROW(read_materials({{"liver", {{"E", "5 kPa"}}}}, names), Error);
}

TEST(Repair, WhatCanBeMendedWithoutAGuessIsMendedAndCounted) {
  const TetMesh clean = two_materials();
  TetMesh mesh = clean;
  std::swap(mesh.tets[5][0], mesh.tets[5][1]);
  mesh.points.push_back(
      mesh.points[mesh.tets[7][2]]);  // a crack: one corner has a point of its own
  mesh.tets[7][2] = static_cast<int>(mesh.points.size()) - 1;
  mesh.points.push_back({9, 9, 9});
  mesh.tets.push_back(mesh.tets[3]);
  mesh.labels.push_back(mesh.labels[3]);
  mesh.tets.push_back({0, 1, 1, 2});
  mesh.labels.push_back(1);
  const Repairs found = repair(mesh, "mesh.msh");
  EXPECT_EQ(found.tets_turned, 1u);
  EXPECT_EQ(found.points_merged, 1u);
  EXPECT_EQ(found.duplicate_tets, 1u);
  EXPECT_EQ(found.tets_collapsed, 1u);
  EXPECT_EQ(found.stray_points, 1u);
  EXPECT_EQ(mesh.tets.size(), clean.tets.size());
  EXPECT_EQ(mesh.points.size(), clean.points.size());
  const auto sound = inspect(mesh);
  EXPECT_EQ(sound.inverted + sound.duplicate_points + sound.stray_points + sound.overfull_faces,
            0u);
  EXPECT_EQ(sound.components, 1u);
}

TEST(Repair, LabelZeroBecomesAFreeLabel) {
  TetMesh mesh = two_materials();
  for (int& label : mesh.labels) label -= 1;
  mesh.label_names = {{0, "liver"}, {1, "tumour"}};
  const Repairs found = repair(mesh, "mesh.msh");
  EXPECT_GT(found.tets_relabelled, 0u);
  EXPECT_EQ(mesh.label_names, (std::map<int, std::string>{{1, "tumour"}, {2, "liver"}}));
  EXPECT_EQ(*std::min_element(mesh.labels.begin(), mesh.labels.end()), 1);
}

TEST(Repair, LabelZeroBesideTheHighestLabelBecomesOneThatFilesHold) {
  TetMesh mesh = two_materials();
  for (int& label : mesh.labels) label = label == 1 ? 0 : 65535;
  mesh.label_names = {{0, "liver"}, {65535, "tumour"}};
  repair(mesh, "mesh.msh");
  EXPECT_EQ(mesh.label_names, (std::map<int, std::string>{{1, "liver"}, {65535, "tumour"}}));
  EXPECT_EQ(std::set<int>(mesh.labels.begin(), mesh.labels.end()), (std::set<int>{1, 65535}));
}

TEST(Repair, WhatWouldTakeAGuessIsRefusedWithCountAndPlace) {
  TetMesh flat = two_materials();
  const auto& tet = flat.tets[0];
  for (int k = 0; k < 3; ++k)
    flat.points[tet[3]][k] = (flat.points[tet[0]][k] + flat.points[tet[1]][k]) / 2.0;
  EXPECT_NE(refusal(flat).find("tets without volume: tet 0 at ("), std::string::npos);

  TetMesh collapsed{.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                    .tets = {{0, 1, 1, 2}},
                    .labels = {1}};
  EXPECT_NE(refusal(collapsed).find("1 tets, each with a corner twice"), std::string::npos);

  TetMesh folded{.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.1, 0.1, 2}},
                 .tets = {{0, 1, 2, 3}, {0, 1, 2, 4}},
                 .labels = {1, 1}};
  EXPECT_NE(refusal(folded).find("same side"), std::string::npos);

  TetMesh overfull = folded;
  overfull.points.push_back({0.1, 0.1, -1});
  overfull.tets.push_back({0, 2, 1, 5});
  overfull.labels.push_back(1);
  EXPECT_NE(refusal(overfull).find("more than two tets"), std::string::npos);

  TetMesh torn = two_materials();
  torn.tets.push_back(torn.tets[0]);
  torn.labels.push_back(torn.labels[0] + 1);
  EXPECT_NE(refusal(torn).find("different labels"), std::string::npos);
}

TEST_F(TetExchange, BrokenAndForeignFilesAreRefusedByName) {
  const auto refused = [](const fs::path& file) -> std::string {
    try {
      import_mesh(file);
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::bad_input);
      return e.what();
    }
    return "accepted";
  };
  write_atomically(path("mesh.stl"), "solid");
  EXPECT_NE(refused(path("mesh.stl")).find(".vtu or .msh"), std::string::npos);
  write_atomically(path("mesh.msh"), "not a mesh at all");
  EXPECT_NE(refused(path("mesh.msh")).find("mesh.msh"), std::string::npos);
  const TetMesh mesh = two_materials();
  write_msh(path("mesh.msh"), prepare_export(mesh, {}));
  const std::string whole = read_file(path("mesh.msh"));
  write_atomically(path("mesh.msh"), whole.substr(0, whole.size() / 2));
  EXPECT_NE(refused(path("mesh.msh")).find("mesh.msh"), std::string::npos);
}

constexpr const char* one_tet_msh =
    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n"
    "$EndNodes\n$Elements\n1\n1 4 2 4 1 1 2 3 4\n$EndElements\n";

// gmsh 4.8 writes outside its arrays on some damaged files, which ends the process that read one at
// any later time. So this process's gmsh must not have seen the file: its session would be over.
TEST_F(TetExchange, NoMshIsReadByTheProcessThatAsksForIt) {
  write_atomically(path("mesh.msh"), one_tet_msh);
  gmsh::initialize(0, nullptr, false);
  gmsh::model::add("of this process");
  EXPECT_EQ(import_mesh(path("mesh.msh")).mesh.tets.size(), 1u);
  std::string name;
  gmsh::model::getCurrent(name);
  EXPECT_EQ(name, "of this process");
  gmsh::finalize();
}

// gmsh runs scripts that stand in place of a mesh, or beside it under the mesh's name and ".opt".
TEST_F(TetExchange, NoScriptIsRunThatAMeshOfGmshBringsAlong) {
  const std::string script = "SystemCall \"touch " + path("ran").string() + "\";\n";
  write_atomically(path("mesh.msh"), script);
  EXPECT_THROW(import_mesh(path("mesh.msh")), Error);
  EXPECT_FALSE(fs::exists(path("ran")));
  write_atomically(path("mesh.msh"), one_tet_msh);
  write_atomically(path("mesh.msh.opt"), script);
  EXPECT_EQ(import_mesh(path("mesh.msh")).mesh.labels, std::vector<int>{4});
  EXPECT_FALSE(fs::exists(path("ran")));
}

TEST_F(TetExchange, ALabelThatMeshesDoNotHaveIsRefused) {
  for (const char* label : {"70000", "2147483647"}) {
    std::string text = one_tet_msh;
    text.replace(text.find("4 2 4 1"), 7, std::string("4 2 ") + label + " 1");
    write_atomically(path("mesh.msh"), text);
    EXPECT_THROW(import_mesh(path("mesh.msh")), Error) << label;
  }
}

TEST_F(TetExchange, AForeignVtuWithTrianglesAndAnotherLabelArrayIsTaken) {
  std::ofstream(path("mesh.vtu")) << R"(<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>
<Piece NumberOfPoints="5" NumberOfCells="3"><Points>
<DataArray type="Float64" NumberOfComponents="3" format="ascii">
0 0 0 1 0 0 0 1 0 0 0 1 1 1 1</DataArray></Points><Cells>
<DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 0 1 2 3 1 2 4 3</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">3 7 11</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">5 10 10</DataArray></Cells>
<CellData><DataArray type="Int64" Name="gmsh:physical" format="ascii">9 4 7</DataArray>
<DataArray type="UInt8" Name="region top" format="ascii">0 1 0</DataArray></CellData>
</Piece></UnstructuredGrid></VTKFile>)";
  const Imported found = import_mesh(path("mesh.vtu"));
  EXPECT_EQ(found.labels_from, "gmsh:physical");
  EXPECT_EQ(found.mesh.labels, (std::vector<int>{4, 7}));
  EXPECT_EQ(found.mesh.regions.at("top"), (std::vector<char>{1, 0}));
  EXPECT_EQ(found.repairs.cells_skipped, 1u);
  EXPECT_EQ(found.repairs.tets_turned, 1u);
}

// The mesh's cube against one that is larger by 0.1 on the upper side only.
TEST(Distance, IsMeasuredBothWaysWithItsPlace) {
  const TetMesh mesh = two_materials();
  SurfaceMesh box;
  box.points = {{0, 0, 0},   {1, 0, 0},   {0, 1, 0},   {1, 1, 0},
                {0, 0, 1.1}, {1, 0, 1.1}, {0, 1, 1.1}, {1, 1, 1.1}};
  box.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                   {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  const auto found = surface_distance(mesh, box, {.spacing = 0.01, .cell_size = 1.0});
  EXPECT_NEAR(found.to_surface.max, 0.1, 1e-12);
  EXPECT_NEAR(found.to_surface.place[2], 1.0, 1e-12);
  EXPECT_NEAR(found.to_mesh.max, 0.1, 1e-12);
  EXPECT_NEAR(found.to_mesh.place[2], 1.1, 1e-12);
  // On the upper face min(0.1, r) with r the distance from its rim: 0.8^2 0.1^2 inside, and
  // 4 (1 - 2r) r^2 dr up to r = 0.1 along the rim; over an area of 6.
  const double squares = 0.0064 + 4.0 * (1e-3 / 3.0 - 1e-4 / 2.0);
  EXPECT_NEAR(found.to_surface.rms, std::sqrt(squares / 6.0), 1e-5);
  EXPECT_TRUE(found.lost.empty());
}

// A needle on the cube, and a second shell where only one body is wanted.
TEST(Distance, WhatTheMeshLacksIsListedByKind) {
  SurfaceMesh surface;
  surface.points = {{0, 0, 0},     {1, 0, 0},       {0, 1, 0},       {1, 1, 0},
                    {0, 0, 1},     {1, 0, 1},       {0, 1, 1},       {1, 1, 1},
                    {5, 5, 5},     {5.2, 5, 5},     {5, 5.2, 5},     {5, 5, 5.2},
                    {0.5, 0.5, 4}, {0.45, 0.45, 1}, {0.55, 0.45, 1}, {0.5, 0.55, 1}};
  surface.triangles = {{0, 2, 1},    {1, 2, 3},    {0, 1, 4},   {1, 5, 4},   {2, 6, 3},
                       {3, 6, 7},    {0, 4, 2},    {2, 4, 6},   {1, 3, 5},   {3, 7, 5},
                       {8, 10, 9},   {8, 9, 11},   {9, 10, 11}, {8, 11, 10}, {13, 14, 12},
                       {14, 15, 12}, {15, 13, 12}, {4, 5, 14},  {4, 14, 13}, {5, 7, 15},
                       {5, 15, 14},  {7, 6, 15},   {6, 4, 13},  {6, 13, 15}};
  surface.labels.assign(surface.triangles.size(), 1);
  const auto found =
      surface_distance(two_materials(), surface, {.spacing = 0.05, .cell_size = 0.5, .bodies = 1});
  ASSERT_EQ(found.lost.size(), 2u);
  EXPECT_NEAR(found.lost[0].detached_volume, 0.008 / 6.0, 1e-6);
  EXPECT_EQ(found.lost[1].detached_volume, 0.0);
  EXPECT_NEAR(found.lost[1].place[2], 4.0, 0.1);
  EXPECT_LT(found.lost[1].thickness, 0.15);
  EXPECT_EQ(found.lost[0].volume, found.lost[0].detached_volume);
  EXPECT_NEAR(found.lost[1].volume, 0.005, 1e-4) << "a pyramid of 3 mm on 0.005 mm2";
  EXPECT_LT(found.to_mesh_kept.max, 0.25);
  EXPECT_GT(found.to_mesh.max, 4.0);
}

}  // namespace
}  // namespace viscera
