// `make bench-mesh`: one body meshed by our way through its labels, by our way inside its surface,
// by make_mesh_3 with perturb and exude, and by gmsh's HXT, at about equal numbers of tets in one
// run. Each mesh is made by a process of its own, REPEATS times in turn with the others, and the
// least time counts; the table goes to stdout and a CSV.
//
//   bench_mesh VOLUME LABELS CSV REPEATS TETS...     LABELS as viscera-labels takes them
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

struct Method {
  const char* name;
  std::vector<std::string> settings;
  double density;  // tets in a volume of the cell size cubed, as measured on livers
};

// The last two are what CGAL and gmsh do by themselves: without our lattice and improver.
const std::vector<Method> methods = {
    {"ours, labels", {"route=fields"}, 6.3},
    {"ours, surface", {"route=surface"}, 6.3},
    {"make_mesh_3", {"route=surface", "lattice=0", "improve=cgal"}, 4.8},
    {"gmsh HXT", {"route=surface", "lattice=0", "mesher=hxt", "improve=none"}, 4.5}};
constexpr std::size_t reference = 2;  // whose time the others' is compared with

struct Column {
  const char* name;
  const char* format;
};

constexpr Column columns[] = {{"cell_size_mm", "{:.3g}"},
                              {"tets", "{:.0f}"},
                              {"meshing_s", "{:.3g}"},
                              {"time_ratio", "{:.2f}"},
                              {"wall_s", "{:.3g}"},
                              {"memory_mb", "{:.0f}"},
                              {"dihedral_min_deg", "{:.1f}"},
                              {"dihedral_p1_deg", "{:.1f}"},
                              {"dihedral_mean_deg", "{:.1f}"},
                              {"dihedral_max_deg", "{:.1f}"},
                              {"scaled_jacobian_min", "{:.3f}"},
                              {"condition_max", "{:.2f}"},
                              {"busiest_vertex", "{:.0f}"},
                              {"volume_error_pct", "{:+.3f}"},
                              {"to_surface_rms_h", "{:.3f}"},
                              {"to_surface_max_h", "{:.2f}"},
                              {"to_mesh_max_h", "{:.2f}"},
                              {"to_mesh_kept_max_h", "{:.2f}"},
                              {"lost_parts", "{:.0f}"},
                              {"smoothness", "{:.3f}"}};

class Bench {
 public:
  Bench(fs::path programs, fs::path csv, int repeats)
      : programs_(std::move(programs)),
        csv_(std::move(csv)),
        repeats_(repeats),
        work_(fs::temp_directory_path()) {}

  int run(const std::string& volume, const std::string& labels, const std::vector<double>& tets) {
    stage("labels", {"volume=" + volume}, {"labels=" + labels});
    stage("surface", {"labels=" + file("labels", "labels.nrrd")}, {});
    head();
    for (const double wanted : tets) rows(wanted);
    write_atomically(csv_, text_);
    return 0;
  }

 private:
  std::string file(const std::string& stage, const char* name) const {
    return (work_.path() / stage / name).string();
  }

  bool stage(const std::string& name, const std::vector<std::string>& inputs,
             const std::vector<std::string>& settings) const {
    std::vector<std::string> command{(programs_ / ("viscera-" + name)).string(), "--quiet"};
    for (const auto& input : inputs) command.insert(command.end(), {"--in", input});
    for (const auto& setting : settings) command.insert(command.end(), {"--set", setting});
    command.insert(command.end(), {"--out", (work_.path() / name).string()});
    const auto end = run_process(command, [](std::string_view line) { std::cerr << line << "\n"; });
    return end.exit_code == 0 || end.exit_code == 5;
  }

  void head() {
    text_ = "method";
    std::cout << fmt::format("{:14}", "method");
    for (const auto& column : columns) {
      text_ += fmt::format(",{}", column.name);
      std::cout << fmt::format(" {:>{}}", column.name, std::string_view(column.name).size());
    }
    text_ += "\n";
    std::cout << std::endl;
  }

