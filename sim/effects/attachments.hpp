// Vertices that do not follow forces: `fixed` ones stay where they are at rest, `prescribed` ones
// are led along a displacement. SI units. Where two of them select the same vertex, the one that
// the registry names later leads it.
#pragma once

#include "sim/effects/effect.hpp"
#include "sim/model/selection.hpp"

namespace viscera::sim {

struct Fixed {
  static constexpr const char* name = "fixed";
  static constexpr const char* doc = "vertices that do not move";
  static constexpr EffectKind kind = EffectKind::motion;

  struct Params : Selection {};
  static constexpr auto fields() { return fields_of<Params>(Selection::fields()); }

  static double ends(const Params&) { return 0.0; }

  static std::vector<int> vertices(const Model& model, const Params& params) {
    return select_vertices(model, params, name);
  }
  template <class T>
  struct Device {};
  template <class T>
  static Device<T> device(const Model&, const Params&) {
    return {};
  }
  template <class T>
  SIM_HD static Vec3<T> target(const Device<T>&, const Vec3<T>&, T) {
    return {};
  }
};

// u(t) = r(s) displacement, s = (t - start) / duration in [0, 1]; r = s, a constant velocity, or
// r = s^2 (3 - 2 s), whose velocity begins and ends at zero.
struct Prescribed {
  static constexpr const char* name = "prescribed";
  static constexpr const char* doc = "vertices led along a displacement";
  static constexpr EffectKind kind = EffectKind::motion;

  struct Params : Selection {
    Vec3<double> displacement = {required, required, required};  // m
    double start = 0.0;                                          // s
    double duration = 1.0;                                       // s; 0: at once
    std::string ramp = "smooth";
    // Not the scene's to give, m: from where it goes on, when a schedule has changed its path.
    Vec3<double> from = {};
  };
  static constexpr auto fields() {
    return std::tuple_cat(
        fields_of<Params>(Selection::fields()),
        std::tuple{
            Field{"displacement", "m", &Params::displacement, -1e3, 1e3, "at the end, LPS"},
            Field{"start", "s", &Params::start, 0.0, 1e9, "when it begins"},
            Field{"duration", "s", &Params::duration, 0.0, 1e9, "until it is reached"},
            Field{"ramp", "smooth|linear", &Params::ramp, "from standstill, or at one velocity"}});
  }
  static void check(const Params& params) {
    if (params.ramp == "smooth" || params.ramp == "linear") return;
    throw Refusal(Refusal::Cause::scene, "effects.prescribed.ramp", "'" + params.ramp + "'",
                  "smooth or linear");
  }

  static double ends(const Params& params) {
    return norm(params.displacement - params.from) > 0.0 ? params.start + params.duration : 0.0;
  }

  static std::vector<int> vertices(const Model& model, const Params& params) {
    return select_vertices(model, params, name);
  }
  template <class T>
  struct Device {
    Vec3<T> from, way;  // m
    T start, duration;
    bool smooth;
  };
  template <class T>
  static Device<T> path(const Params& params) {
    return {cast<T>(params.from), cast<T>(params.displacement - params.from),
            static_cast<T>(params.start), static_cast<T>(params.duration), params.ramp == "smooth"};
  }
  template <class T>
  static Device<T> device(const Model&, const Params& params) {
    return path<T>(params);
  }
  template <class T>
  SIM_HD static Vec3<T> target(const Device<T>& path, const Vec3<T>&, T time) {
    const T since = time - path.start;
    if (!(since > T(0))) return path.from;
    if (since >= path.duration) return path.from + path.way;
    const T s = since / path.duration;
    return path.from + (path.smooth ? s * s * (T(3) - T(2) * s) : s) * path.way;
  }

  // What is put in place of `before` at a time, s: it goes on from where that one is then.
  static Params gone_on(const Params& before, Params now, double time) {
    const bool same = norm(now.displacement - before.displacement) == 0.0 &&
                      now.start <= before.start && now.duration == before.duration &&
                      now.ramp == before.ramp;
    if (same) {
      now.from = before.from, now.start = before.start;
      return now;
    }
    now.from = target(path<double>(before), {}, time);
    now.start = std::max(now.start, time);
    return now;
  }
};

}  // namespace viscera::sim
