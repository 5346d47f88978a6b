// `make bench-surface`: the surface of every label of some volumes against the goals that surfaces
// have, and the phantom in 25 million voxels for time and memory. Each surface is made twice, on
// all cores and on one. One row per label goes to a CSV, the goals to stdout.
//
//   bench_surface CSV VOLUME...
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/param.hpp"
#include "pipeline/engine/programs/process.hpp"

namespace {

using namespace viscera;
using namespace viscera::engine;
namespace fs = std::filesystem;

struct Row {
  std::string volume, label;
  bool cut = false;  // by the border of the volume
  double ml = 0.0, error = 0.0;
  double triangles = 0.0, defects = 0.0;
  double to_voxels = 0.0, to_surface = 0.0, farthest = 0.0;  // in voxels
  double lost = 0.0;
};

class Bench {
 public:
  Bench(fs::path programs, fs::path csv)
      : programs_(std::move(programs)), csv_(std::move(csv)), work_(fs::temp_directory_path()) {}

  int run(const std::vector<std::string>& volumes) {
    for (const auto& volume : volumes) measure(volume);
    const std::string large = (work_.path() / "phantom_25M.nrrd").string();
    if (!command({(programs_ / "make-phantom").string(), large, "3"})) return 1;
    measure(large);
    write_csv();
    print_goals();
    return 0;
  }

 private:
  static bool command(const std::vector<std::string>& words) {
    const auto end = run_process(words, [](std::string_view line) { std::cerr << line << "\n"; });
    return end.signal == 0 && (end.exit_code == 0 || end.exit_code == 5);
  }
  fs::path out(const char* name) const { return work_.path() / name; }

  void measure(const std::string& volume) {
    const std::string labels = (programs_ / "viscera-labels").string();
    const std::string surface = (programs_ / "viscera-surface").string();
    const std::string input = "labels=" + (out("labels") / "labels.nrrd").string();
    const bool made =
        command({labels, "--quiet", "--in", "volume=" + volume, "--set", "keep=all", "--set",
                 "border=accept", "--out", out("labels").string()}) &&
        command({surface, "--quiet", "--in", input, "--out", out("surface").string()}) &&
        command({"/usr/bin/taskset", "-c", "0", surface, "--quiet", "--in", input, "--out",
                 out("alone").string()});
    if (!made) {
      failed_.push_back(volume);
      return;
    }
    equal_ &= read_file(out("surface") / "surface.vtp") == read_file(out("alone") / "surface.vtp");
    const Json listed = Json::parse(read_file(out("labels") / "labels.json"));
    const Json manifest = Json::parse(read_file(out("surface") / "manifest.json"));
    seconds_ = manifest["wall_s"];
    memory_mb_ = manifest["max_rss_mb"];
    double voxel = 0.0;
    for (const double spacing : listed["frame"]["spacing_mm"]) voxel = std::max(voxel, spacing);
    bool any_cut = false;
    for (const auto& label : listed["labels"]) any_cut |= !label["borders"].empty();
    for (const auto& metric : manifest["metrics"]) {
      const Json& m = metric["value"];
      if (!m.is_object() || !m.contains("voxel_ml")) continue;
      Row row{.volume = fs::path(volume).filename().string(), .label = metric["name"]};
      for (const auto& label : listed["labels"])
        if (label["name"] == metric["name"]) row.cut = !label["borders"].empty();
      if (m["id"] == 0) row.cut = any_cut;
      row.ml = m["voxel_ml"];
      row.error = 100.0 * m["volume_error"].get<double>();
      row.triangles = m["triangles"];
      for (const char* defect : {"open_edges", "non_manifold_edges", "misoriented_edges",
                                 "degenerate_triangles", "self_intersections"})
        row.defects += m[defect].get<double>();
      row.to_voxels = m["surface_to_voxels"]["rms_mm"].get<double>() / voxel;
      row.to_surface = m["voxels_to_surface"]["rms_mm"].get<double>() / voxel;
      row.farthest = m["voxels_to_surface"]["max_mm"].get<double>() / voxel;
      row.lost = m["lost"]["parts"];
      rows_.push_back(row);
    }
  }

