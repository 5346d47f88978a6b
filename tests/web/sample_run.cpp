#include "tests/web/sample_run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "pipeline/contract/manifest.hpp"
#include "stages/trajectory/trajectory_io.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

constexpr std::array<double, 3> half_axes{100.0, 70.0, 60.0};  // mm
constexpr double fall = 50.0;                                  // mm
constexpr double frame_time = 0.02;                            // s

// A node of the cube [-1, 1]^3, moved along its ray so that the cube becomes a ball, then
// stretched.
std::array<double, 3> ellipsoid_point(const std::array<int, 3>& node, int cells) {
  std::array<double, 3> p{};
  double longest = 0.0;
  for (int k = 0; k < 3; ++k) {
    p[k] = 2.0 * node[k] / cells - 1.0;
    longest = std::max(longest, std::abs(p[k]));
  }
  const double length = std::hypot(p[0], p[1], p[2]);
  for (int k = 0; k < 3 && length > 0.0; ++k) p[k] *= half_axes[k] * longest / length;
  return p;
}

bool in_tumour(const std::array<double, 3>& p) {
  return std::hypot(p[0] - 35.0, p[1] + 15.0, p[2] - 8.0) < 24.0;
}

// A fall, then a damped oscillation of the height about a flattened shape.
struct Pose {
  double drop, height;
};

Pose pose_at(double t) {
  const double landing = std::sqrt(2.0 * fall / 9810.0);
  if (t < landing) return {4905.0 * t * t, 1.0};
  const double s = t - landing;
  return {fall, 0.85 - 0.2 * std::exp(-3.0 * s) * std::sin(14.0 * s) + 0.15 * std::exp(-8.0 * s)};
}

std::vector<float> positions_at(const TetMesh& mesh, double t) {
  const Pose pose = pose_at(t);
  const double across = 1.0 / std::sqrt(pose.height);
  std::vector<float> xyz;
  for (const auto& p : mesh.points) {
    const double bulge = 1.0 + 0.04 * (1.0 - pose.height) * std::sin(p[0] / 20.0);
    xyz.push_back(static_cast<float>(p[0] * across * bulge));
    xyz.push_back(static_cast<float>(p[1] * across * bulge));
    xyz.push_back(
        static_cast<float>((p[2] + half_axes[2]) * pose.height - half_axes[2] - pose.drop));
  }
  return xyz;
}

std::string metrics_csv(int frames) {
  std::string csv =
      "frame,time_s,kinetic_J,elastic_J,gravity_J,total_J,volume_ml,volume_ratio,min_J,inverted,"
      "max_speed_m_s,rms_speed_m_s,contacts,state_hash,force_ground_x_N,force_ground_y_N,"
      "force_ground_z_N,probe_tip_x_mm,probe_tip_y_mm,probe_tip_z_mm\n";
  for (int i = 0; i < frames; ++i) {
    const double t = i * frame_time, dt = 1e-4;
    const Pose a = pose_at(t), b = pose_at(t + dt);
    const double speed =
        1e-3 * (std::abs(b.drop - a.drop) + 60.0 * std::abs(b.height - a.height)) / dt;
    const double kinetic = 0.9 * speed * speed, elastic = 40.0 * std::pow(1.0 - a.height, 2);
    const double gravity = 17.0 * 1e-3 * (fall - a.drop + 60.0 * (a.height - 0.85));
    const double ratio = 1.0 - 0.02 * (1.0 - a.height);
    csv += fmt::format(
        "{},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},0,{:.6g},{:.6g},"
        "{},{:016x},{},30,20,{:.6g}\n",
        i, t, kinetic, elastic, gravity, kinetic + elastic + gravity, 1759.0 * ratio, ratio,
        1.0 - 1.5 * (1.0 - a.height), speed, 0.6 * speed,
        a.drop < fall ? 0 : static_cast<int>(900.0 * (1.2 - a.height)),
        0x9e3779b97f4a7c15ull * (i + 1u), i == 0 ? ",," : "3,4,12", 10.0 - a.drop);
  }
  return csv;
}

// One measure of quality.json, with a bell of counts around `mean`.
Json measure(const char* unit, double low, double high, double min, double mean, double max,
             int tets) {
  Json counts = Json::array();
  const double width = 0.3 * (max - min);
  for (int i = 0; i < 36; ++i) {
    const double x = low + (high - low) * (i + 0.5) / 36.0, z = (x - mean) / (0.5 * width);
    counts.push_back(static_cast<int>(0.08 * tets * std::exp(-0.5 * z * z)));
  }
  const Json worst = {
      {{"tet", 4711 % tets}, {"value", min}, {"label", 2}, {"at", {-12.5, 44.1, 8.25}}},
      {{"tet", 15}, {"value", 1.05 * min}, {"label", 1}, {"at", {61.0, -3.7, 20.5}}}};
  return {{"unit", unit},
          {"min", min},
          {"max", max},
          {"mean", mean},
          {"percentiles", {{"1", mean - width}, {"50", mean}, {"99", mean + width}}},
          {"histogram", {{"low", low}, {"high", high}, {"counts", counts}}},
          {"worst", worst}};
}

