// What a report says is what its sources say: packed geometry, companions, refusals, determinism.
#include <gtest/gtest.h>
#include <zlib.h>

#include <cmath>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "stages/report/page.hpp"
#include "stages/report/report_stage.hpp"
#include "stages/report/sources.hpp"
#include "stages/report/viewer_data.hpp"
#include "tests/web/sample_run.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

// What geometry.js does, so that the layout is checked on both sides.
struct Unpacked {
  std::vector<std::uint32_t> triangles;
  std::vector<std::vector<double>> positions;  // rest first; x of all vertices, then y, then z
  std::vector<std::vector<double>> ratios;
  std::vector<std::vector<double>> stresses;  // kPa
  std::vector<double> quality;
};

Unpacked unpack(const ViewerData& data) {
  const auto& meta = data.meta;
  const std::size_t n = meta["vertices"], frames = meta["times_s"].size();
  std::size_t corners = 0;
  for (const auto& group : meta["groups"]) corners += 3 * group["triangles"].get<std::size_t>();
  const double stress_range =
      meta["stress_range_kPa"].is_null() ? 0.0 : meta["stress_range_kPa"].get<double>();
  const std::size_t fields = stress_range > 0.0 ? 2 : 1;
  std::vector<std::uint8_t> bytes(4 * corners + 6 * n * (frames + 1) + fields * n * frames + n);
  uLongf size = bytes.size();
  EXPECT_EQ(uncompress(bytes.data(), &size, reinterpret_cast<const Bytef*>(data.packed.data()),
                       data.packed.size()),
            Z_OK);
  EXPECT_EQ(size, bytes.size());
  Unpacked out;
  const std::uint8_t* at = bytes.data();
  for (std::size_t i = 0; i < corners; ++i, at += 4) {
    out.triangles.push_back(at[0] | at[1] << 8 | at[2] << 16 | static_cast<unsigned>(at[3]) << 24);
  }
  std::vector<std::uint16_t> q(3 * n, 0);
  for (std::size_t f = 0; f <= frames; ++f) {
    std::vector<double> xyz;
    for (std::size_t axis = 0; axis < 3; ++axis, at += 2 * n) {
      for (std::size_t i = 0; i < n; ++i) {
        const int zigzag = at[i] | at[n + i] << 8;
        auto& value = q[axis * n + i];
        value = static_cast<std::uint16_t>(value + (zigzag >> 1 ^ -(zigzag & 1)));
        xyz.push_back(meta["box_lo_mm"][axis].get<double>() +
                      meta["step_mm"][axis].get<double>() * value);
      }
    }
    out.positions.push_back(xyz);
  }
  const auto values = [&](std::size_t count, auto&& value_of) {
    std::vector<std::vector<double>> all;
    std::vector<std::uint8_t> last(n, 0);
    for (std::size_t f = 0; f < count; ++f, at += n) {
      std::vector<double>& frame = all.emplace_back();
      for (std::size_t i = 0; i < n; ++i) {
        last[i] = static_cast<std::uint8_t>(last[i] + at[i]);
        frame.push_back(value_of(last[i]));
      }
    }
    return all;
  };
  const double ratio_range = meta["ratio_range"];
  out.ratios = values(frames, [&](int byte) { return 1.0 + ratio_range * (byte / 127.0 - 1.0); });
  if (fields == 2)
    out.stresses = values(frames, [&](int byte) { return stress_range * byte / 254.0; });
  out.quality = values(1, [](int byte) { return byte / 254.0; })[0];
  return out;
}

// Signed volume inside the triangles of one group, ml.
double enclosed_ml(const Unpacked& data, std::size_t begin, std::size_t triangles,
                   std::size_t frame) {
  const auto& p = data.positions[frame];
  const std::size_t n = p.size() / 3;
  double sum = 0.0;
  for (std::size_t t = begin; t < begin + 3 * triangles; t += 3) {
    const auto x = [&](int corner, int axis) { return p[axis * n + data.triangles[t + corner]]; };
    sum += x(0, 0) * (x(1, 1) * x(2, 2) - x(1, 2) * x(2, 1)) -
           x(0, 1) * (x(1, 0) * x(2, 2) - x(1, 2) * x(2, 0)) +
           x(0, 2) * (x(1, 0) * x(2, 1) - x(1, 1) * x(2, 0));
  }
  return sum / 6000.0;
}

