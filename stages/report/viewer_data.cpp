#include "stages/report/viewer_data.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "sim/base/tet_face.hpp"
#include "stages/report/packed.hpp"

namespace viscera {
namespace {

using Triangle = std::array<int, 3>;
using Groups = std::map<std::vector<int>, std::vector<Triangle>>;  // by labels

constexpr double mm3_per_ml = 1000.0;

double tet_volume(const std::array<int, 4>& tet, const double* xyz) {
  double e[3][3];
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) e[i][k] = xyz[3 * tet[i + 1] + k] - xyz[3 * tet[0] + k];
  }
  return (e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
          e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
          e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0])) /
         6.0;
}

std::vector<double> tet_volumes(const TetMesh& mesh, const double* xyz) {
  std::vector<double> volumes;
  volumes.reserve(mesh.tets.size());
  for (const auto& tet : mesh.tets) volumes.push_back(tet_volume(tet, xyz));
  return volumes;
}

std::map<int, double> label_volumes_ml(const TetMesh& mesh, const std::vector<double>& volumes) {
  std::map<int, double> total;
  for (std::size_t i = 0; i < volumes.size(); ++i) total[mesh.labels[i]] += volumes[i] / mm3_per_ml;
  return total;
}

struct Face {
  std::array<int, 3> key;  // sorted
  Triangle outward;
  int label;
};

std::vector<Face> sorted_faces(const TetMesh& mesh) {
  std::vector<Face> faces;
  faces.reserve(4 * mesh.tets.size());
  for (std::size_t i = 0; i < mesh.tets.size(); ++i) {
    for (int k = 0; k < 4; ++k) {
      const Triangle outward = sim::face_of_tet(mesh.tets[i], k);
      Triangle key = outward;
      std::sort(key.begin(), key.end());
      faces.push_back({key, outward, mesh.labels[i]});
    }
  }
  std::stable_sort(faces.begin(), faces.end(),
                   [](const Face& a, const Face& b) { return a.key < b.key; });
  return faces;
}

// The faces that one tet has (outer surface) and those between tets of two labels (interface).
Groups visible_faces(const TetMesh& mesh, const std::map<int, double>& volume_of) {
  const auto faces = sorted_faces(mesh);
  const auto smaller = [&volume_of](const Face& a, const Face& b) {
    return std::pair(volume_of.at(a.label), a.label) < std::pair(volume_of.at(b.label), b.label);
  };
  Groups groups;
  for (std::size_t i = 0; i < faces.size(); ++i) {
    const bool shared = i + 1 < faces.size() && faces[i].key == faces[i + 1].key;
    if (!shared) {
      groups[{faces[i].label}].push_back(faces[i].outward);
      continue;
    }
    const Face &a = faces[i], &b = faces[i + 1];
    if (a.label != b.label) {
      const bool a_first = smaller(a, b);
      const Face &inner = a_first ? a : b, &outer = a_first ? b : a;
      groups[{inner.label, outer.label}].push_back(inner.outward);
    }
    ++i;
  }
  return groups;
}

// Renumbers the triangles to the points they use; returns those points in mesh order.
std::vector<int> compact(Groups& groups, std::size_t points) {
  std::vector<int> number(points, -1), used;
  for (const auto& [labels, triangles] : groups) {
    for (const auto& t : triangles) {
      for (const int p : t) number[p] = 0;
    }
  }
  for (std::size_t p = 0; p < points; ++p) {
    if (number[p] < 0) continue;
    number[p] = static_cast<int>(used.size());
    used.push_back(static_cast<int>(p));
  }
  for (auto& [labels, triangles] : groups) {
    for (auto& t : triangles) {
      for (int& p : t) p = number[p];
    }
  }
  return used;
}

std::vector<std::size_t> chosen_frames(std::size_t total, std::size_t most) {
  const std::size_t count = std::min(total, most);
  std::vector<std::size_t> frames;
  for (std::size_t i = 0; i < count; ++i) {
    frames.push_back(count == 1 ? total - 1 : i * (total - 1) / (count - 1));
  }
  return frames;
}