  void rows(double wanted) {
    std::vector<std::vector<double>> table(methods.size());  // figures; empty where it failed
    for (int repeat = 0; repeat < repeats_; ++repeat)
      for (std::size_t m = 0; m < methods.size(); ++m) {
        if (!mesh(methods[m], wanted)) continue;
        auto figures = this->figures();
        if (!table[m].empty()) figures[time_] = std::min(figures[time_], table[m][time_]);
        table[m] = std::move(figures);
      }
    for (std::size_t m = 0; m < methods.size(); ++m) {
      if (!table[m].empty() && !table[reference].empty())
        table[m][time_ + 1] = table[m][time_] / table[reference][time_];
      print(methods[m].name, table[m]);
    }
  }

  bool mesh(const Method& method, double wanted) const {
    const Json surface = Json::parse(read_file(file("surface", "manifest.json")));
    double volume_mm3 = 0.0;  // of the body, or of its one label
    for (const auto& metric : surface["metrics"])
      if (metric["value"].is_object() && metric["value"].contains("ml"))
        volume_mm3 = std::max(volume_mm3, 1000.0 * metric["value"]["ml"].get<double>());
    auto settings = method.settings;
    settings.push_back(
        fmt::format("cell_size={:.4g}mm", std::cbrt(method.density * volume_mm3 / wanted)));
    return stage(
        "tetmesh",
        {"labels=" + file("labels", "labels.nrrd"), "surface=" + file("surface", "surface.vtp")},
        settings);
  }

  void print(const char* name, const std::vector<double>& values) {
    text_ += fmt::format("\"{}\"{}", name, values.empty() ? ",failed" : "");
    std::cout << fmt::format("{:14}{}", name, values.empty() ? " failed" : "");
    for (std::size_t c = 0; c < values.size(); ++c) {
      const auto shown = fmt::format(fmt::runtime(columns[c].format), values[c]);
      text_ += "," + shown;
      std::cout << fmt::format(" {:>{}}", shown, std::string_view(columns[c].name).size());
    }
    text_ += "\n";
    std::cout << std::endl;
  }

  // In the order of `columns`.
  std::vector<double> figures() const {
    const Json manifest = Json::parse(read_file(file("tetmesh", "manifest.json")));
    const Json q = Json::parse(read_file(file("tetmesh", "quality.json")));
    double meshing = 0.0;
    for (const auto& metric : manifest["metrics"])
      if (metric["name"] == "meshing") meshing = metric["value"];
    const double h = q["cell_size_mm"];
    const Json &angle = q["measures"]["dihedral_min"], &distance = q["distance"];
    return {h,
            q["tets"],
            meshing,
            0.0,
            manifest["wall_s"],
            manifest["max_rss_mb"],
            angle["min"],
            angle["percentiles"]["1"],
            angle["mean"],
            q["measures"]["dihedral_max"]["max"],
            q["measures"]["scaled_jacobian"]["min"],
            q["measures"]["condition"]["max"],
            q["topology"]["busiest"]["tets"],
            100.0 * q["volume"]["volume_error"].get<double>(),
            distance["to_surface"]["rms_mm"].get<double>() / h,
            distance["to_surface"]["max_mm"].get<double>() / h,
            distance["to_mesh"]["max_mm"].get<double>() / h,
            distance["to_mesh_kept"]["max_mm"].get<double>() / h,
            static_cast<double>(distance["lost"].size()),
            q["smoothness"]};
  }

  static constexpr std::size_t time_ = 2;  // column; the ratio comes after it
  fs::path programs_, csv_;
  int repeats_;
  TemporaryFolder work_;
  std::string text_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 6) {
    std::cerr << "bench_mesh VOLUME LABELS CSV REPEATS TETS...\n";
    return 2;
  }
  try {
    std::vector<double> tets;
    for (int i = 5; i < argc; ++i) tets.push_back(std::stod(argv[i]));
    const fs::path programs = fs::canonical("/proc/self/exe").parent_path();
    return Bench(programs, argv[3], std::stoi(argv[4])).run(argv[1], argv[2], tets);
  } catch (const std::exception& e) {
    std::cerr << "bench_mesh: " << e.what() << "\n";
    return 1;
  }
}