class Report : public testing::Test {
 protected:
  void write(const TetMesh& mesh, const std::vector<std::vector<float>>& frames) {
    TrajectoryWriter writer(folder_.path(), mesh);
    for (std::size_t f = 0; f < frames.size(); ++f) {
      writer.append(0.1 * static_cast<double>(f), frames[f]);
    }
    writer.finish();
  }
  // Rest points scaled by 1 + 0.1 f and shifted by 10 f along z.
  static std::vector<std::vector<float>> growing(const TetMesh& mesh, int frames) {
    std::vector<std::vector<float>> all(frames);
    for (int f = 0; f < frames; ++f) {
      for (const auto& p : mesh.points) {
        for (int k = 0; k < 3; ++k) {
          all[f].push_back(static_cast<float>(p[k] * (1.0 + 0.1 * f) - (k == 2 ? 10.0 * f : 0.0)));
        }
      }
    }
    return all;
  }
  ViewerData viewer(std::size_t max_frames = 100) {
    return viewer_data(TrajectoryReader(h5_), max_frames, h5_.string());
  }
  void expect_refused(const std::map<std::string, fs::path>& inputs, const std::string& named) {
    try {
      read_sources(inputs);
      FAIL() << "accepted although " << named << " is bad";
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::bad_input);
      EXPECT_NE(std::string(e.what()).find(named), std::string::npos) << e.what();
    }
  }
  std::map<std::string, fs::path> sample(const SampleRun& run = {}) {
    write_sample_run(folder_.path(), run);
    return {{"labels", folder_.path() / "labels" / "labels.nrrd"},
            {"mesh", folder_.path() / "tetmesh" / "mesh.vtu"},
            {"trajectory", folder_.path() / "simulate" / "trajectory.h5"}};
  }

  TemporaryFolder folder_{fs::temp_directory_path()};
  fs::path h5_ = folder_.path() / "trajectory.h5";
};

TEST_F(Report, ShownPointsAreWithinTheStatedErrorOfTheStoredOnes) {
  const TetMesh mesh = sample_mesh(6);
  const auto frames = growing(mesh, 4);
  write(mesh, frames);
  const ViewerData data = viewer();
  const Unpacked unpacked = unpack(data);
  const std::size_t n = data.meta["vertices"];
  EXPECT_LT(n, mesh.points.size());
  const double allowed = data.meta["position_error_mm"].get<double>() * 1.0001 + 1e-5;
  EXPECT_LT(allowed, 0.01);
  double worst = 0.0;
  for (std::size_t f = 0; f < frames.size(); ++f) {
    for (std::size_t i = 0; i < n; ++i) {
      double nearest = 1e9;
      for (std::size_t p = 0; p < mesh.points.size(); ++p) {
        double sum = 0.0;
        for (int k = 0; k < 3; ++k) {
          sum += std::pow(frames[f][3 * p + k] - unpacked.positions[f + 1][k * n + i], 2);
        }
        nearest = std::min(nearest, std::sqrt(sum));
      }
      worst = std::max(worst, nearest);
    }
  }
  EXPECT_LE(worst, allowed);
}

TEST_F(Report, SurfacesEncloseTheVolumesOfTheirTets) {
  const TetMesh mesh = sample_mesh(8);
  write(mesh, growing(mesh, 2));
  const ViewerData data = viewer();
  const Unpacked unpacked = unpack(data);
  const auto& labels = data.meta["labels"];
  ASSERT_EQ(labels.size(), 2u);
  ASSERT_EQ(data.meta["groups"].size(), 2u);  // outer surface, and the tumour inside
  EXPECT_EQ(data.meta["groups"][0]["labels"], Json({1}));
  EXPECT_EQ(data.meta["groups"][1]["labels"], Json({2, 1}));
  const std::size_t outer = data.meta["groups"][0]["triangles"];
  const std::size_t inner = data.meta["groups"][1]["triangles"];
  const double whole = labels[0]["rest_ml"].get<double>() + labels[1]["rest_ml"].get<double>();
  EXPECT_NEAR(enclosed_ml(unpacked, 0, outer, 0), whole, 1e-3 * whole);
  EXPECT_NEAR(enclosed_ml(unpacked, 3 * outer, inner, 0), labels[1]["rest_ml"].get<double>(),
              2e-3 * whole);
  EXPECT_NEAR(labels[0]["end_ml"].get<double>() / labels[0]["rest_ml"].get<double>(), 1.331, 1e-4);
}

TEST_F(Report, VolumeRatiosAreThoseOfTheMotion) {
  const TetMesh mesh = sample_mesh(4);
  write(mesh, growing(mesh, 3));
  const Unpacked unpacked = unpack(viewer());
  for (std::size_t f = 0; f < 3; ++f) {
    const double expected = std::pow(1.0 + 0.1 * static_cast<double>(f), 3);
    for (const double ratio : unpacked.ratios[f]) EXPECT_NEAR(ratio, expected, 0.005);
  }
}

