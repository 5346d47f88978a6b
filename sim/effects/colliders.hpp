// Rigid obstacles: plane, sphere, capsule and box, at rest or moving at a constant velocity from a
// start to a stop (a tool that presses or pulls). Friction and restitution as in contact.hpp, on
// velocities relative to the obstacle. Positions are those of the patient (LPS, m). What touches
// are the body's vertices: an obstacle smaller than the triangles of a surface fits between them.
// Distances are taken in double whatever T: the spacing of floats at the size of an obstacle is a
// good part of what a vertex at rest sinks in within a substep, g dt^2, from which friction comes.
//
// Every shape is convex and says how far a point is from its surface. A vertex that starts a
// substep outside is followed along its path relative to the obstacle: with n the normal at the
// nearest surface point and gap the distance, the shape lies behind the plane (n, gap), so the path
// may advance to that plane (conservative advancement; Mirtich, "Impulse-based Dynamic Simulation
// of Rigid Body Systems", 1996, section 2.3); it misses the shape when it does not approach. At its
// end a vertex is led to the nearest surface point, or, where that lies on another side than the
// entry, back to the plane of its entry: the speed does not matter.
//
// The elastic sweep comes after and may press a vertex in again. stop() ends it at a quarter of the
// shape's smallest half-width, so that the next substep still finds it on the side where it
// entered: no vertex passes through, whatever its speed and load.
#pragma once

#include <algorithm>
#include <cmath>
#include <sstream>

#include "sim/effects/contact.hpp"

namespace viscera::sim {

// The part of an obstacle's Params that says how it moves.
struct Travel {
  static constexpr double latest = 1e9;  // s: what stops then never does

  Vec3<double> velocity = {};  // m/s
  double start = 0.0;          // s
  double stop = latest;        // s
  // Not the scene's to give, m: how far it had gone when a schedule changed its way.
  Vec3<double> so_far = {};

  // m, at a time, s.
  Vec3<double> gone(double time) const { return so_far + travelled(start, stop, time) * velocity; }
  // For how long it has moved until a time, s.
  SIM_HD static double travelled(double start, double stop, double time) {
    const double until = time < stop ? time : stop;
    return until > start ? until - start : 0.0;
  }
  double ends() const {
    if (norm(velocity) == 0.0 || stop <= start) return 0.0;
    return stop < latest ? stop : never;
  }

  static constexpr auto fields() {
    return std::tuple{
        Field{"velocity", "m/s", &Travel::velocity, -1e3, 1e3, "of the obstacle, LPS"},
        Field{"start", "s", &Travel::start, 0.0, latest, "when it starts to move"},
        Field{"stop", "s", &Travel::stop, 0.0, latest, "when it stops"}};
  }
};

// (distance, normal) of a body of constant radius around the point or line that `away` leads from.
SIM_HD double round_distance(const Vec3<double>& away, double radius, Vec3<double>& normal) {
  const double length = norm(away);
  normal = length > 0.0 ? (1.0 / length) * away : Vec3<double>{0.0, 0.0, 1.0};
  return length - radius;
}

// A shape has
//   name, doc, Params with fields() (and check(), if need be)
//   struct Solid          numbers about an anchor
//   static Vec3<double> anchor(params, origin)                   in the model's frame
//   static Solid solid(params)
//   SIM_HD static double distance(solid, p, Vec3<double>& normal)   p from the anchor
//   static double half_width(params)         the smallest; infinity: cannot be passed
struct Plane {
  static constexpr const char* name = "plane";
  static constexpr const char* doc = "fixed or moving plane, solid behind";

  struct Params {
    Vec3<double> point = {required, required, required};  // m
    Vec3<double> normal = {0.0, 0.0, 1.0};                // LPS; need not have unit length
    static constexpr auto fields() {
      return std::tuple{
          Field{"point", "m", &Params::point, -1e6, 1e6, "a point of the plane"},
          Field{"normal", "1", &Params::normal, -1e6, 1e6, "LPS, out of the solid; any length"}};
    }
  };
  static void check(const Params& params) {
    require_direction(params.normal, "effects.plane.normal", "[0, 0, 1]");
  }
  static Vec3<double> unit_normal(const Params& params) {
    return (1.0 / norm(params.normal)) * params.normal;
  }