// Volume of the tets around each used point over the same at rest.
std::vector<float> ratios_around(const TetMesh& mesh, const std::vector<int>& used,
                                 const std::vector<double>& rest, const std::vector<double>& now) {
  std::vector<double> before(mesh.points.size()), after(mesh.points.size());
  for (std::size_t i = 0; i < mesh.tets.size(); ++i) {
    for (const int p : mesh.tets[i]) {
      before[p] += rest[i];
      after[p] += now[i];
    }
  }
  std::vector<float> ratios;
  ratios.reserve(used.size());
  for (const int p : used) {
    ratios.push_back(before[p] > 0.0 ? static_cast<float>(after[p] / before[p]) : 1.0f);
  }
  return ratios;
}

// Mean of the tets around each used point, by their volume at rest.
std::vector<float> mean_around(const TetMesh& mesh, const std::vector<int>& used,
                               const std::vector<double>& rest, const std::vector<double>& of_tet) {
  std::vector<double> sum(mesh.points.size()), volume(mesh.points.size());
  for (std::size_t i = 0; i < mesh.tets.size(); ++i) {
    for (const int p : mesh.tets[i]) {
      sum[p] += rest[i] * of_tet[i];
      volume[p] += rest[i];
    }
  }
  std::vector<float> means;
  means.reserve(used.size());
  for (const int p : used) {
    means.push_back(volume[p] > 0.0 ? static_cast<float>(sum[p] / volume[p]) : 0.0f);
  }
  return means;
}

// 12 (3 V)^(2/3) / sum l^2 over the edges: 1 for a regular tet (Liu and Joe, BIT 34, 1994).
double mean_ratio(const TetMesh& mesh, const std::array<int, 4>& tet, double volume) {
  double squares = 0.0;
  for (int a = 0; a < 4; ++a) {
    for (int b = 0; b < a; ++b) {
      for (int k = 0; k < 3; ++k) {
        const double edge = mesh.points[tet[a]][k] - mesh.points[tet[b]][k];
        squares += edge * edge;
      }
    }
  }
  return 12.0 * std::cbrt(9.0 * volume * volume) / squares;
}

std::vector<float> min_quality_around(const TetMesh& mesh, const std::vector<int>& used) {
  const auto volumes = tet_volumes(mesh, mesh.points[0].data());
  std::vector<double> least(mesh.points.size(), 1.0);
  for (std::size_t i = 0; i < mesh.tets.size(); ++i) {
    const double quality = mean_ratio(mesh, mesh.tets[i], std::max(volumes[i], 0.0));
    for (const int p : mesh.tets[i]) least[p] = std::min(least[p], quality);
  }
  std::vector<float> kept;
  kept.reserve(used.size());
  for (const int p : used) kept.push_back(static_cast<float>(least[p]));
  return kept;
}

struct Box {
  std::array<double, 3> lo, step;
};

Box box_of(const std::vector<std::vector<float>>& frames) {
  Box box{};
  for (int axis = 0; axis < 3; ++axis) {
    double lo = frames[0][axis], hi = lo;
    for (const auto& frame : frames) {
      for (std::size_t i = axis; i < frame.size(); i += 3) {
        lo = std::min<double>(lo, frame[i]);
        hi = std::max<double>(hi, frame[i]);
      }
    }
    box.lo[axis] = lo;
    box.step[axis] = (hi - lo) / 65535.0;
  }
  return box;
}

void pack_triangles(const Groups& groups, std::string& bytes) {
  for (const auto& [labels, triangles] : groups) {
    for (const auto& t : triangles) {
      for (const int p : t) {
        for (int shift = 0; shift < 32; shift += 8) bytes += static_cast<char>(p >> shift & 0xff);
      }
    }
  }
}

