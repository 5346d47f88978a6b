#include "tests/geometry/shapes.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/log.hpp"
#include "stages/mesh/vec.hpp"

namespace viscera::testing {

LabelImage nested_balls(double outer, double inner) {
  LabelImage image = draw(48, {1.1, 1.0, 1.25}, [=](double x, double y, double z) {
    if (std::hypot(x - 4.0, y + 3.0, z) < inner) return 2;
    return std::hypot(x, y, z) < outer ? 1 : 0;
  });
  image.names = {{1, "liver"}, {2, "tumour"}};
  return image;
}

LabelImage ball_with_lump() {
  LabelImage image = draw(48, {1.1, 1.0, 1.25}, [](double x, double y, double z) {
    if (!(std::hypot(x, y, z) < 18.0)) return 0;
    return std::hypot(x - 12.0, y + 8.0, z - 6.0) < 8.0 ? 2 : 1;
  });
  image.names = {{1, "liver"}, {2, "tumour"}};
  return image;
}

TetMesh shaken_cube(int n, double shake, unsigned seed) {
  TetMesh mesh;
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> move(-shake / n, shake / n);
  const auto index = [n](int x, int y, int z) { return (z * (n + 1) + y) * (n + 1) + x; };
  for (int z = 0; z <= n; ++z)
    for (int y = 0; y <= n; ++y)
      for (int x = 0; x <= n; ++x) {
        std::array<double, 3> p{double(x) / n, double(y) / n, double(z) / n};
        const int at[3] = {x, y, z};
        const bool inner = x > 0 && x < n && y > 0 && y < n && z > 0 && z < n;
        for (int a = 0; a < 3; ++a) {
          const double by = move(random);
          if (inner && !(a == 2 && 2 * at[2] == n)) p[a] += by;
        }
        mesh.points.push_back(p);
      }
  constexpr int orders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}};
  for (int z = 0; z < n; ++z)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x)
        for (int o = 0; o < 6; ++o) {
          std::array<int, 3> at{x, y, z};
          std::array<int, 4> tet{index(x, y, z), 0, 0, 0};
          for (int step = 0; step < 3; ++step) {
            ++at[orders[o][step]];
            tet[step + 1] = index(at[0], at[1], at[2]);
          }
          if (o >= 3) std::swap(tet[2], tet[3]);
          mesh.tets.push_back(tet);
          mesh.labels.push_back(2 * z < n ? 1 : 2);
        }
  return mesh;
}

namespace {

// An octahedron whose triangles are cut in four and blown up to the unit sphere `rounds` times.
SurfaceMesh unit_sphere(int rounds) {
  SurfaceMesh ball{
      .points = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}},
      .triangles = {
          {0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}}};
  for (int round = 0; round < rounds; ++round) {
    std::map<std::array<int, 2>, int> middles;
    const auto middle = [&](int a, int b) {
      const auto [entry, fresh] = middles.try_emplace({std::min(a, b), std::max(a, b)},
                                                      static_cast<int>(ball.points.size()));
      if (fresh) {
        const auto &p = ball.points[a], &q = ball.points[b];
        ball.points.push_back({p[0] + q[0], p[1] + q[1], p[2] + q[2]});
        auto& m = ball.points.back();
        const double length = std::hypot(m[0], m[1], m[2]);
        for (double& x : m) x /= length;
      }
      return entry->second;
    };
    std::vector<std::array<int, 3>> finer;
    for (const auto& t : ball.triangles) {
      const int ab = middle(t[0], t[1]), bc = middle(t[1], t[2]), ca = middle(t[2], t[0]);
      finer.insert(finer.end(), {{t[0], ab, ca}, {t[1], bc, ab}, {t[2], ca, bc}, {ab, bc, ca}});
    }
    ball.triangles = finer;
  }
  return ball;
}

}  // namespace

TetMesh ball_around_a_point(bool first, double middle) {
  const SurfaceMesh shell = unit_sphere(2);
  TetMesh mesh{.points = shell.points};
  const int centre = first ? 0 : static_cast<int>(mesh.points.size());
  mesh.points.insert(mesh.points.begin() + centre, {0, 0, 0});
  for (const auto& [a, b, c] : shell.triangles)
    mesh.tets.push_back({a + first, b + first, c + first, centre});
  for (auto& tet : mesh.tets) {
    const auto& [a, b, c, d] = tet;
    const auto& p = mesh.points;
    if (dot(sub(p[b], p[a]), cross(sub(p[c], p[a]), sub(p[d], p[a]))) < 0.0)
      std::swap(tet[0], tet[1]);
    const double z = mesh.points[a][2] + mesh.points[b][2] + mesh.points[c][2];
    mesh.labels.push_back(0.25 * z > middle ? 2 : 1);
  }
  return mesh;
}

SurfaceMesh ball_surface(double radius) {
  SurfaceMesh ball = unit_sphere(4);
  ball.label_names = {{3, "kidney"}};
  for (auto& p : ball.points)
    for (double& x : p) x *= radius;
  ball.labels.assign(ball.triangles.size(), 3);
  return ball;
}

Outcome run_stage(const Stage& stage, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), stage.info.name);
  std::vector<char*> argv;
  for (auto& argument : arguments) argv.push_back(argument.data());
  ::testing::internal::CaptureStderr();
  ::testing::internal::CaptureStdout();
  const int code = stage_main(static_cast<int>(argv.size()), argv.data(), stage);
  ::testing::internal::GetCapturedStdout();
  return {code, ::testing::internal::GetCapturedStderr()};
}

Json read_json(const std::filesystem::path& path) {
  return Json::parse(read_file(path));
}

Json metric(const std::filesystem::path& folder, const std::string& name) {
  const Json manifest = read_json(folder / "manifest.json");
  for (const auto& entry : manifest.at("metrics"))
    if (entry.at("name") == name) return entry.at("value");
  return nullptr;
}

std::vector<std::string> files_in(const std::filesystem::path& folder) {
  std::vector<std::string> names;
  if (!std::filesystem::exists(folder)) return names;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace viscera::testing
