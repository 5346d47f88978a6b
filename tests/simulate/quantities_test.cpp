// What a run of viscera-simulate is asked to tell beside its motion: error bars, forces, probes.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "stages/image/image_io.hpp"
#include "stages/mesh/landmark_io.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/trajectory/hdf5_file.hpp"
#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

TEST_F(Simulate, ACertifiedRunSaysHowFarTheBodyIsOffOrWhyThatIsNotKnown) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  ASSERT_EQ(run(held), 0) << errors;
  EXPECT_EQ(metric("error_total"), "absent");
  ASSERT_EQ(run(held, {"--set", "certify=true", "--set", "element=linear"}), 0) << errors;
  const double total = metric("error_total").get<double>();
  EXPECT_TRUE(metric("error_bar_unknown").is_null());
  EXPECT_GT(metric("error_element").get<double>(), metric("error_solver").get<double>());
  EXPECT_LE(total, metric("error_solver").get<double>() + metric("error_element").get<double>() +
                       metric("error_mesh").get<double>() + metric("error_support").get<double>());
  EXPECT_GT(metric("error_total_share").get<double>(), 0.01) << "linear tets on three cells";
  EXPECT_GT(metric("error_centroids").at("liver").get<double>(), 0.0);
  ASSERT_EQ(run(held, {"--set", "certify=true"}), 0) << errors;
  EXPECT_LT(metric("error_total").get<double>(), total) << "smoothed elements";
  const TetMesh sized = read_vtu(path("out") / "size_field.vtu");
  ASSERT_EQ(sized.cell_data.count(relative_size), 1u);
  EXPECT_EQ(sized.cell_data.at(relative_size).size(), sized.tets.size());
  EXPECT_EQ(run(held, {"--set", "certify=true", "--set", "end=0.05s"}), 0) << errors;
  EXPECT_EQ(metric("error_bar_unknown"), "the body is not at rest");
  EXPECT_EQ(metric("error_total"), "absent");
  EXPECT_NE(errors.find("not known"), std::string::npos) << errors;
}

TEST_F(Simulate, ABodyThatFrictionAloneHoldsSaysFirstThatItsPlaceIsNotInItsErrorBar) {
  ASSERT_EQ(run(drop_scene, {"--set", "certify=true"}), 0) << errors;
  EXPECT_TRUE(metric("error_bar_unknown").is_null());
  ASSERT_EQ(manifest().caveats.size(), 1u);
  EXPECT_NE(manifest().caveats[0].find("Nothing but friction"), std::string::npos);
  const std::string held = with(drop_scene, "  viscosity:", "  fixed: {side: superior}");
  ASSERT_EQ(run(held, {"--set", "certify=true"}), 0) << errors;
  EXPECT_TRUE(manifest().caveats.empty());
}

TEST_F(Simulate, AMeshThatSaysWhereItsLabelsEndHasThatInItsErrorBar) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  ASSERT_EQ(run(held, {"--set", "certify=true"}), 0) << errors;
  const double without = metric("error_total").get<double>();
  EXPECT_TRUE(metric("error_surface").is_null());
  EXPECT_EQ(metric("error_surface_unknown"), "the mesh does not say where the labels end");
  TetMesh mesh = read_vtu(path("mesh.vtu"));
  // Tissue that hangs below the cube, which begins at 25 mm: more weight.
  for (const auto& tet : mesh.tets) {
    double lowest = 1e9;
    for (const int v : tet) lowest = std::min(lowest, mesh.points[v][2]);
    mesh.cell_data[missing_volume].push_back(lowest < 25.0 + 1e-9 ? 100.0f : 0.0f);
  }
  write_vtu(path("mesh.vtu"), mesh);
  ASSERT_EQ(run(held, {"--set", "certify=true"}), 0) << errors;
  EXPECT_TRUE(metric("error_surface_unknown").is_null());
  const double surface = metric("error_surface").get<double>();
  EXPECT_GT(surface, 0.001);
  EXPECT_NEAR(metric("error_total").get<double>(), without + surface, 1e-6);
}