void pack_positions(const std::vector<std::vector<float>>& frames, const Box& box,
                    std::string& bytes) {
  std::vector<int> before(frames[0].size(), 0);
  for (const auto& frame : frames) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      std::string low, high;
      for (std::size_t i = axis; i < frame.size(); i += 3) {
        const double step = box.step[axis];
        const int q =
            step > 0.0 ? static_cast<int>(std::lround((frame[i] - box.lo[axis]) / step)) : 0;
        const auto delta = static_cast<std::int16_t>(static_cast<std::uint16_t>(q - before[i]));
        const auto zigzag = static_cast<std::uint16_t>((delta << 1) ^ (delta >> 15));
        low += static_cast<char>(zigzag & 0xff);
        high += static_cast<char>(zigzag >> 8);
        before[i] = q;
      }
      bytes += low + high;
    }
  }
}

// How far from `middle` 99 % of the values lie, so that one bad element does not wash out the
// colours.
double range_around(double middle, const std::vector<std::vector<float>>& frames, double least) {
  std::vector<double> off;
  for (const auto& frame : frames) {
    for (const float value : frame) off.push_back(std::abs(static_cast<double>(value) - middle));
  }
  if (off.empty()) return 10.0 * least;
  const auto p99 = off.begin() + static_cast<std::ptrdiff_t>(0.99 * double(off.size() - 1));
  std::nth_element(off.begin(), p99, off.end());
  return std::max(*p99, least);
}

// `part` of a value: 0 to 1.
template <class Part>
void pack_values(const std::vector<std::vector<float>>& frames, Part&& part, std::string& bytes) {
  if (frames.empty()) return;
  std::vector<int> before(frames[0].size(), 0);
  for (const auto& frame : frames) {
    for (std::size_t i = 0; i < frame.size(); ++i) {
      const int q = static_cast<int>(std::lround(254.0 * std::clamp(part(frame[i]), 0.0, 1.0)));
      bytes += static_cast<char>((q - before[i]) & 0xff);
      before[i] = q;
    }
  }
}

// Rotation and translation that bring the rest points nearest to the frame's (Umeyama 1991).
std::array<double, 12> rigid_motion(const TetMesh& mesh, const std::vector<double>& xyz) {
  using Points = Eigen::Map<const Eigen::Matrix3Xd>;
  const auto n = static_cast<Eigen::Index>(mesh.points.size());
  const Eigen::Matrix4d motion =
      Eigen::umeyama(Points(mesh.points[0].data(), 3, n), Points(xyz.data(), 3, n), false);
  std::array<double, 12> rows{};
  for (int i = 0; i < 12; ++i) rows[i] = motion(i / 4, i % 4);
  return rows;
}

struct Frames {
  std::vector<std::vector<float>> positions;  // rest first
  std::vector<std::vector<float>> ratios;
  std::vector<std::vector<float>> stresses;     // kPa; none: not known
  std::vector<std::map<int, double>> label_ml;  // rest first
  std::vector<std::array<double, 12>> rigid_motions;
};

Frames collect(const TrajectoryReader& trajectory, const std::vector<int>& used,
               const std::vector<std::size_t>& chosen, const std::optional<VonMises>& stress) {
  const TetMesh& mesh = trajectory.mesh();
  Frames frames;
  const auto keep = [&](const double* xyz) {
    std::vector<float> kept;
    kept.reserve(3 * used.size());
    for (const int p : used) {
      for (int k = 0; k < 3; ++k) kept.push_back(static_cast<float>(xyz[3 * p + k]));
    }
    frames.positions.push_back(std::move(kept));
  };
  const auto rest = tet_volumes(mesh, mesh.points[0].data());
  keep(mesh.points[0].data());
  frames.label_ml.push_back(label_volumes_ml(mesh, rest));
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    const auto stored = trajectory.positions_mm(chosen[i]);
    const std::vector<double> xyz(stored.begin(), stored.end());
    const auto now = tet_volumes(mesh, xyz.data());
    keep(xyz.data());
    frames.rigid_motions.push_back(rigid_motion(mesh, xyz));
    frames.ratios.push_back(ratios_around(mesh, used, rest, now));
    if (stress) frames.stresses.push_back(mean_around(mesh, used, rest, (*stress)(xyz)));
    frames.label_ml.push_back(label_volumes_ml(mesh, now));
    log::progress("frames", static_cast<double>(i + 1) / static_cast<double>(chosen.size()));
  }
  return frames;
}

