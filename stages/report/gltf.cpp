#include "stages/report/gltf.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <set>

#include "pipeline/base/param.hpp"
#include "sim/base/tet_face.hpp"

namespace viscera {
namespace {

// Numbers of the specification (Khronos, glTF 2.0, 3.6.2 and 4.4).
constexpr int float_type = 5126, uint_type = 5125, array_buffer = 34962, index_buffer = 34963;
constexpr std::uint32_t magic = 0x46546C67, json_chunk = 0x4E4F534A, binary_chunk = 0x004E4942;

using Triangle = std::array<int, 3>;

std::map<int, double> label_sizes(const TetMesh& mesh) {
  std::map<int, double> sizes;
  for (const int label : mesh.labels) ++sizes[label];
  return sizes;
}

// By label, outward: all faces to other labels and to the outside, of the largest to the outside
// only.
std::map<int, std::vector<Triangle>> label_surfaces(const TetMesh& mesh, int largest) {
  std::map<Triangle, std::set<int>> sides;  // labels at a face; two tets of one label: {label, -1}
  const auto each_face = [&](auto&& visit) {
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      for (int k = 0; k < 4; ++k) {
        const Triangle face = sim::face_of_tet(mesh.tets[t], k);
        Triangle key = face;
        std::ranges::sort(key);
        visit(face, key, mesh.labels[t]);
      }
    }
  };
  each_face([&](const Triangle&, const Triangle& key, int label) {
    if (!sides[key].insert(label).second) sides[key].insert(-1);
  });
  std::map<int, std::vector<Triangle>> surfaces;
  each_face([&](const Triangle& face, const Triangle& key, int label) {
    const auto& at = sides.at(key);
    const bool inside = at.contains(-1), border = at.size() > 1;
    if (!inside && !(border && label == largest)) surfaces[label].push_back(face);
  });
  return surfaces;
}

std::vector<float> normals_of(const std::vector<float>& xyz, const std::vector<Triangle>& faces) {
  std::vector<float> normals(xyz.size());
  for (const auto& t : faces) {
    double e[2][3], n[3];
    for (int k = 0; k < 3; ++k) {
      e[0][k] = xyz[3 * t[1] + k] - xyz[3 * t[0] + k];
      e[1][k] = xyz[3 * t[2] + k] - xyz[3 * t[0] + k];
    }
    for (int k = 0; k < 3; ++k) {
      n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
      for (const int v : t) normals[3 * v + k] += static_cast<float>(n[k]);
    }
  }
  for (std::size_t i = 0; i < normals.size(); i += 3) {
    const float length = std::hypot(normals[i], normals[i + 1], normals[i + 2]);
    if (length > 0.0f) {
      for (int k = 0; k < 3; ++k) normals[i + k] /= length;
    } else {
      normals[i + 2] = 1.0f;
    }
  }
  return normals;
}

class Writer {
 public:
  template <class T>
  int add(const std::vector<T>& values, const char* type, int components, int target) {
    const std::size_t bytes = values.size() * sizeof(T);
    json_["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", binary_.size()}, {"byteLength", bytes}});
    if (target) json_["bufferViews"].back()["target"] = target;
    binary_.append(reinterpret_cast<const char*>(values.data()), bytes);
    Json accessor{{"bufferView", json_["bufferViews"].size() - 1},
                  {"componentType", std::is_same_v<T, float> ? float_type : uint_type},
                  {"count", values.size() / components},
                  {"type", type}};
    // Positions and times must state their bounds.
    std::vector<T> lo(values.begin(), values.begin() + components), hi = lo;
    for (std::size_t i = 0; i < values.size(); ++i) {
      lo[i % components] = std::min(lo[i % components], values[i]);
      hi[i % components] = std::max(hi[i % components], values[i]);
    }
    accessor["min"] = lo;
    accessor["max"] = hi;
    json_["accessors"].push_back(std::move(accessor));
    return static_cast<int>(json_["accessors"].size()) - 1;
  }

  Json& json() { return json_; }

  std::string binary() {
    json_["buffers"] = Json::array({Json{{"byteLength", binary_.size()}}});
    std::string text = json_.dump(-1, ' ', false, Json::error_handler_t::replace);
    text.resize((text.size() + 3) / 4 * 4, ' ');
    binary_.resize((binary_.size() + 3) / 4 * 4, '\0');
    std::string file;
    const auto word = [&file](std::size_t value) {
      for (int shift = 0; shift < 32; shift += 8) file += static_cast<char>(value >> shift & 0xff);
    };
    word(magic), word(2), word(28 + text.size() + binary_.size());
    word(text.size()), word(json_chunk);
    file += text;
    word(binary_.size()), word(binary_chunk);
    return file + binary_;
  }

 private:
  Json json_{{"asset", {{"version", "2.0"}, {"generator", "viscera"}}},
             {"bufferViews", Json::array()},
             {"accessors", Json::array()}};
  std::string binary_;
};