TEST_F(Simulate, AnErrorThatIsExpectedIsJudgedAndFailsWhereItIsNotKnown) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  const auto expecting = [&](const char* most) {
    return with(held, "inverted_max: {max: 0}", fmt::format("error_total: {{max: {}}}", most));
  };
  EXPECT_EQ(run(expecting("5"), {"--set", "certify=true"}), 0) << errors;
  EXPECT_EQ(run(expecting("0.001"), {"--set", "certify=true"}), 5);
  EXPECT_EQ(run(expecting("5")), 5);
  EXPECT_NE(errors.find("certify: true"), std::string::npos) << errors;
}

TEST_F(Simulate, AnAdaptedRunAsksForAFinerMeshUntilItIsGoodEnoughOrMayNotGrow) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  const auto adapted = [&](const char* goal) {
    return run(held, {"--set", fmt::format("adapt={}", goal), "--set", "element=linear"});
  };
  const fs::path asked = path("out") / "size_field.vtu";
  ASSERT_EQ(adapted("{total: 90 %, at_most: 10000}"), 0) << errors;
  const double share = metric("error_total_share").get<double>();
  const auto tets = metric("tets").get<double>();
  EXPECT_FALSE(fs::exists(asked)) << "good enough";
  ASSERT_EQ(adapted(fmt::format("{{total: {}, at_most: 100000}}", 0.5 * share).c_str()), 0);
  const TetMesh sized = read_vtu(asked);
  EXPECT_EQ(sized.cell_data.at(relative_size).size(), sized.tets.size());
  EXPECT_GT(sized.numbers.at(wanted_tets), std::pow(2.0, 1.5) * tets) << "h^2, and a margin";
  EXPECT_LE(sized.numbers.at(wanted_tets), 4.0 * tets);
  EXPECT_EQ(adapted("{total: 0.1 %, at_most: 200}"), 5) << "no more tets are allowed";
  EXPECT_FALSE(fs::exists(asked));
  EXPECT_NE(errors.find("adapt_total"), std::string::npos) << errors;
  EXPECT_EQ(adapted("{total: 0.1 %, at_most: 100000, last: true}"), 5);
  EXPECT_FALSE(fs::exists(asked));
  EXPECT_EQ(run(held, {"--set", "adapt={total: 50 %, at_most: 9000}", "--set", "end=0.05s"}), 5)
      << "of a body that moves the error is not known";
  EXPECT_EQ(adapted("{total: 2 %}"), 3);
  EXPECT_NE(errors.find("adapt.at_most"), std::string::npos) << errors;
  EXPECT_EQ(adapted("{total: 2 mm, at_most: 5000}"), 3);
  EXPECT_EQ(adapted("{total: 2 %, within: 2 mm, at_most: 5000}"), 3);
  EXPECT_EQ(adapted("{total: 2 %, of: liver, at_most: 5000}"), 3);
}

TEST_F(Simulate, AnAdaptedRunMayAskForOneQuantityToALength) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  const auto adapted = [&](const std::string& within, const char* of) {
    const auto goal = fmt::format("adapt={{within: {} mm, of: {}, at_most: 160}}", within, of);
    return run(held, {"--set", goal, "--set", "probes={tip: {point: [1 mm, 2 mm, 53 mm]}}"});
  };
  ASSERT_EQ(adapted("100", "tip"), 0) << errors;
  const double tip = metric("error_probes").at("tip").get<double>();
  const double liver = metric("error_centroids").at("liver").get<double>();
  ASSERT_GT(std::abs(tip - liver), 0.1 * liver) << "the test cannot tell one from the other";
  for (const auto& [name, error] : {std::pair("tip", tip), {"liver", liver}}) {
    EXPECT_EQ(adapted(fmt::format("{}", 1.01 * error), name), 0) << name << errors;
    EXPECT_EQ(adapted(fmt::format("{}", 0.99 * error), name), 5) << name;
  }
  EXPECT_NE(errors.find("adapt_within"), std::string::npos) << errors;
  EXPECT_EQ(adapted("1", "liber"), 3);
  EXPECT_NE(errors.find("did you mean 'liver'?"), std::string::npos) << errors;
}

