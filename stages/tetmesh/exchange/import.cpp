#include "stages/tetmesh/exchange/import.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <set>

#include "pipeline/base/error.hpp"
#include "stages/mesh/tet_checks.hpp"
#include "stages/mesh/tet_topology.hpp"
#include "stages/mesh/vec.hpp"

namespace viscera {
namespace {

// A tet flatter than this share of the cube of its longest edge has no orientation of its own.
constexpr double flat = 1e-13;

using Tet = std::array<int, 4>;

double six_volumes(const TetMesh& mesh, const Tet& t) {
  const auto& p = mesh.points;
  return dot(sub(p[t[1]], p[t[0]]), cross(sub(p[t[2]], p[t[0]]), sub(p[t[3]], p[t[0]])));
}

void merge_points(TetMesh& mesh, Repairs& repairs) {
  std::vector<int> order(mesh.points.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return mesh.points[a] < mesh.points[b]; });
  std::vector<int> becomes(mesh.points.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool again = i > 0 && mesh.points[order[i]] == mesh.points[order[i - 1]];
    becomes[order[i]] = again ? becomes[order[i - 1]] : order[i];
    repairs.points_merged += again;
  }
  for (auto& tet : mesh.tets)
    for (int& corner : tet) corner = becomes[corner];
}

Tet sorted(Tet tet) {
  std::sort(tet.begin(), tet.end());
  return tet;
}

// Tets with a corner twice are triangles: their two other faces have become one, so what lies on
// both sides meets there. Of equal tets the first one stays.
void drop_collapsed_and_repeated(TetMesh& mesh, const std::string& file, Repairs& repairs) {
  std::vector<int> order;
  std::vector<bool> drop(mesh.tets.size());
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const Tet key = sorted(mesh.tets[t]);
    drop[t] = std::adjacent_find(key.begin(), key.end()) != key.end();
    repairs.tets_collapsed += drop[t];
    if (!drop[t]) order.push_back(static_cast<int>(t));
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return sorted(mesh.tets[a]) < sorted(mesh.tets[b]); });
  std::vector<int> contradicting;
  for (std::size_t i = 1; i < order.size(); ++i) {
    if (sorted(mesh.tets[order[i]]) != sorted(mesh.tets[order[i - 1]])) continue;
    if (mesh.labels[order[i]] != mesh.labels[order[i - 1]]) contradicting.push_back(order[i]);
    drop[order[i]] = true;
    ++repairs.duplicate_tets;
  }
  refuse_tets(mesh, contradicting, file, "tets stand twice, with different labels",
              "one label for each tet");
  if (order.empty()) {
    throw Error(ExitCode::bad_input,
                {.where = file,
                 .field = "tets",
                 .found = fmt::format("{} tets, each with a corner twice", repairs.tets_collapsed),
                 .allowed = "at least one tet of four points",
                 .remedy = "write the mesh again"});
  }
  keep_tets(mesh, [&](std::size_t t) { return !drop[t]; });
}

void orient(TetMesh& mesh, const std::string& file, Repairs& repairs) {
  std::vector<int> without_volume;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    auto& tet = mesh.tets[t];
    const double volume = six_volumes(mesh, tet);
    double longest = 0.0;
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < i; ++j)
        longest = std::max(longest, norm(sub(mesh.points[tet[i]], mesh.points[tet[j]])));
    if (!(std::abs(volume) > flat * longest * longest * longest)) {
      without_volume.push_back(static_cast<int>(t));
    } else if (volume < 0.0) {
      std::swap(tet[2], tet[3]);
      ++repairs.tets_turned;
    }
  }
  refuse_tets(mesh, without_volume, file, "tets without volume", "tets of positive volume");
}

// The next label above all that are in use, or where there is none the lowest that is free.
int free_label_of(const TetMesh& mesh, const std::string& file) {
  const std::set<int> used(mesh.labels.begin(), mesh.labels.end());
  int label = *used.rbegin() < max_label ? *used.rbegin() + 1 : 1;
  while (used.contains(label)) ++label;
  if (label <= max_label) return label;
  throw Error(ExitCode::bad_input, {.where = file,
                                    .field = "labels",
                                    .found = fmt::format("all labels from 0 to {}", max_label),
                                    .allowed = "one that is free, for label 0 is the outside",
                                    .remedy = "merge two labels"});
}

// Label 0 is the outside: its tets get a free label.
void relabel_zero(TetMesh& mesh, const std::string& file, Repairs& repairs) {
  if (std::ranges::count(mesh.labels, 0) == 0) {
    mesh.label_names.erase(0);
    return;
  }
  const int free_label = free_label_of(mesh, file);
  for (int& label : mesh.labels) {
    if (label != 0) continue;
    label = free_label;
    ++repairs.tets_relabelled;
  }
  const auto named = mesh.label_names.find(0);
  if (named == mesh.label_names.end()) return;
  mesh.label_names[free_label] = named->second;
  mesh.label_names.erase(0);
}

}  // namespace

Repairs repair(TetMesh& mesh, const std::string& file) {
  Repairs repairs;
  mesh.cell_data.clear();
  relabel_zero(mesh, file, repairs);
  merge_points(mesh, repairs);
  const std::size_t points = mesh.points.size() - repairs.points_merged;
  drop_collapsed_and_repeated(mesh, file, repairs);
  repairs.stray_points = points - mesh.points.size();
  orient(mesh, file, repairs);
  refuse_overlaps(mesh, find_faces(mesh), file);
  return repairs;
}

Imported import_mesh(const std::filesystem::path& path) {
  const auto extension = path.extension();
  if (extension != ".vtu" && extension != ".msh") {
    throw Error(ExitCode::bad_input, {.where = path.string(),
                                      .field = "--in mesh",
                                      .found = "a file of kind '" + extension.string() + "'",
                                      .allowed = ".vtu or .msh",
                                      .remedy = "convert it, for example with meshio"});
  }
  ForeignMesh read = extension == ".msh" ? read_foreign_msh(path) : read_foreign_vtu(path);
  Imported imported{.mesh = std::move(read.mesh), .labels_from = read.labels_from};
  imported.repairs = repair(imported.mesh, path.string());
  imported.repairs.cells_skipped = read.cells_skipped;
  return imported;
}

}  // namespace viscera