Json labels_json(const TetMesh& mesh, const std::vector<std::map<int, double>>& label_ml) {
  std::map<int, std::size_t> tets;
  for (const int label : mesh.labels) ++tets[label];
  Json labels = Json::array();
  for (const auto& [id, count] : tets) {
    double least = label_ml[0].at(id);
    for (const auto& frame : label_ml) least = std::min(least, frame.at(id));
    const auto name = mesh.label_names.find(id);
    labels.push_back(
        {{"id", id},
         {"name", name == mesh.label_names.end() ? fmt::format("label {}", id) : name->second},
         {"tets", count},
         {"rest_ml", label_ml[0].at(id)},
         {"end_ml", label_ml.back().at(id)},
         {"least_ml", least}});
  }
  return labels;
}

}  // namespace

ViewerData viewer_data(const TrajectoryReader& trajectory, std::size_t max_frames,
                       const std::string& where, const Tissue& tissue) {
  const TetMesh& mesh = trajectory.mesh();
  if (mesh.tets.empty()) {
    throw Error(ExitCode::bad_input, {.where = where,
                                      .field = "/tets",
                                      .found = "no tets",
                                      .allowed = "at least one tet",
                                      .remedy = "write the trajectory again"});
  }
  const auto rest_ml = label_volumes_ml(mesh, tet_volumes(mesh, mesh.points[0].data()));
  Groups groups = visible_faces(mesh, rest_ml);
  const auto used = compact(groups, mesh.points.size());
  const auto chosen = chosen_frames(trajectory.times_s().size(), max_frames);
  std::optional<VonMises> stress;
  const bool known = std::ranges::all_of(mesh.labels, [&](int label) {
    const auto name = mesh.label_names.find(label);
    return name != mesh.label_names.end() && tissue.contains(name->second);
  });
  if (known) stress.emplace(mesh, tissue);
  const Frames frames = collect(trajectory, used, chosen, stress);
  const Box box = box_of(frames.positions);
  const double range = range_around(1.0, frames.ratios, 0.001);
  const double stress_range = range_around(0.0, frames.stresses, 0.001);

  std::string bytes;
  pack_triangles(groups, bytes);
  pack_positions(frames.positions, box, bytes);
  pack_values(
      frames.ratios, [&](double r) { return 0.5 + 0.5 * (r - 1.0) / range; }, bytes);
  pack_values(
      frames.stresses, [&](double kpa) { return kpa / stress_range; }, bytes);
  pack_values(
      {min_quality_around(mesh, used)}, [](double quality) { return quality; }, bytes);

  Json meta{{"vertices", used.size()}, {"points", mesh.points.size()}, {"tets", mesh.tets.size()}};
  meta["times_s"] = Json::array();
  for (const std::size_t f : chosen) meta["times_s"].push_back(trajectory.times_s()[f]);
  meta["frames_total"] = trajectory.times_s().size();
  meta["box_lo_mm"] = box.lo;
  meta["step_mm"] = box.step;
  meta["position_error_mm"] = 0.5 * std::hypot(box.step[0], box.step[1], box.step[2]);
  meta["ratio_range"] = range;
  meta["stress_range_kPa"] = frames.stresses.empty() ? Json(nullptr) : Json(stress_range);
  meta["rigid_motions"] = frames.rigid_motions;
  meta["groups"] = Json::array();
  for (const auto& [labels, triangles] : groups) {
    meta["groups"].push_back({{"labels", labels}, {"triangles", triangles.size()}});
  }
  meta["labels"] = labels_json(mesh, frames.label_ml);
  return {std::move(meta), deflated(bytes)};
}

}  // namespace viscera