TEST_F(Simulate, ForcesAtRestCarryTheWeightAndAreColumnsOfTheMetrics) {
  ASSERT_EQ(run(drop_scene, {"--set", "forces=true"}), 0) << errors;
  const Json end = metric("force_end"), most = metric("force_most");
  const double weight = -end["gravity"][2].get<double>();
  EXPECT_GT(weight, 0.1);
  EXPECT_NEAR(end["ground"][2].get<double>(), weight, 1e-4 * weight);
  EXPECT_LT(metric("force_handed_on_end").get<double>(), 0.02 * weight);
  EXPECT_GT(most["ground"].get<double>(), 1.5 * weight);  // of the impact
  const std::string table = read_file(path("out") / "metrics.csv");
  for (const char* column : {"force_ground_z_N", "moment_gravity_x_N_m", "force_remainder_y_N"})
    EXPECT_NE(table.substr(0, table.find('\n')).find(column), std::string::npos) << column;
  EXPECT_NE(errors.find("forces on the body at the end, N: gravity"), std::string::npos) << errors;
}

TEST_F(Simulate, StressAndStrainAtTheEndAreAFileOfTheirOwn) {
  ASSERT_EQ(run(drop_scene), 0) << errors;
  EXPECT_FALSE(fs::exists(path("out") / "stress.vtu")) << "not asked for";
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  ASSERT_EQ(run(held, {"--set", "stress=true"}), 0) << errors;
  const double below = metric("von_mises_99").at("liver").get<double>();
  EXPECT_GT(below, 0.01);  // kPa: rho g h of a body of 6 cm is 0.6
  EXPECT_LT(below, 1.0);
  EXPECT_GE(metric("von_mises_max").at("liver").get<double>(), below);
  EXPECT_NE(errors.find("von Mises stress at the end, kPa: liver"), std::string::npos) << errors;
  const TetMesh written = read_vtu(path("out") / "stress.vtu");
  EXPECT_EQ(written.tets.size(), metric("tets").get<std::size_t>());
  EXPECT_EQ(written.points.size(), metric("vertices").get<std::size_t>()) << "one label";
  const std::string text = read_file(path("out") / "stress.vtu");
  for (const char* name : {"cauchy_stress_kPa", "principal_stress_kPa", "von_mises_stress_kPa",
                           "green_strain", "displacement_mm", "\"J\""}) {
    EXPECT_NE(text.find(name), std::string::npos) << name;
  }
}

std::vector<float> stress_frame(const fs::path& folder, const char* field, std::size_t number) {
  const hdf5::QuietHdf5 quiet;
  const fs::path file = folder / "stress.h5";
  const std::string name = fmt::format("/{}/{}", field, number);
  const auto set = hdf5::open_dataset(hdf5::open_hdf5(file), file, name.c_str(), H5T_FLOAT, {0});
  return hdf5::read_values<float>(set, file, name.c_str(), H5T_NATIVE_FLOAT);
}

// The last frame is that of stress.vtu, with the stiffness that the schedule brings; frames before
// it comes are those of a run without it.
TEST_F(Simulate, StressByFrameIsThatOfWhatHoldsThen) {
  const auto frame = [&](const char* field, std::size_t number) {
    return stress_frame(path("out"), field, number);
  };
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  ASSERT_EQ(run(held, {"--set", "stress_frames=true"}), 0) << errors;
  const auto plain = frame("von_mises_stress_kPa", 10);
  EXPECT_GT(plain.front(), 0.0f);
  for (const float j : frame("J", 0)) EXPECT_NEAR(j, 1.0, 1e-5);
  ASSERT_EQ(run(held + "schedule: [{at: 0.5 s, materials: {liver: {E: 9 kPa}}}]\n",
                {"--set", "stress_frames=true", "--set", "stress=true"}),
            0)
      << errors;
  EXPECT_EQ(frame("von_mises_stress_kPa", 10), plain);
  const auto frames = metric("frames").get<std::size_t>();
  const auto last = frame("von_mises_stress_kPa", frames - 1);
  const TetMesh end = read_vtu(path("out") / "stress.vtu");
  const auto& expected = end.cell_data.at("von_mises_stress_kPa");
  ASSERT_EQ(last.size(), expected.size());
  for (std::size_t t = 0; t < last.size(); ++t) EXPECT_NEAR(last[t], expected[t], 2e-4) << t;
  const std::string opens = read_file(path("out") / "stress.xdmf");
  EXPECT_NE(opens.find(fmt::format("stress.h5:/J/{}<", frames - 1)), std::string::npos);
  EXPECT_NE(opens.find("trajectory.h5:/frames/0<"), std::string::npos);
  EXPECT_EQ(run(held, {"--set", "stress_frames=true", "--set", "solver=fem", "--set", "fem_order=2",
                       "--set", "fem_time=quasi_static"}),
            3);
  EXPECT_NE(errors.find("middles of edges"), std::string::npos) << errors;
}