Json quality_json(int tets, const std::string& tumour) {
  const auto label = [](const std::string& name, int id, int count, double ml, double input_ml) {
    return Json{{"name", name},         {"id", id},
                {"tets", count},        {"ml", ml},
                {"input_ml", input_ml}, {"volume_error", ml / input_ml - 1.0}};
  };
  return {{"tets", tets},
          {"volume",
           {{"ml", 1759.1},
            {"labels",
             {label("liver", 1, tets - tets / 30, 1701.2, 1704.8),
              label(tumour, 2, tets / 30, 57.9, 58.4)}}}},
          {"lost",
           {{"ml", 2.5},
            {"share", 0.00142},
            {"farthest_mm", 4.25},
            {"cell_size_mm", 1.625},
            {"parts",
             {{{"at", {60.0, -20.0, 30.0}},
               {"depth_mm", 4.25},
               {"thickness_mm", 1.75},
               {"ml", 2.5},
               {"cell_size_mm", 1.625},
               {"detached_ml", 0.0}}}}}},
          {"measures",
           {{"dihedral_min", measure("deg", 0.0, 90.0, 12.31, 45.7, 69.9, tets)},
            {"radius_ratio", measure("1", 1.0, 10.0, 1.01, 1.6, 12.4, tets)},
            {"scaled_jacobian", measure("1", 0.0, 1.0, 0.083, 0.61, 0.98, tets)},
            {"volume", measure("mm3", 0.0, 90.0, 1.2, 30.8, 88.4, tets)}}}};
}

Manifest manifest_of(const char* stage) {
  Manifest m{.stage = stage, .version = "1", .params = Json::object()};
  m.started = "2026-01-02T03:04:05Z";
  m.libraries = {{"example", "1.2.3"}};
  return m;
}

// Digests the files already in `folder` and writes the manifest beside them.
void publish(const fs::path& folder, Manifest m, const std::vector<std::string>& files) {
  for (const auto& file : files) {
    m.outputs.push_back({file, sha256_file(folder / file), fs::file_size(folder / file)});
  }
  write_atomically(folder / "manifest.json", to_json(m).dump(1));
}

void write_labels(const fs::path& folder, const SampleRun& run) {
  const std::string& tumour = run.tumour_name;
  fs::create_directories(folder);
  write_atomically(folder / "labels.nrrd", "NRRD0004\n");
  const Json labels = {{{"name", "liver"},
                        {"id", 1},
                        {"ml", 1704.8},
                        {"components", 1},
                        {"borders", {{{"face", "superior"}, {"area_mm2", 41.0}}}}},
                       {{"name", tumour}, {"id", 2}, {"ml", 58.4}, {"components", 1}}};

  write_atomically(folder / "labels.json", Json{{"labels", labels}}.dump(1));
  Manifest m = manifest_of("labels");
  m.inputs.emplace("volume", FileDigest{"patient/segmentation.nii.gz", sha256("ct"), 481922});
  m.metrics = {{"labels", 2, "1"}, {"volume", 1763.2, "ml"}, {"spacing", {0.78, 0.78, 2.5}, "mm"}};
  if (!run.caveat.empty()) m.caveats = {run.caveat};
  m.wall_s = 2.31, m.cpu_s = 2.22, m.max_rss_mb = 412.0;
  publish(folder, m, {"labels.nrrd", "labels.json"});
}

void write_tetmesh(const fs::path& folder, const fs::path& labels, const TetMesh& mesh,
                   const SampleRun& run) {
  fs::create_directories(folder);
  write_atomically(folder / "mesh.vtu", "<VTKFile/>\n");
  const int tets = static_cast<int>(mesh.tets.size());
  write_atomically(folder / "quality.json", quality_json(tets, run.tumour_name).dump(1));
  Manifest m = manifest_of("tetmesh");
  m.inputs.emplace("labels", FileDigest{labels.string(), sha256_file(labels), 9});
  m.params = {{"cell_size", 5.0}, {"perturb", true}, {"label_sizes", nullptr}};
  m.param_units = {{"cell_size", "mm"}};
  m.metrics = {{"tets", tets, "1"},
               {"dihedral_min", Json{{"min", 12.31}, {"mean", 45.7}, {"max", 69.9}}, "deg"},
               {"topology",
                Json{{"inverted", 0},
                     {"components", 1},
                     {"mended", {{"islands", 0}, {"tets_removed", 3}}},
                     {"component_tets", {tets}}},
                "1"},
               {"hausdorff", 0.57, "mm"}};
  m.gates = {judged({"min_dihedral", ">=", "deg", "The mesh has slivers.", "set improve: own"},
                    12.31, run.gate_fails ? 15.0 : 10.0, {.at = {{-12.5, 44.1, 8.25}}}),
             judged({"volume_error", "<=", "percent", "It has another volume.", "lower cell_size"},
                    0.91, 1.0)};
  if (run.gate_fails) {
    m.exit = ExitCode::gate_failed;
    m.message = "gates failed: min_dihedral";
  }
  m.wall_s = 9.87, m.cpu_s = 9.7, m.max_rss_mb = 890.5;
  publish(folder, m, {"mesh.vtu", "quality.json"});
}