  struct Solid {
    Vec3<double> normal;
  };
  static Vec3<double> anchor(const Params& params, const Vec3<double>& origin) {
    return params.point - origin;
  }
  static Solid solid(const Params& params) { return {unit_normal(params)}; }
  SIM_HD static double distance(const Solid& plane, const Vec3<double>& p, Vec3<double>& normal) {
    normal = plane.normal;
    return dot(plane.normal, p);
  }
  static double half_width(const Params&) { return std::numeric_limits<double>::infinity(); }
};

struct Sphere {
  static constexpr const char* name = "sphere";
  static constexpr const char* doc = "fixed or moving ball";

  struct Params {
    Vec3<double> center = {required, required, required};  // m
    double radius = required;                              // m
    static constexpr auto fields() {
      return std::tuple{Field{"center", "m", &Params::center, -1e6, 1e6, "at the start"},
                        Field{"radius", "m", &Params::radius, 1e-6, 1e3, "of the ball"}};
    }
  };

  struct Solid {
    double radius;
  };
  static Vec3<double> anchor(const Params& params, const Vec3<double>& origin) {
    return params.center - origin;
  }
  static Solid solid(const Params& params) { return {params.radius}; }
  SIM_HD static double distance(const Solid& ball, const Vec3<double>& p, Vec3<double>& normal) {
    return round_distance(p, ball.radius, normal);
  }
  static double half_width(const Params& params) { return params.radius; }
};

struct Capsule {
  static constexpr const char* name = "capsule";
  static constexpr const char* doc = "fixed or moving rod with round ends";

  struct Params {
    Vec3<double> from = {required, required, required};  // m
    Vec3<double> to = {required, required, required};    // m
    double radius = required;                            // m
    static constexpr auto fields() {
      return std::tuple{Field{"from", "m", &Params::from, -1e6, 1e6, "one end of the axis"},
                        Field{"to", "m", &Params::to, -1e6, 1e6, "its other end"},
                        Field{"radius", "m", &Params::radius, 1e-6, 1e3, "of the rod"}};
    }
  };

  struct Solid {
    Vec3<double> axis;               // from the anchor, one end, to the other
    double inverse_squared, radius;  // 1/|axis|^2, 0 for a ball
  };
  static Vec3<double> anchor(const Params& params, const Vec3<double>& origin) {
    return params.from - origin;
  }
  static Solid solid(const Params& params) {
    const Vec3<double> axis = params.to - params.from;
    const double squared = dot(axis, axis);
    return {axis, squared > 0.0 ? 1.0 / squared : 0.0, params.radius};
  }
  SIM_HD static double distance(const Solid& rod, const Vec3<double>& p, Vec3<double>& normal) {
    const double along = dot(p, rod.axis) * rod.inverse_squared;
    const double share = along < 0.0 ? 0.0 : along > 1.0 ? 1.0 : along;
    return round_distance(p - share * rod.axis, rod.radius, normal);
  }
  static double half_width(const Params& params) { return params.radius; }
};

struct Box {
  static constexpr const char* name = "box";
  static constexpr const char* doc = "fixed or moving box";

  struct Params {
    Vec3<double> center = {required, required, required};  // m
    Vec3<double> size = {required, required, required};    // m, full widths
    Vec3<double> rotation = {};                            // rad, about the centre
    static constexpr auto fields() {
      return std::tuple{
          Field{"center", "m", &Params::center, -1e6, 1e6, "at the start"},
          Field{"size", "m", &Params::size, 1e-6, 1e3, "full widths along the box's own axes"},
          Field{"rotation", "rad", &Params::rotation, -7.0, 7.0, "axis times angle"}};
    }
  };

  struct Solid {
    Mat3<double> axes;  // columns: the box's own
    Vec3<double> half;
  };
  static Vec3<double> anchor(const Params& params, const Vec3<double>& origin) {
    return params.center - origin;
  }
  static Solid solid(const Params& params) {
    return {rotation_matrix(params.rotation), 0.5 * params.size};
  }
  SIM_HD static double distance(const Solid& box, const Vec3<double>& p, Vec3<double>& normal) {
    const double x[3] = {dot(box.axes.col[0], p), dot(box.axes.col[1], p), dot(box.axes.col[2], p)};
    const double half[3] = {box.half.x, box.half.y, box.half.z};
    Vec3<double> out = {};
    int face = 0;  // the nearest from within
    double within = -std::numeric_limits<double>::infinity();
    for (int i = 0; i < 3; ++i) {
      const double side = x[i] < 0.0 ? -1.0 : 1.0, beyond = side * x[i] - half[i];
      if (beyond > 0.0) out += (side * beyond) * box.axes.col[i];
      if (beyond > within) within = beyond, face = i;
    }
    if (within > 0.0) return round_distance(out, 0.0, normal);
    normal = (x[face] < 0.0 ? -1.0 : 1.0) * box.axes.col[face];
    return within;
  }
  static double half_width(const Params& params) {
    return 0.5 * std::min({params.size.x, params.size.y, params.size.z});
  }