// The places of frames tell what branches carry, of which frames keep nothing: a fourth of the
// stress here is theirs, and two frames are the relaxation time of one. Gone on with, branches are
// where they were.
TEST_F(Simulate, StressByFrameHasWhatBranchesCarry) {
  const std::string relaxing =
      with(with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}"),
           "  viscosity:",
           "  viscosity:\n  prony: [{modulus: 1, time: 0.5 s}, {modulus: 1, time: 30 ms}]");
  const std::vector<std::string> of_all = {"--set", "stress_frames=true", "--set", "stress=true"};
  const auto expect_the_end_of = [&](const fs::path& folder, std::size_t frame) {
    const auto last = stress_frame(folder, "von_mises_stress_kPa", frame);
    const TetMesh end = read_vtu(folder / "stress.vtu");
    const auto& expected = end.cell_data.at("von_mises_stress_kPa");
    ASSERT_EQ(last.size(), expected.size());
    double largest = 0.0;
    for (const double stress : expected) largest = std::max(largest, stress);
    for (std::size_t t = 0; t < last.size(); ++t)
      EXPECT_NEAR(last[t], expected[t], 0.02 * largest) << t;
  };
  auto shorter = of_all;
  shorter.insert(shorter.end(), {"--set", "end=0.2s"});
  ASSERT_EQ(run(relaxing, shorter), 0) << errors;
  expect_the_end_of(path("out"), 12);
  fs::copy_file(path("out") / "checkpoint.h5", path("before.h5"));
  shorter.insert(shorter.end(), {"--in", "checkpoint=" + path("before.h5").string()});
  shorter[5] = "end=0.3s";
  ASSERT_EQ(run(relaxing, shorter), 0) << errors;
  expect_the_end_of(path("out"), 6);
}

// Frames that are equilibria have no inertia, however far the body goes from one to the next.
TEST_F(Simulate, ForcesOfEquilibriaHaveNoInertiaInThem) {
  const std::string led =
      with(with(drop_scene, "  viscosity:\n", ""), "ground: {clearance: 5 mm, friction: 0.3}",
           "fixed: {side: inferior, within: 1 mm}\n  prescribed: {side: superior, within: 1 mm, "
           "displacement: [0 mm, 0 mm, 10 mm], duration: 0.1 s}");
  ASSERT_EQ(run(led, {"--set", "forces=true", "--set", "solver=fem", "--set",
                      "fem_time=quasi_static", "--set", "end=0.1s"}),
            0)
      << errors;
  const auto column = [&](const std::string& name) {
    std::istringstream table(read_file(path("out") / "metrics.csv"));
    std::string line, cell;
    std::getline(table, line);
    std::istringstream heads(line);
    std::size_t at = 0;
    while (std::getline(heads, cell, ',') && cell != name) ++at;
    std::vector<double> values;
    while (std::getline(table, line)) {
      std::istringstream cells(line);
      for (std::size_t k = 0; k <= at; ++k) std::getline(cells, cell, ',');
      values.push_back(cell.empty() ? std::nan("") : std::stod(cell));
    }
    return values;
  };
  const auto held = column("force_fixed_z_N"), pulled = column("force_prescribed_z_N"),
             weight = column("force_gravity_z_N");
  ASSERT_GE(held.size(), 5u);
  for (std::size_t frame = 1; frame < held.size(); ++frame)
    EXPECT_NEAR(held[frame] + pulled[frame], -weight[frame], 1e-4 * std::abs(weight[frame]))
        << frame;
  EXPECT_GT(pulled.back(), 0.0);
}

TEST_F(Simulate, StressThatNothingTellsIsRefused) {
  EXPECT_EQ(run(drop_scene, {"--set", "stress=true", "--set", "solver=pbd"}), 3);
  EXPECT_NE(errors.find("constraints have no stress"), std::string::npos) << errors;
}