Json material(const std::string& name, bool outer, std::size_t number) {
  constexpr double others[][3] = {
      {0.79, 0.35, 0.0}, {0.03, 0.21, 0.53}, {0.0, 0.34, 0.17}, {0.60, 0.19, 0.38}};
  const auto& other = others[number % 4];
  const Json colour =
      outer ? Json{0.53, 0.19, 0.15, 0.45} : Json{other[0], other[1], other[2], 1.0};
  return {{"name", name},
          {"alphaMode", outer ? "BLEND" : "OPAQUE"},
          {"doubleSided", !outer},
          {"pbrMetallicRoughness",
           {{"baseColorFactor", colour}, {"metallicFactor", 0.0}, {"roughnessFactor", 0.7}}}};
}

// The points that the faces use, in their order, and the faces in these numbers.
std::vector<int> compacted(std::vector<Triangle>& faces) {
  std::map<int, int> number;
  for (const auto& t : faces) {
    for (const int v : t) number.emplace(v, 0);
  }
  std::vector<int> used;
  for (auto& [point, n] : number) {
    n = static_cast<int>(used.size());
    used.push_back(point);
  }
  for (auto& t : faces) {
    for (int& v : t) v = number.at(v);
  }
  return used;
}

std::vector<float> taken(const std::vector<float>& xyz, const std::vector<int>& points) {
  std::vector<float> kept;
  for (const int p : points) kept.insert(kept.end(), &xyz[3 * p], &xyz[3 * p] + 3);
  return kept;
}

// Time t shows target t alone; the first frame is the shape without any.
void add_animation(Writer& writer, const std::vector<float>& times) {
  const std::size_t targets = times.size() - 1;
  std::vector<float> weights;
  for (std::size_t f = 0; f < times.size(); ++f) {
    for (std::size_t t = 1; t <= targets; ++t) weights.push_back(t == f ? 1.0f : 0.0f);
  }
  const int input = writer.add(times, "SCALAR", 1, 0);
  const int output = writer.add(weights, "SCALAR", 1, 0);
  const Json sampler{{"input", input}, {"output", output}, {"interpolation", "LINEAR"}};
  const Json channel{{"sampler", 0}, {"target", {{"node", 0}, {"path", "weights"}}}};
  const Json animation{{"name", "motion"},
                       {"samplers", Json::array({sampler})},
                       {"channels", Json::array({channel})}};
  writer.json()["animations"] = Json::array({animation});
}

}  // namespace

std::string gltf_binary(const TrajectoryReader& trajectory, std::size_t max_frames) {
  const TetMesh& mesh = trajectory.mesh();
  const auto& all_times = trajectory.times_s();
  if (max_frames == 0 || all_times.empty() || mesh.tets.empty()) return "";
  const std::size_t count = std::min(all_times.size(), std::max<std::size_t>(2, max_frames));
  std::vector<std::vector<float>> frames;
  std::vector<float> times;
  for (std::size_t f = 0; f < count; ++f) {
    const std::size_t frame = count == 1 ? 0 : f * (all_times.size() - 1) / (count - 1);
    frames.push_back(trajectory.positions_mm(frame));
    times.push_back(static_cast<float>(all_times[frame] - all_times[0]));
  }
  const auto sizes = label_sizes(mesh);
  const int largest =
      std::ranges::max_element(sizes, {}, [](const auto& s) { return s.second; })->first;
  Writer writer;
  Json& json = writer.json();
  json["materials"] = Json::array();
  Json primitives = Json::array();
  for (auto& [label, faces] : label_surfaces(mesh, largest)) {
    const std::vector<int> used = compacted(faces);
    std::vector<std::uint32_t> index;
    for (const auto& t : faces) {
      for (const int v : t) index.push_back(static_cast<std::uint32_t>(v));
    }
    const std::vector<float> base = taken(frames[0], used);
    Json primitive{{"attributes",
                    {{"POSITION", writer.add(base, "VEC3", 3, array_buffer)},
                     {"NORMAL", writer.add(normals_of(base, faces), "VEC3", 3, array_buffer)}}},
                   {"indices", writer.add(index, "SCALAR", 1, index_buffer)},
                   {"material", json["materials"].size()}};
    for (std::size_t f = 1; f < count; ++f) {
      std::vector<float> moved = taken(frames[f], used);
      for (std::size_t i = 0; i < moved.size(); ++i) moved[i] -= base[i];
      primitive["targets"].push_back({{"POSITION", writer.add(moved, "VEC3", 3, array_buffer)}});
    }
    primitives.push_back(std::move(primitive));
    const auto name = mesh.label_names.find(label);
    json["materials"].push_back(
        material(name == mesh.label_names.end() ? std::to_string(label) : name->second,
                 label == largest, json["materials"].size()));
  }
  json["meshes"] = Json::array({Json{{"primitives", primitives}}});
  // From LPS: left stays to the viewer's right, superior up, anterior towards the viewer; by
  // column.
  const Json turned = {0.001, 0, 0, 0, 0, 0, -0.001, 0, 0, 0.001, 0, 0, 0, 0, 0, 1};
  json["nodes"] = Json::array({Json{{"mesh", 0}, {"matrix", turned}}});
  json["scenes"] = Json::array({Json{{"nodes", Json::array({0})}}});
  json["scene"] = 0;
  if (count > 1) add_animation(writer, times);
  return writer.binary();
}

}  // namespace viscera
