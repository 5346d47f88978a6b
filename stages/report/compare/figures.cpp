#include "stages/report/compare/figures.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "pipeline/base/json_value.hpp"
#include "sim/base/tet_face.hpp"

namespace viscera {
namespace {

constexpr int tile_width = 300, tile_height = 260;
constexpr std::array<double, 3> from_the_front = {0.35, 1.0, -0.22};
constexpr Colour orange = {0.95, 0.45, 0.05};
constexpr Colour liver = {0.75, 0.48, 0.42};

using Triangles = std::vector<std::array<int, 3>>;

// Faces of one tet only, outward.
Triangles outer_faces(const TetMesh& mesh) {
  std::map<std::array<int, 3>, std::array<int, 3>> open;
  for (const auto& tet : mesh.tets) {
    for (int k = 0; k < 4; ++k) {
      const std::array<int, 3> face = sim::face_of_tet(tet, k);
      std::array<int, 3> key = face;
      std::ranges::sort(key);
      if (!open.emplace(key, face).second) open.erase(key);
    }
  }
  Triangles faces;
  for (const auto& [key, face] : open) faces.push_back(face);
  return faces;
}

std::size_t frame_at(const ComparedRun& run, double time_s) {
  const auto& times = run.trajectory->times_s();
  std::size_t best = 0;
  for (std::size_t f = 0; f < times.size(); ++f) {
    if (std::abs(times[f] - time_s) < std::abs(times[best] - time_s)) best = f;
  }
  return best;
}

std::size_t most_deformed_frame(const ComparedRun& run) {
  return frame_at(run, run.metric("max_deformation_time").value_or(0.0));
}

// Where the ground is, from the scene: `clearance` below the lowest rest point.
double ground_of(const ComparedRun& run) {
  double lowest = std::numeric_limits<double>::infinity();
  for (const auto& p : run.trajectory->mesh().points) lowest = std::min(lowest, p[2]);
  const JsonValue scene(run.scene, "scene.json of " + run.name);
  const auto effects = run.scene.is_null() ? std::nullopt : scene.find("effects");
  const auto ground = effects ? effects->find("ground") : std::nullopt;
  if (!ground) return -std::numeric_limits<double>::infinity();
  const auto clearance_m = ground->find("clearance");
  return lowest - 1e3 * (clearance_m ? clearance_m->number() : 0.0);
}

// One camera for all pictures of a figure: the box of the rest shape and of where it ends, and of
// the rest shapes of `beside`, which may be other bodies. Where those end may be anywhere.
Camera camera_for(const ComparedRun& run, const RunList& beside) {
  std::array<double, 3> lo{1e300, 1e300, 1e300}, hi{-1e300, -1e300, -1e300};
  const auto include = [&](const auto* p) {
    for (int k = 0; k < 3; ++k) {
      lo[k] = std::min<double>(lo[k], p[k]), hi[k] = std::max<double>(hi[k], p[k]);
    }
  };
  for (const auto& p : run.trajectory->mesh().points) include(p.data());
  for (const auto* other : beside) {
    for (const auto& p : other->trajectory->mesh().points) include(p.data());
  }
  if (const std::size_t frames = run.trajectory->times_s().size(); frames > 0) {
    const auto xyz = run.trajectory->positions_mm(frames - 1);
    for (std::size_t i = 0; i < xyz.size(); i += 3) include(&xyz[i]);
  }
  if (std::isfinite(ground_of(run))) lo[2] = std::min(lo[2], ground_of(run));
  Camera camera{.view = from_the_front};
  double across = 0.0;
  for (int k = 0; k < 3; ++k) {
    camera.centre[k] = 0.5 * (lo[k] + hi[k]);
    if (k < 2) across = std::max(across, hi[k] - lo[k]);
  }
  camera.half_height =
      0.56 * std::max(hi[2] - lo[2] + 0.2 * across, across * tile_height / tile_width);
  return camera;
}

struct Shown {
  std::vector<float> xyz;
  Triangles triangles;
  Surface surface(const Colour& colour) const { return {xyz, triangles, colour}; }
};

Shown shown(const ComparedRun& run, std::size_t frame) {
  return {run.trajectory->positions_mm(frame), outer_faces(run.trajectory->mesh())};
}

Canvas canvas_for(const ComparedRun& run, const Camera& camera) {
  Canvas canvas(tile_width, tile_height, camera);
  if (std::isfinite(ground_of(run))) canvas.draw_ground(ground_of(run));
  return canvas;
}

Image picture(const ComparedRun& run, std::size_t frame, const Camera& camera,
              const Colour& colour) {
  Canvas canvas = canvas_for(run, camera);
  canvas.draw(shown(run, frame).surface(colour));
  return canvas.image();
}

double time_of(const ComparedRun& run, std::size_t frame) {
  return run.trajectory->times_s()[frame];
}

}  // namespace

std::vector<Colour> colours_of(const RunList& runs) {
  std::map<std::string, Colour> by_solver = {{"pbd", {0.93, 0.76, 0.15}},
                                             {"xpbd", {0.80, 0.22, 0.18}},
                                             {"fem", {0.18, 0.42, 0.78}},
                                             {"tled", {0.15, 0.60, 0.45}}};
  constexpr Colour others[] = {
      {0.48, 0.36, 0.68}, {0.35, 0.65, 0.85}, {0.55, 0.45, 0.30}, {0.5, 0.5, 0.5}};
  std::vector<Colour> colours;
  std::size_t next = 0;
  for (const auto* run : runs) {
    const auto own = by_solver.extract(run->param("solver"));
    colours.push_back(own ? own.mapped() : others[std::min<std::size_t>(next++, 3)]);
  }
  return colours;
}

Figure grid_figure(const RunList& rows, int columns) {
  const int count = static_cast<int>(rows.size());
  Figure figure{blank(columns * tile_width, count * tile_height, {1, 1, 1}), Json::array()};
  const Camera camera = camera_for(*rows.front(), rows);
  double last = 0.0;
  for (const auto* run : rows) last = std::max(last, run->metric("rest_time").value_or(0.0));
  const double first = rows.front()->metric("contact_time").value_or(0.0);
  // Deformation is fastest at first: times grow by equal factors from contact on.
  std::vector<double> times = {0.0};
  const double span = std::max(last, 2.0 * first) / std::max(first, 1e-3);
  for (int c = 0; c + 1 < columns; ++c) {
    times.push_back(std::max(first, 1e-3) * std::pow(span, double(c) / std::max(1, columns - 2)));
  }
  for (int r = 0; r < count; ++r) {
    Json shown_at = Json::array();
    for (int c = 0; c < columns; ++c) {
      const std::size_t frame = frame_at(*rows[r], times[c]);
      figure.image.paste(picture(*rows[r], frame, camera, liver), c * tile_width, r * tile_height);
      shown_at.push_back(time_of(*rows[r], frame));
    }
    figure.caption.push_back({{"run", rows[r]->name}, {"times_s", shown_at}});
  }
  return figure;
}

Figure side_by_side_figure(const RunList& runs) {
  const int count = static_cast<int>(runs.size());
  Figure figure{blank(count * tile_width, tile_height, {1, 1, 1}), Json::array()};
  const Camera camera = camera_for(*runs.front(), runs);
  const std::vector<Colour> colours = colours_of(runs);
  for (int i = 0; i < count; ++i) {
    const std::size_t frame = most_deformed_frame(*runs[i]);
    figure.image.paste(picture(*runs[i], frame, camera, colours[i]), i * tile_width, 0);
    figure.caption.push_back({{"run", runs[i]->name}, {"time_s", time_of(*runs[i], frame)}});
  }
  return figure;
}

Figure overlay_figure(const RunList& runs) {
  const ComparedRun& outlined = *runs[1];
  const int count = static_cast<int>(runs.size()) - 1;
  Figure figure{blank(count * tile_width, tile_height, {1, 1, 1}), Json::array()};
  const std::vector<Colour> colours = colours_of(runs);
  const Camera camera = camera_for(outlined, runs);
  const std::size_t frame = most_deformed_frame(outlined);
  const double time = time_of(outlined, frame);
  for (std::size_t i = 0; i < runs.size(); ++i) {
    if (i == 1) continue;
    Canvas canvas = canvas_for(outlined, camera);
    canvas.draw(shown(*runs[i], frame_at(*runs[i], time)).surface(colours[i]));
    canvas.draw_over(shown(outlined, frame).surface(colours[1]), 0.35, orange);
    figure.image.paste(canvas.image(), static_cast<int>(figure.caption.size()) * tile_width, 0);
    figure.caption.push_back(
        {{"outlined", outlined.name}, {"over", runs[i]->name}, {"time_s", time}});
  }
  return figure;
}

Figure shape_figure(const ComparedRun& run, const std::vector<float>& xyz,
                    const std::vector<Colour>& colours) {
  Figure figure{blank(2 * tile_width, tile_height, {1, 1, 1}), Json::array()};
  const Triangles faces = outer_faces(run.trajectory->mesh());
  for (const double side : {1.0, -1.0}) {
    Camera camera = camera_for(run, {});
    for (int k = 0; k < 2; ++k) camera.view[k] *= side;
    Canvas canvas(tile_width, tile_height, camera);
    canvas.draw({xyz, faces, {}, colours});
    figure.image.paste(canvas.image(), side > 0.0 ? 0 : tile_width, 0);
  }
  return figure;
}

}  // namespace viscera