TEST_F(Simulate, ProbesAreFollowedAndHaveErrorBars) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  ASSERT_EQ(run(held, {"--set", "certify=true", "--set",
                       "probes={tip: {point: [1 mm, 2 mm, 53 mm]}, all: {centroid: liver}}"}),
            0)
      << errors;
  const Json end = metric("probe_end").at("tip");
  const Json moved = metric("probe_displacement_end");
  EXPECT_NEAR(std::hypot(end[0].get<double>() - 1.0, end[1].get<double>() - 2.0,
                         end[2].get<double>() - 53.0),
              moved["tip"].get<double>(), 1e-9);
  EXPECT_GT(moved["all"].get<double>(), 0.01);
  EXPECT_EQ(metric("error_probes")["all"], metric("error_centroids")["liver"]);
  EXPECT_NE(read_file(path("out") / "metrics.csv").find(",probe_tip_z_mm"), std::string::npos);
}

TEST_F(Simulate, AGapIsFollowedUntilTheBodyLies) {
  ASSERT_EQ(run(drop_scene,
                {"--set", "probes={fall: {between: [liver, ground]}, all: {centroid: liver}}"}),
            0)
      << errors;
  const double end = metric("gap_end").at("fall").get<double>();
  EXPECT_NEAR(end, 0.0, 0.05) << "it lies on the ground, into which a substep leaves it pressed";
  EXPECT_LE(metric("gap_least").at("fall").get<double>(), end);
  EXPECT_EQ(metric("probe_end").size(), 1u);
  const std::string table = read_file(path("out") / "metrics.csv");
  const std::size_t first = table.find('\n') + 1;
  EXPECT_NE(table.substr(0, first).find(",gap_fall_mm"), std::string::npos);
  const std::string start = table.substr(first, table.find('\n', first) - first);
  EXPECT_NEAR(std::stod(start.substr(start.rfind(',') + 1)), 5.0, 1e-6) << "the clearance, mm";
}

TEST_F(Simulate, ProbesThatNameNothingAreRefused) {
  const std::pair<const char*, const char*> cases[] = {
      {"{far: {point: [1 m, 0 mm, 0 mm]}}", "mm outside of the body"},
      {"{far: {point: [1, 2, 3]}}", "probes.far.point"},
      {"{far: {point: [1 mm, 2 mm]}}", "three coordinates"},
      {"{lump: {centroid: livre}}", "did you mean 'liver'?"},
      {"{lump: {}}", "none of point, centroid and between"},
      {"{lump: {centroid: liver, point: [1 mm, 2 mm, 3 mm]}}", "several at once"},
      {"{gap: {between: [liver, grount]}}", "did you mean 'ground'?"},
      {"{gap: {between: [lever, ground]}}", "did you mean 'liver'?"},
      {"{gap: {between: [liver]}}", "probes.gap"},
      {"{gap: {between: [liver, liver]}}", "labels that touch"},
      {"{lump: liver}", "probes.lump"},
      {"{'a,b': {centroid: liver}}", "letters, digits"},
      {"{tip: {pint: [1 mm, 2 mm, 3 mm]}}", "did you mean 'point'?"},
  };
  for (const auto& [probes, says] : cases) {
    EXPECT_EQ(run(drop_scene, {"--set", std::string("probes=") + probes}), 3) << probes;
    EXPECT_NE(errors.find(says), std::string::npos) << probes << ": " << errors;
  }
}