 private:
  // Rodrigues' formula.
  static Mat3<double> rotation_matrix(const Vec3<double>& vector) {
    const double angle = norm(vector);
    const Vec3<double> k = angle > 0.0 ? (1.0 / angle) * vector : Vec3<double>{};
    const auto turned = [&](const Vec3<double>& e) {
      const Vec3<double> across = cross(k, e);
      return e + std::sin(angle) * across + (1.0 - std::cos(angle)) * cross(k, across);
    };
    return {{turned({1, 0, 0}), turned({0, 1, 0}), turned({0, 0, 1})}};
  }
};

template <class Shape>
struct Collider {
  static constexpr const char* name = Shape::name;
  static constexpr const char* doc = Shape::doc;
  static constexpr EffectKind kind = EffectKind::contact;

  struct Params : Shape::Params, Travel, Finish {};
  static constexpr auto fields() {
    return std::tuple_cat(fields_of<Params>(Shape::Params::fields()),
                          fields_of<Params>(Travel::fields()), fields_of<Params>(Finish::fields()));
  }
  static void check(const Params& params) {
    if constexpr (requires { Shape::check(params); }) Shape::check(params);
    if (params.stop >= params.start) return;
    throw Refusal(Refusal::Cause::scene, std::string("effects.") + name + ".stop",
                  std::to_string(params.stop) + " s",
                  "not before its start at " + std::to_string(params.start) + " s");
  }

  static double ends(const Params& params) { return params.Travel::ends(); }

  template <class T>
  struct Device {
    typename Shape::Solid solid;
    Vec3<double> anchor;    // m, before it moves, or moves on
    Vec3<double> velocity;  // m/s
    double start, stop;     // s
    double deepest;         // m, that stop() leaves a vertex inside
    Roughness<T> surface;
  };

  template <class T>
  static Device<T> device(const Model& model, const Params& params) {
    refuse_overlap(model, params);
    return {Shape::solid(params),
            Shape::anchor(params, model.origin) + params.so_far,
            params.velocity,
            params.start,
            params.stop,
            0.25 * Shape::half_width(params),
            params.template roughness<T>()};
  }

  // Of a place from where it is at a time, m in the model's frame; negative: inside.
  static auto distance_at(const Model& model, const Params& params, double time) {
    const Vec3<double> anchor = Shape::anchor(params, model.origin) + params.gone(time);
    return [anchor, solid = Shape::solid(params)](const Vec3<double>& place) {
      Vec3<double> normal;
      return Shape::distance(solid, place - anchor, normal);
    };
  }

  // What is put in place of `before` at a time, s: it goes on from where that one is then, or
  // stands where the change puts it.
  static Params gone_on(const Params& before, Params now, double time) {
    const bool is_put = norm(Shape::anchor(now, {}) - Shape::anchor(before, {})) > 0.0;
    const bool same = norm(now.velocity - before.velocity) == 0.0 && now.start <= before.start &&
                      now.stop == before.stop;
    if (!is_put && same) {
      now.so_far = before.so_far, now.start = before.start;
      return now;
    }
    now.so_far = is_put ? Vec3<double>{} : before.gone(time);
    now.start = std::max(now.start, time);
    return now;
  }

  // Its place and motion; what it meets on the way it pushes out.
  template <class T>
  static void steer(Device<T>& it, const Vec3<double>& origin, const Params& params, double) {
    it.anchor = Shape::anchor(params, origin) + params.so_far;
    it.velocity = params.velocity;
    it.start = params.start;
    it.stop = params.stop;
  }