void write_simulation(const fs::path& folder, const fs::path& mesh_file, const TetMesh& mesh,
                      const SampleRun& run) {
  const int frames = run.frames;
  fs::create_directories(folder);
  TrajectoryWriter writer(folder, mesh);
  for (int i = 0; i < frames; ++i) {
    writer.append(i * frame_time, positions_at(mesh, i * frame_time));
  }
  writer.finish();
  write_atomically(folder / "metrics.csv", metrics_csv(frames));
  const Json liver = {{"E", 5000.0}, {"nu", 0.45}, {"density", 1060.0}, {"damping", 10.0}};
  const Json scene = {
      {"scene", 1},
      {"units", "SI"},
      {"materials", {{"liver", liver}, {"tumour", liver}}},
      {"effects",
       {{"neo_hookean", Json::object()},
        {"ground", {{"clearance", fall / 1000.0}, {"friction", 0.3}, {"normal", {0, 0, 1}}}}}},
      {"time", {{"frame", frame_time}, {"substeps", 64}, {"end", 2.5}}}};
  write_atomically(folder / "scene.json", scene.dump(1));
  Manifest m = manifest_of("simulate");
  m.inputs.emplace("mesh", FileDigest{mesh_file.string(), sha256_file(mesh_file), 11});
  m.params = {{"t_end", 2.5}, {"substeps", 64}, {"device", "auto"}, {"precision", "fp32"}};
  m.param_units = {{"t_end", "s"}};
  m.metrics = {{"rest_time_s", 0.7 * frame_time * frames, "s"},
               {"solver_error_bound", 0.0123, "1"},
               {"frames", frames, "1"},
               {"stability_Cs_max", 0.41, "1"},
               {"stability_kappa_max", 7.9, "1"},
               {"effects_on", {"neo_hookean", "gravity", "ground_contact", "friction"}, "1"},
               {"effects_off", {"attachment", "tearing", "self_contact"}, "1"}};
  if (run.certified) {
    const Json unknown = run.no_error_bar.empty() ? Json() : Json(run.no_error_bar);
    m.metrics.push_back({"error_bar_unknown", unknown, "1"});
  }
  if (run.certified && run.no_error_bar.empty()) {
    for (const auto& [name, mm] : {std::pair{"error_total", 0.5312},
                                   {"error_solver", 0.0213},
                                   {"error_element", 0.44},
                                   {"error_mesh", 0.0871},
                                   {"error_support", 0.0},
                                   {"error_surface", 0.0125}}) {
      m.metrics.push_back({name, mm, "mm"});
    }
    m.metrics.push_back({"error_total_share", 0.0104, "1"});
    m.metrics.push_back({"error_centroids", {{"liver", 0.42}, {"tumour", 0.5}}, "mm"});
  }
  m.gates = {
      judged({"max_volume_change", "<=", "percent", "It is compressible.", "raise nu"}, 0.7, 2),
      judged({"inverted_tets", "<=", "1", "Tets are inverted.", "raise substeps"}, 0, 0)};
  m.device = "cpu, 2 threads";
  m.wall_s = 78.4, m.cpu_s = 151.0, m.max_rss_mb = 236.0;
  publish(folder, m, {"trajectory.h5", "trajectory.xdmf", "metrics.csv", "scene.json"});
}

}  // namespace

TetMesh sample_mesh(int cells) {
  // Kuhn's six tets of the unit cube: the paths from corner 0 to corner 7, bit by axis.
  constexpr int paths[6][4] = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7},
                               {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};
  const int nodes = cells + 1;
  TetMesh mesh;
  for (int i = 0; i < nodes * nodes * nodes; ++i) {
    mesh.points.push_back(
        ellipsoid_point({i % nodes, i / nodes % nodes, i / nodes / nodes}, cells));
  }
  for (int i = 0; i < cells * cells * cells; ++i) {
    const int x = i % cells, y = i / cells % cells, z = i / cells / cells;
    for (const auto& path : paths) {
      std::array<int, 4> tet{};
      for (int c = 0; c < 4; ++c) {
        tet[c] =
            x + (path[c] & 1) + nodes * (y + (path[c] >> 1 & 1) + nodes * (z + (path[c] >> 2)));
      }
      mesh.tets.push_back(tet);
      mesh.labels.push_back(in_tumour(mesh.points[tet[0]]) ? 2 : 1);
    }
  }
  mesh.label_names = {{1, "liver"}, {2, "tumour"}};
  return mesh;
}

void write_sample_run(const fs::path& folder, const SampleRun& run) {
  TetMesh mesh = sample_mesh(run.cells);
  mesh.label_names[2] = run.tumour_name;
  write_labels(folder / "labels", run);
  write_tetmesh(folder / "tetmesh", folder / "labels" / "labels.nrrd", mesh, run);
  write_simulation(folder / "simulate", folder / "tetmesh" / "mesh.vtu", mesh, run);
}

}  // namespace viscera