TEST_F(Report, QualityIsOneForARegularTetAndThatOfTheWorstAround) {
  TetMesh mesh;
  mesh.points = {{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}, {3.0, 3.0, -3.0}};
  mesh.tets = {{0, 2, 1, 3}, {0, 1, 2, 4}};
  mesh.labels = {1, 1};
  mesh.label_names = {{1, "liver"}};
  write(mesh, {});
  const auto quality = unpack(viewer()).quality;
  EXPECT_NEAR(quality[3], 1.0, 0.005);
  EXPECT_LT(quality[4], 0.95);
  EXPECT_GT(quality[4], 0.2);
  EXPECT_EQ(quality[0], quality[4]);
}

TEST_F(Report, StressesAreThoseOfTheMotionWhereTheTissueIsKnown) {
  const TetMesh mesh = sample_mesh(4);
  const double mu = 2000.0, gamma = 0.2;
  std::vector<float> still, sheared;  // simple shear: no change of volume, one stress everywhere
  for (const auto& p : mesh.points) {
    for (const double x : p) still.push_back(static_cast<float>(x));
    for (const double x : {p[0] + gamma * p[1], p[1], p[2]}) {
      sheared.push_back(static_cast<float>(x));
    }
  }
  write(mesh, {still, sheared});
  const sim::Lame lame{.lambda = 9.0 * mu, .mu = mu};
  const Unpacked unpacked =
      unpack(viewer_data(TrajectoryReader(h5_), 9, "x", {{"liver", lame}, {"tumour", lame}}));
  ASSERT_EQ(unpacked.stresses.size(), 2u);
  const double kpa = 1e-3 * mu * std::sqrt(std::pow(gamma, 4) + 3.0 * gamma * gamma);
  for (const double stress : unpacked.stresses[0]) EXPECT_NEAR(stress, 0.0, 0.005 * kpa);
  for (const double stress : unpacked.stresses[1]) EXPECT_NEAR(stress, kpa, 0.005 * kpa);
  EXPECT_TRUE(
      unpack(viewer_data(TrajectoryReader(h5_), 9, "x", {{"liver", lame}})).stresses.empty());
}

TEST_F(Report, RigidMotionIsFoundAndTakenOut) {
  const TetMesh mesh = sample_mesh(4);
  std::vector<float> turned;  // a quarter turn about z, and a shift
  for (const auto& p : mesh.points) {
    turned.insert(turned.end(), {static_cast<float>(-p[1] + 7.0), static_cast<float>(p[0]),
                                 static_cast<float>(p[2] - 50.0)});
  }
  write(mesh, {turned});
  const std::vector<double> expected{0, -1, 0, 7, 1, 0, 0, 0, 0, 0, 1, -50};
  const auto rows = viewer().meta["rigid_motions"][0].get<std::vector<double>>();
  for (std::size_t i = 0; i < 12; ++i) EXPECT_NEAR(rows[i], expected[i], 1e-4);
}

TEST_F(Report, FramesAreChosenEvenlyWithFirstAndLast) {
  const TetMesh mesh = sample_mesh(2);
  write(mesh, growing(mesh, 11));
  const ViewerData data = viewer(5);
  EXPECT_EQ(data.meta["frames_total"], 11);
  const auto times = data.meta["times_s"].get<std::vector<double>>();
  ASSERT_EQ(times.size(), 5u);
  EXPECT_DOUBLE_EQ(times.front(), 0.0);
  EXPECT_DOUBLE_EQ(times.back(), 1.0);
}

TEST_F(Report, ATrajectoryWithoutFramesStillShowsTheRestShape) {
  const TetMesh mesh = sample_mesh(2);
  write(mesh, {});
  const Unpacked unpacked = unpack(viewer());
  EXPECT_EQ(unpacked.positions.size(), 1u);
  EXPECT_TRUE(unpacked.ratios.empty());
}

TEST_F(Report, EqualInputsGiveEqualPages) {
  const auto inputs = sample();
  const auto page = [&] {
    Json report = read_sources(inputs);
    const ViewerData data = viewer_data(TrajectoryReader(inputs.at("trajectory")), 9, "x");
    report["viewer"] = data.meta;
    return filled_page(web::report(), "t", report, data.packed, "");
  };
  EXPECT_EQ(page(), page());
}

TEST_F(Report, SourcesAreGatheredAndLinked) {
  const Json sources = read_sources(sample());
  EXPECT_EQ(sources["stages"].size(), 3u);
  EXPECT_EQ(sources["quality"]["measures"]["dihedral_min"]["min"], 12.31);
  EXPECT_EQ(sources["series"]["time_s"].size(), 12u);
  EXPECT_FALSE(sources["series"].contains("state_hash"));
  EXPECT_EQ(sources["series_last"]["state_hash"].get<std::string>().size(), 16u);
  EXPECT_EQ(sources["scene"]["effects"]["ground"]["clearance"], 0.05);
  ASSERT_EQ(sources["links"].size(), 2u);
  EXPECT_TRUE(sources["links"][0]["given"].get<bool>());
  EXPECT_EQ(verdict_of(sources), (Json{{"state", "passed"},
                                       {"gates_passed", 4},
                                       {"gates_failed", 0},
                                       {"caveats", Json::array()}}));
}