  template <class T>
  SIM_HD static Vec3<T> push(const Device<T>& it, const Step<T>& step, const Vec3<T>& rest,
                             const Vec3<T>& u, const Vec3<T>& d) {
    const Face face = meet(it, step, rest, u, d);
    return face.depth > 0.0 ? cast<T>(face.depth * face.normal) : Vec3<T>{};
  }

  template <class T>
  SIM_HD static void rub(const Device<T>& it, const Step<T>& step, const Vec3<T>& correction,
                         const Vec3<T>& v, Vec3<T>& d) {
    const Vec3<T> moved = cast<T>(moving_time(it, step) * it.velocity);
    const T depth = norm(correction);
    Vec3<T> relative = d - moved;
    rub_and_bounce((T(1) / depth) * correction, depth, it.surface, step.dt,
                   v - (T(1) / step.dt) * moved, relative);
    d = relative + moved;
  }

  template <class T>
  SIM_HD static Vec3<T> stop(const Device<T>& it, const Step<T>& step, const Vec3<T>& rest,
                             const Vec3<T>& u, const Vec3<T>& d) {
    const Face face = meet(it, step, rest, u, d);
    const double excess = face.depth - it.deepest;
    return excess > 0.0 ? cast<T>(excess * face.normal) : Vec3<T>{};
  }

 private:
  // An overlap at the start would be thrown out at its depth over the substep.
  static void refuse_overlap(const Model& model, const Params& params) {
    const auto solid = Shape::solid(params);
    const Vec3<double> anchor = Shape::anchor(params, model.origin);
    const double rounding = 1e-9 * model.size();
    double deepest = 0.0;
    std::size_t inside = 0;
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      Vec3<double> normal;
      const double depth = -Shape::distance(solid, model.rest[i] - anchor, normal);
      if (model.fixed[i] || !(depth > rounding)) continue;
      deepest = std::max(deepest, depth);
      ++inside;
    }
    if (inside == 0) return;
    std::ostringstream found;
    found << inside << " vertices of the body are inside at the start, by up to " << 1e3 * deepest
          << " mm";
    throw Refusal(Refusal::Cause::scene, std::string("effects.") + name, found.str(),
                  "an obstacle that the body does not overlap", "move it away, and let it come");
  }

  struct Face {
    Vec3<double> normal;
    double depth;  // of the vertex below it, m; not positive: no contact
  };

  // How long the obstacle moves in this substep.
  template <class T>
  SIM_HD static double moving_time(const Device<T>& it, const Step<T>& step) {
    const double waits = it.start - (step.time - step.dt), rests = step.time - it.stop;
    const double time = step.dt - (waits > 0.0 ? waits : 0.0) - (rests > 0.0 ? rests : 0.0);
    return time > 0.0 ? time : 0.0;
  }

  template <class T>
  SIM_HD static Face meet(const Device<T>& it, const Step<T>& step, const Vec3<T>& rest,
                          const Vec3<T>& u, const Vec3<T>& d) {
    const Vec3<double> path = cast<double>(d) - moving_time(it, step) * it.velocity;
    const Vec3<double> end =
        cast<double>(rest) + cast<double>(u) + cast<double>(d) -
        (it.anchor + Travel::travelled(it.start, it.stop, step.time) * it.velocity);
    Vec3<double> at = end - path, normal, nearest;
    double gap = Shape::distance(it.solid, at, normal);
    if (gap > 0.0 && !enters(it.solid, path, at, normal, gap)) return {normal, -1.0};
    const double over = Shape::distance(it.solid, end, nearest);
    if (dot(nearest, normal) > 0.5) return {nearest, -over};
    return {normal, -(gap + dot(normal, end - at))};
  }

  // Moves `at` along `path` to the surface; normal and gap are those there.
  SIM_HD static bool enters(const typename Shape::Solid& solid, const Vec3<double>& path,
                            Vec3<double>& at, Vec3<double>& normal, double& gap) {
    constexpr int most = 16;  // the planes close in quadratically
    const Vec3<double> start = at;
    const double close = 1e-3 * norm(path);
    double share = 0.0;
    for (int i = 0; i < most && gap > close; ++i) {
      const double approach = -dot(normal, path);
      if (!(share * approach + gap <= approach)) return false;
      share += gap / approach;
      at = start + share * path;
      gap = Shape::distance(solid, at, normal);
    }
    return true;
  }
};

}  // namespace viscera::sim