TEST_F(Simulate, LandmarksOf3DSlicerComeInAndOut) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  const auto taking = [&](const char* name, const std::string& text) {
    write_atomically(path(name), text);
    return run(held, {"--in", "landmarks=" + path(name).string(), "--set",
                      "probes={all: {centroid: liver}}"});
  };
  ASSERT_EQ(taking("a.csv", "name,x,y,z\ntip,1,2,53\nlow,-4,5,26\n"), 0) << errors;
  const Json end = metric("probe_end");
  EXPECT_EQ(end.size(), 3u);
  const std::string table = read_file(path("out") / "landmarks.csv");
  EXPECT_EQ(std::ranges::count(table, '\n'), 3) << "the centroid is no landmark";
  // The other two formats, one of them in RAS, name the same points: to the last digit.
  ASSERT_EQ(taking("a.fcsv",
                   "# Markups fiducial file version = 4.11\n# CoordinateSystem = RAS\n"
                   "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
                   "1,-1,-2,53,0,0,0,1,1,1,0,tip,,\n2,4,-5,26,0,0,0,1,1,1,0,low,,\n"),
            0)
      << errors;
  EXPECT_NE(errors.find("are in RAS"), std::string::npos) << errors;
  EXPECT_EQ(read_file(path("out") / "landmarks.csv"), table);
  ASSERT_EQ(
      taking("a.mrk.json",
             R"({"markups": [{"type": "Fiducial", "coordinateSystem": "LPS", "controlPoints": [
                 {"label": "tip", "position": [1, 2, 53]}, {"label": "low", "position": [-4, 5, 26]}
                ]}]})"),
      0)
      << errors;
  EXPECT_EQ(read_file(path("out") / "landmarks.csv"), table);
  // What comes out goes in again: the places at the end are points of another run's rest.
  fs::copy_file(path("out") / "landmarks.mrk.json", path("again.mrk.json"));
  const JsonText again = read_json(path("again.mrk.json"));
  const JsonValue tip = again.root()["markups"][0]["controlPoints"][0];
  EXPECT_EQ(tip["label"].text(), "tip");
  for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(tip["position"][k].number(), end["tip"][k]);
}

// Of an image whose axes are not the patient's. ITK-SNAP's first voxel reaches from 0 to 1.
TEST_F(Simulate, LandmarksOfItkSnapComeInAndOutInTheVoxelsOfTheirImage) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  const std::vector<Landmark> lps = {{"tip", {1, 2, 53}}, {"low", {-4, 5, 26}}};
  write_atomically(path("a.csv"), landmarks_as_table(lps));
  const std::string in_mm = "landmarks=" + path("a.csv").string();
  ASSERT_EQ(run(held, {"--in", in_mm}), 0) << errors;
  const std::string table = read_file(path("out") / "landmarks.csv");
  // Voxel (i, j, k) is centred at (10 - 2 i, 8 - 4 k, 20 + j).
  write_nrrd(path("ct.nrrd"), ScalarImage{{.size = {12, 50, 5},
                                           .spacing = {2, 1, 4},
                                           .origin = {10, 8, 20},
                                           .direction = {-1, 0, 0, 0, 0, -1, 0, 1, 0}},
                                          std::vector<float>(12 * 50 * 5)});
  write_atomically(path("a.annot"), R"(<?xml version="1.0" encoding="UTF-8" ?>
<!DOCTYPE registry [
<!ELEMENT registry (entry*,folder*)>
<!ELEMENT folder (entry*,folder*)>
<!ELEMENT entry EMPTY>
<!ATTLIST folder key CDATA #REQUIRED>
<!ATTLIST entry key CDATA #REQUIRED>
<!ATTLIST entry value CDATA #REQUIRED>
]>
<registry>
  <entry key="Format" value="ITK-SNAP Annotation File" />
  <entry key="FormatDate" value="20150624" />
  <folder key="Annotations" >
    <entry key="ArraySize" value="3" />
    <folder key="Element[0]" >
      <entry key="Pos" value="5 33.5 2" />
      <entry key="Text" value="tip" />
      <entry key="Type" value="LandmarkAnnotation" />
      <folder key="Tags" >
        <entry key="Text" value="not a name" />
      </folder>
    </folder>
    <folder key="Element[1]" >
      <entry key="Point1" value="1 2 3" />
      <entry key="Type" value="LineSegmentAnnotation" />
    </folder>
    <folder key="Element[2]" >
      <entry key="Pos" value="7.5 6.5 1.25" />
      <entry key="Text" value="low" />
      <entry key="Type" value="LandmarkAnnotation" />
    </folder>
  </folder>
</registry>
)");
  const std::string image = "landmarks_image=" + path("ct.nrrd").string();
  const auto taking = [&](const fs::path& file) {
    return run(held, {"--in", "landmarks=" + file.string(), "--in", image});
  };
  ASSERT_EQ(taking(path("a.annot")), 0) << errors;
  EXPECT_EQ(read_file(path("out") / "landmarks.csv"), table);
  const std::string annotations = read_file(path("out") / "landmarks.annot");
  // What comes out goes in again, and a table with an image becomes the same annotations.
  const Landmarks again = read_landmarks(path("out") / "landmarks.annot");
  ASSERT_TRUE(again.in_voxels);
  ASSERT_EQ(again.all.size(), 2u);
  const Json end = metric("probe_end");
  for (const auto& [name, voxels] : again.all) {
    EXPECT_NEAR(10 - 2 * (voxels[0] - 0.5), end[name][0].get<double>(), 1e-6) << name;
    EXPECT_NEAR(8 - 4 * (voxels[2] - 0.5), end[name][1].get<double>(), 1e-6) << name;
    EXPECT_NEAR(20 + (voxels[1] - 0.5), end[name][2].get<double>(), 1e-6) << name;
  }
  ASSERT_EQ(run(held, {"--in", in_mm, "--in", image}), 0) << errors;
  EXPECT_EQ(read_file(path("out") / "landmarks.annot"), annotations);
  ASSERT_EQ(run(held, {"--in", in_mm}), 0) << errors;
  EXPECT_FALSE(fs::exists(path("out") / "landmarks.annot"));
  // An image that cannot be read is refused before the run, also where nothing is told in its
  // voxels.
  write_atomically(path("ct.nrrd"), "no image");
  fs::remove_all(path("out"));
  EXPECT_EQ(run(held, {"--in", in_mm, "--in", image}), 4);
  EXPECT_FALSE(fs::exists(path("out") / "trajectory.h5")) << "it ran";
}