  void write_csv() const {
    std::string text =
        "volume,label,cut,ml,triangles,volume_error_pct,defects,surface_to_voxels_rms_voxel,"
        "voxels_to_surface_rms_voxel,voxels_to_surface_max_voxel,lost_parts\n";
    for (const auto& r : rows_) {
      text += fmt::format("{},{},{:d},{:.2f},{:.0f},{:+.5f},{:.0f},{:.3f},{:.3f},{:.2f},{:.0f}\n",
                          r.volume, r.label, r.cut, r.ml, r.triangles, r.error, r.defects,
                          r.to_voxels, r.to_surface, r.farthest, r.lost);
    }
    write_atomically(csv_, text);
  }

  // The largest of a figure over the labels that `counts`, and whose it is.
  template <class Counts, class Figure>
  void goal(const char* name, double limit, const char* unit, Counts counts, Figure figure) const {
    const Row* worst = nullptr;
    int labels = 0, missed = 0;
    for (const auto& row : rows_) {
      if (!counts(row)) continue;
      ++labels;
      missed += figure(row) > limit;
      if (worst == nullptr || figure(row) > figure(*worst)) worst = &row;
    }
    if (worst == nullptr) return;
    line(name, limit, figure(*worst), unit, missed == 0,
         fmt::format("{} of {} labels; {} of {}", labels - missed, labels, worst->label,
                     worst->volume));
  }

  static void line(const char* name, double limit, double figure, const char* unit, bool met,
                   const std::string& remark) {
    std::cout << fmt::format("{:52} {:>8.3g} {:>10.4g} {:6} {:7} {}", name, limit, figure, unit,
                             met ? "met" : "MISSED", remark)
              << "\n";
  }

  void print_goals() const {
    std::cout << fmt::format("{:52} {:>8} {:>10} {:6}\n",
                             "goal (labels that the border cuts apart)", "limit", "worst", "unit");
    const auto whole = [](const Row& r) { return !r.cut; };
    goal(
        "volume against voxels, over 5 ml", 0.02, "%", [](const Row& r) { return r.ml > 5.0; },
        [](const Row& r) { return std::abs(r.error); });
    goal(
        "volume against voxels, under", 0.2, "%", [](const Row& r) { return r.ml <= 5.0; },
        [](const Row& r) { return std::abs(r.error); });
    goal(
        "open, non-manifold, degenerate, self-intersecting", 0.0, "",
        [](const Row&) { return true; }, [](const Row& r) { return r.defects; });
    goal("surface to voxel boundary, rms", 0.45, "voxel", whole,
         [](const Row& r) { return r.to_voxels; });
    goal("voxel boundary to surface (with lost parts), rms", 0.45, "voxel", whole,
         [](const Row& r) { return r.to_surface; });
    line("25 million voxels, 3 labels and the body: time", 8.0, seconds_, "s", seconds_ <= 8.0, "");
    line("25 million voxels, 3 labels and the body: memory", 700.0, memory_mb_, "MB",
         memory_mb_ <= 700.0, "");
    line("bits that differ between all cores and one", 0.0, equal_ ? 0.0 : 1.0, "", equal_, "");
    for (const auto& volume : failed_) std::cout << "failed: " << volume << "\n";
  }

  fs::path programs_, csv_;
  TemporaryFolder work_;
  std::vector<Row> rows_;
  std::vector<std::string> failed_;
  bool equal_ = true;
  double seconds_ = 0.0, memory_mb_ = 0.0;  // of the last volume
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::cerr << "bench_surface CSV VOLUME...\n";
    return 2;
  }
  try {
    const fs::path programs = fs::canonical("/proc/self/exe").parent_path();
    return Bench(programs, argv[1]).run({argv + 2, argv + argc});
  } catch (const std::exception& e) {
    std::cerr << "bench_surface: " << e.what() << "\n";
    return 1;
  }
}