TEST_F(Report, FilesWithoutCompanionsAreReportedAsThatAndNoMore) {
  write_atomically(folder_.path() / "mesh.vtu", "x");
  const Json sources = read_sources({{"mesh", folder_.path() / "mesh.vtu"}});
  EXPECT_FALSE(sources["inputs"][0]["has_manifest"].get<bool>());
  EXPECT_TRUE(sources["quality"].is_null());
  EXPECT_EQ(verdict_of(sources)["state"], "ungated");
}

TEST_F(Report, ATimeCourseMayHoldValuesThatAreNotFinite) {
  write_atomically(folder_.path() / "trajectory.h5", "x");
  write_atomically(folder_.path() / "metrics.csv",
                   "frame,time_s,total_J\r\n0,0,nan\r\n1,0.5,2\r\n");
  const Json series = read_sources({{"trajectory", h5_}})["series"];
  EXPECT_TRUE(series["total_J"][0].is_null());
  EXPECT_EQ(series["time_s"], Json({0.0, 0.5}));
  EXPECT_EQ(series["total_J"][1], 2.0);
}

TEST_F(Report, AHashOfDecimalDigitsStaysAText) {
  write_atomically(folder_.path() / "trajectory.h5", "x");
  write_atomically(folder_.path() / "metrics.csv",
                   "frame,state_hash\n0,0123456789012345\n1,1234567890123456\n");
  const Json sources = read_sources({{"trajectory", h5_}});
  EXPECT_FALSE(sources["series"].contains("state_hash"));
  EXPECT_EQ(sources["series_last"]["state_hash"], "1234567890123456");
}

TEST_F(Report, DoesNotDependOnWhereTheFilesLie) {
  const std::string text = read_sources(sample()).dump();
  EXPECT_EQ(text.find(folder_.path().string()), std::string::npos);
  EXPECT_NE(text.find("labels.nrrd"), std::string::npos);
}

TEST_F(Report, AManifestOfAnotherFileIsRefused) {
  const auto inputs = sample();
  write_atomically(inputs.at("mesh"), "edited by hand");
  expect_refused(inputs, "mesh.vtu");
}

TEST_F(Report, DamagedCompanionsAreRefusedByName) {
  const auto inputs = sample();
  const fs::path manifest = folder_.path() / "labels" / "manifest.json";
  const std::string whole = read_file(manifest);
  for (const std::string text :
       {"{", "[]", "{\"schema\": 99}", "{\"schema\": 1}", "{\"schema\": \"one\"}"}) {
    write_atomically(manifest, text);
    expect_refused(inputs, manifest.string());
  }
  write_atomically(manifest, whole);
  const fs::path csv = folder_.path() / "simulate" / "metrics.csv";
  write_atomically(csv, "frame,time_s\n0,0\n");
  expect_refused(inputs, csv.string());  // not the file that the manifest names
  fs::remove(folder_.path() / "simulate" / "manifest.json");
  write_atomically(csv, "frame,time_s\n0,0\n1\n");
  expect_refused(inputs, "line 3");
}

TEST_F(Report, CompanionsOfAnotherTypeOrTooDeepAreRefusedByName) {
  const std::string deep = std::string(200000, '[') + std::string(200000, ']');
  for (const auto& [role, file, companion] : {std::array{"labels", "labels.nrrd", "labels.json"},
                                              {"mesh", "mesh.vtu", "quality.json"},
                                              {"trajectory", "trajectory.h5", "scene.json"}}) {
    write_atomically(folder_.path() / file, "x");
    for (const std::string& text : {std::string("[]"), std::string("3"), std::string("{"), deep}) {
      write_atomically(folder_.path() / companion, text);
      expect_refused({{role, folder_.path() / file}}, companion);
    }
  }
}

TEST_F(Report, NothingToReportOnIsAUsageError) {
  const Stage stage = report_stage();
  try {
    stage.check(StageRun(Json::object(), {}, {}));
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::usage);
  }
}

TEST_F(Report, TitlesAreEscapedAndDataCannotEndItsScript) {
  const std::string page =
      filled_page(web::report(), "<b>&\"liver\"", Json{{"name", "</script><script>"}}, "", "");
  EXPECT_NE(page.find("<title>&lt;b&gt;&amp;&quot;liver&quot;</title>"), std::string::npos);
  EXPECT_EQ(page.find("</script><script>"), std::string::npos);
  EXPECT_NE(page.find("\\u003c/script>\\u003cscript>"), std::string::npos);
}

}  // namespace
}  // namespace viscera