TEST_F(Simulate, LandmarksThatCannotBeFollowedAreRefusedByName) {
  const std::string annotation =
      R"(<registry><entry key="Format" value="ITK-SNAP Annotation File"/><folder key="Annotations">
         <folder key="Element[0]"><entry key="Type" value="LandmarkAnnotation"/>
         <entry key="Text" value="tip"/><entry key="Pos" value="1 )";
  const std::string end = R"("/></folder></folder></registry>)";
  const std::string snap = annotation + "2 3" + end, cut_off = annotation + "2" + end;
  const std::array<const char*, 3> cases[] = {
      {"a.csv", "name,x,y,z\ntip,1,2,530\n", "mm outside of the body"},
      {"a.csv", "name,x,y,z\ntip,1,2\n", "line 2"},
      {"a.csv", "name,x,y,z\ntip,1,2,5e\n", "a coordinate in mm"},
      {"a.csv", "name,x,y\ntip,1,2\n", "no column z"},
      {"a.csv", "name,x,y,z\ntip,1,2,53\ntip,1,2,52\n", "stands twice"},
      {"a.csv", "name,x,y,z\nall,1,2,53\n", "the name of a probe"},
      {"a.fcsv", "# CoordinateSystem = XYZ\n", "LPS or RAS"},
      {"a.mrk.json", R"({"markups": [{"controlPoints": [{"label": "tip"}]}]})", "position"},
      {"a.mrk.json",
       R"({"markups": [{"coordinateUnits": "m", "controlPoints": [{"label": "tip", "position": [0, 0, 0]}]}]})",
       "coordinateUnits"},
      {"a.mrk.json",
       R"({"markups": [{"controlPoints": [{"label": "tip", "position": [0, 0, 0], "positionStatus": "undefined"}]}]})",
       "positionStatus"},
      {"a.txt", "tip 1 2 3", ".csv, .fcsv, .mrk.json or .annot"},
      {"a.annot", snap.c_str(), "give the image that ITK-SNAP had open"},
      {"a.annot", cut_off.c_str(), "a coordinate in voxels"},
      {"a.annot", "<registry/>", "ITK-SNAP Annotation File"},
      {"a.annot", "<registry><entry></registry>", "ITK-SNAP Annotation File"},
  };
  for (const auto& [name, text, says] : cases) {
    write_atomically(path(name), text);
    EXPECT_EQ(run(drop_scene, {"--in", "landmarks=" + path(name).string(), "--set",
                               "probes={all: {centroid: liver}}"}),
              4)
        << text;
    EXPECT_NE(errors.find(says), std::string::npos) << text << ": " << errors;
  }
}

TEST_F(Simulate, ForcesOfASolverThatHasNoneAreRefused) {
  EXPECT_EQ(run(drop_scene, {"--set", "forces=true", "--set", "solver=pbd"}), 3);
  EXPECT_NE(errors.find("solver: pbd, whose constraints have no forces"), std::string::npos)
      << errors;
}

}  // namespace
}  // namespace viscera
