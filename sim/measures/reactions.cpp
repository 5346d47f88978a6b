#include "sim/measures/reactions.hpp"

#include <algorithm>
#include <cctype>
#include <map>
#include <numeric>

#include "sim/measures/element_forces.hpp"
#include "sim/measures/forces.hpp"
#include "sim/measures/overlap.hpp"

namespace viscera::sim {
namespace {

// Of the body's size: far above what rounding and the last substep leave between a vertex and what
// it lies on, far below an edge.
constexpr double touching = 1e-4;

// An element that acts from outside: a load, or what ties one vertex to a place of its own.
template <class Effect>
constexpr bool is_outer = [] {
  if constexpr (Effect::kind == EffectKind::element) return is_load<Effect> || Effect::arity == 1;
  return false;
}();

// Whether an effect has a row of its own.
template <class Effect>
constexpr bool has_resultant =
    Effect::kind == EffectKind::force || Effect::kind == EffectKind::motion ||
    Effect::kind == EffectKind::contact || is_outer<Effect>;

FrameMotion motion_of(const State& of, const State& first, const State& second, const State& third,
                      const State& from, const State& to, double apart, double frame_s) {
  const std::size_t n = of.u.size();
  FrameMotion motion{.state = &of, .velocity = VertexField(n), .acceleration = VertexField(n)};
  for (std::size_t i = 0; i < n; ++i) {
    motion.velocity[i] = (1.0 / apart) * (to.u[i] - from.u[i]);
    motion.acceleration[i] =
        (1.0 / (frame_s * frame_s)) * ((third.u[i] - second.u[i]) - (second.u[i] - first.u[i]));
  }
  return motion;
}

}  // namespace

FrameMotion FrameMotion::between(const State& before, const State& now, const State& after,
                                 double frame_s) {
  return motion_of(now, before, now, after, before, after, 2.0 * frame_s, frame_s);
}

FrameMotion FrameMotion::none(const State& now) {
  const VertexField zero(now.u.size());
  return {.state = &now, .velocity = zero, .acceleration = zero};
}

FrameMotion FrameMotion::at_end(const State& first, const State& before, const State& now,
                                double frame_s) {
  return motion_of(now, first, before, now, before, now, frame_s, frame_s);
}

Reactions::Reactions(const Model& model, const Scene& scene, double acts_s, ForcesOfTissue tissue)
    : model_(model),
      dt_(scene.time.substep_s()),
      acts_(acts_s > 0.0 ? acts_s : dt_),
      edges_(Distance::elements(model, {})),
      piece_(pieces_of(model)),
      holder_(model.vertex_count(), -1),
      tissue_(std::move(tissue)),
      reach_(touching * model.size()) {
  double mass = 0.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    about_ += model.mass[i] * model.rest[i];
    mass += model.mass[i];
  }
  about_ *= 1.0 / mass;
  refuse_regions(scene, "forces: false, or another effect in its place");
  Effects::for_each([&]<class Effect, std::size_t i>() {
    const auto& all = std::get<i>(scene.effects);
    if constexpr (Effect::kind != EffectKind::region && Effect::kind != EffectKind::self_contact) {
      for (std::size_t k = 0; k < all.size(); ++k) {
        // What has a history goes through all of a substep.
        std::get<i>(on_).emplace_back(model, all[k], history_of<Effect> > 0 ? dt_ : acts_);
        if constexpr (!has_resultant<Effect>) continue;
        if constexpr (Effect::kind == EffectKind::motion) {
          for (const int v : std::get<i>(on_).back().vertices)
            holder_[v] = static_cast<int>(names_.size());
        }
        names_.push_back(name_of<Effect>(all, k));
      }
    }
  });
  for (std::size_t v = 0; v < holder_.size(); ++v) {
    if (!model.fixed[v] || holder_[v] >= 0) continue;
    holder_[v] = static_cast<int>(names_.size());
  }
  if (std::ranges::count(holder_, static_cast<int>(names_.size())) > 0)
    names_.emplace_back(model_held);
  if (scene.has<SelfContact>()) name_self_contact(scene);
  names_.emplace_back(remainder);
}

void Reactions::name_self_contact(const Scene& scene) {
  const double thickness = scene.params<SelfContact>().front().thickness;
  pairs_.emplace(model_, thickness);
  // What a substep leaves is less than half of what is kept in any case.
  near_ = thickness + std::max(0.5 * thickness, reach_);
  std::map<int, std::map<int, double>> volume;  // m3, by piece and material
  for (std::size_t t = 0; t < model_.tet_count(); ++t)
    volume[piece_[model_.tets[t][0]]][model_.material_of[t]] += model_.volume[t];
  std::map<std::string, std::vector<int>> pieces;  // by the name that they would have
  for (const auto& [piece, materials] : volume) {
    const int most =
        std::ranges::max_element(materials, {}, [](const auto& of) { return of.second; })->first;
    const std::string label = model_.label_names.empty() ? "" : model_.label_names[most];
    std::string name = self_contact;
    if (volume.size() > 1 && !label.empty()) name += "_" + label;
    std::ranges::replace_if(
        name, [](unsigned char c) { return !std::isalnum(c); }, '_');
    pieces[name].push_back(piece);
  }
  std::map<int, int> row;  // of a piece
  for (const auto& [name, alike] : pieces) {
    for (std::size_t k = 0; k < alike.size(); ++k) {
      row[alike[k]] = static_cast<int>(names_.size());
      names_.push_back(alike.size() > 1 ? name + "." + std::to_string(k + 1) : name);
    }
  }
  own_row_.resize(piece_.size());
  for (std::size_t v = 0; v < piece_.size(); ++v) own_row_[v] = row[piece_[v]];
}

void Reactions::find_self_contact(const State& state, std::vector<int>& by) const {
  constexpr double seam = -1e-3;  // as triangles of touch() (effects/self_contact.hpp) overlap
  std::vector<Vec3<double>> at = model_.rest;
  for (std::size_t v = 0; v < at.size(); ++v) at[v] += state.u[v];
  SurfacePairs pairs = *pairs_;
  pairs.place(at, near_);
  std::vector<int> found;
  const auto take = [&](int v) {
    if (by[v] < 0) by[v] = own_row_[v];
  };
  for (std::size_t t = 0; t < pairs.triangles().size(); ++t) {
    const auto& [a, b, c] = pairs.triangles()[t];
    pairs.find(at, static_cast<int>(t), found);
    for (const int v : found) {
      const Over over = over_triangle(at[v], at[a], at[b], at[c]);
      const bool above = over.b[0] >= seam && over.b[1] >= seam && over.b[2] >= seam;
      if (!above || std::abs(over.height) > near_) continue;
      for (const int touching : {v, a, b, c}) take(touching);
    }
  }
}

// Conjugate gradients, preconditioned by the diagonal.
std::vector<double> Reactions::shares(int name, const std::vector<int>& by) const {
  constexpr double enough = 1e-8;
  const std::size_t n = by.size();
  std::vector<double> x(n, 0.0), r(n, 0.0), z(n), p(n, 0.0), q(n), diagonal(n, 0.0);
  // From where it ends wherever nothing else holds a piece of the body.
  std::vector<char> its(n, 0), another(n, 0);  // of pieces
  for (std::size_t v = 0; v < n; ++v) {
    if (by[v] >= 0) (by[v] == name ? its : another)[piece_[v]] = 1;
  }
  for (std::size_t v = 0; v < n; ++v) {
    x[v] = by[v] >= 0 ? by[v] == name : its[piece_[v]] && !another[piece_[v]];
  }
  for (std::size_t e = 0; e < edges_.size(); ++e) {
    const auto [a, b] = edges_[e];
    const double weight = edges_.stiffness[e];
    diagonal[a] += weight, diagonal[b] += weight;
    if (by[a] < 0) r[a] += weight * (x[b] - x[a]);
    if (by[b] < 0) r[b] += weight * (x[a] - x[b]);
  }
  double old = 1.0, first = 0.0;
  for (std::size_t round = 0; round < n; ++round) {
    double rz = 0.0;
    for (std::size_t v = 0; v < n; ++v) z[v] = by[v] < 0 ? r[v] / diagonal[v] : 0.0;
    for (std::size_t v = 0; v < n; ++v) rz += r[v] * z[v];
    if (round == 0) first = rz;
    if (!(rz > enough * enough * first)) break;
    for (std::size_t v = 0; v < n; ++v) p[v] = z[v] + (round == 0 ? 0.0 : rz / old) * p[v];
    for (std::size_t v = 0; v < n; ++v) q[v] = diagonal[v] * p[v];
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      const auto [a, b] = edges_[e];
      q[a] -= edges_.stiffness[e] * p[b], q[b] -= edges_.stiffness[e] * p[a];
    }
    double pq = 0.0;
    for (std::size_t v = 0; v < n; ++v) pq += by[v] < 0 ? p[v] * q[v] : 0.0;
    const double step = rz / pq;
    for (std::size_t v = 0; v < n; ++v) {
      if (by[v] < 0) x[v] += step * p[v], r[v] -= step * q[v];
    }
    old = rz;
  }
  return x;
}

namespace {

// An obstacle at a vertex.
struct Touch {
  std::size_t name;
  Vec3<double> normal;  // out of it, 1
};

// What each of several obstacles has of a force on the vertex that they touch: they push along
// their normals, as much of it as they can (the least squares of what is left, by coordinate
// descent), and what is left, friction, in proportion.
std::vector<Vec3<double>> parts_of(const Vec3<double>& force, const std::vector<Touch>& touches) {
  constexpr int rounds = 200;
  std::vector<double> pushes(touches.size(), 0.0);
  Vec3<double> left = force;
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t k = 0; k < touches.size(); ++k) {
      const double push = std::max(0.0, pushes[k] + dot(touches[k].normal, left));
      left -= (push - pushes[k]) * touches[k].normal;
      pushes[k] = push;
    }
  }
  const double all = std::accumulate(pushes.begin(), pushes.end(), 0.0);
  std::vector<Vec3<double>> parts;
  for (std::size_t k = 0; k < touches.size(); ++k) {
    const double share = all > 0.0 ? pushes[k] / all : 1.0 / static_cast<double>(touches.size());
    parts.push_back(pushes[k] * touches[k].normal + share * left);
  }
  return parts;
}

}  // namespace

Reactions::Found Reactions::at(const FrameMotion& motion) const {
  const std::size_t n = model_.vertex_count();
  const State& state = *motion.state;
  const double time = static_cast<double>(state.step) * dt_;
  Found found{.of = std::vector<Resultant>(names_.size()), .contact = VertexField(n)};
  VertexField& lacking = found.contact;  // m a, less all that is known to act
  const auto add = [&](std::size_t name, std::size_t vertex, const Vec3<double>& force) {
    Resultant& sum = found.of[name];
    sum.force += force;
    sum.moment += cross(model_.rest[vertex] + state.u[vertex] - about_, force);
  };
  for (std::size_t i = 0; i < n; ++i) lacking[i] = model_.mass[i] * motion.acceleration[i];

  VertexField moved(n);  // over a substep
  for (std::size_t i = 0; i < n; ++i) moved[i] = acts_ * motion.velocity[i];
  const auto known = history_of_elements(on_, state);
  auto history = known.value_or(std::span<const double>());
  std::size_t name = 0;
  struct Obstacle {
    std::size_t name;
    // m, by which a vertex is led out of it that is moved by a step
    std::function<Vec3<double>(std::size_t, const Vec3<double>&)> push;
  };
  std::vector<Obstacle> obstacles;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    for (const auto& slot : std::get<i>(on_)) {
      if constexpr (Effect::kind == EffectKind::force) {
        for (std::size_t v = 0; v < n; ++v) {
          const Vec3<double> force =
              model_.mass[v] *
              Effect::acceleration(slot.device, model_.rest[v], state.u[v], motion.velocity[v]);
          lacking[v] -= force;
          add(name, v, force);
        }
      } else if constexpr (Effect::kind == EffectKind::element) {
        if constexpr (history_of < Effect >> 0) {
          if (!known) return;  // quasi-static: no branch acts
        }
        VertexField forces(n);
        if (std::is_same_v<Effect, NeoHookean> && tissue_) {
          forces = tissue_(model_, state);
        } else {
          add_forces<Effect>(slot, history, state.u, needs_rate<Effect> ? moved : VertexField{},
                             forces);
        }
        if constexpr (history_of < Effect >> 0)
          history = history.subspan(slot.vertices.size() * history_of<Effect>);
        for (std::size_t v = 0; v < n; ++v) {
          lacking[v] -= forces[v];
          if constexpr (is_outer<Effect>) add(name, v, forces[v]);
        }
      } else if constexpr (Effect::kind == EffectKind::contact) {
        obstacles.push_back({name, [&](std::size_t v, const Vec3<double>& step) {
                               return Effect::push(slot.device, Step<double>{0.0, time},
                                                   model_.rest[v], state.u[v], step);
                             }});
      }
      if constexpr (has_resultant<Effect>) ++name;
    }
  });

  std::vector<int> by = holder_;
  std::vector<char> holds(names_.size(), 0);
  std::map<std::size_t, std::vector<Touch>> several;  // of vertices that more than one touches
  for (std::size_t v = 0; v < n; ++v) {
    const double size = norm(lacking[v]);
    if (by[v] < 0 && size > 0.0) {
      double deepest = 0.0;
      std::vector<Touch> touches;
      for (const Obstacle& obstacle : obstacles) {
        const Vec3<double> push = obstacle.push(v, (-reach_ / size) * lacking[v]);
        const double depth = norm(push);
        if (depth > 0.0) touches.push_back({obstacle.name, (1.0 / depth) * push});
        if (depth > deepest) deepest = depth, by[v] = static_cast<int>(obstacle.name);
      }
      if (touches.size() > 1) several[v] = std::move(touches);
    }
  }
  if (pairs_) find_self_contact(state, by);
  for (std::size_t v = 0; v < n; ++v) {
    if (by[v] < 0) continue;
    const auto touches = several.find(v);
    if (touches == several.end()) {
      holds[static_cast<std::size_t>(by[v])] = 1;
      add(static_cast<std::size_t>(by[v]), v, lacking[v]);
      continue;
    }
    const std::vector<Vec3<double>> parts = parts_of(lacking[v], touches->second);
    for (std::size_t k = 0; k < parts.size(); ++k) {
      holds[touches->second[k].name] = 1;
      add(touches->second[k].name, v, parts[k]);
    }
  }
  std::vector<double> left(n, 1.0);  // of each vertex, that nothing takes over
  Vec3<double> handed_on;
  for (std::size_t k = 0; k < names_.size(); ++k) {
    if (!holds[k]) continue;
    const auto share = shares(static_cast<int>(k), by);
    for (std::size_t v = 0; v < n; ++v) {
      if (by[v] >= 0) continue;
      left[v] -= share[v];
      handed_on += share[v] * lacking[v];
      add(k, v, share[v] * lacking[v]);
    }
  }
  for (std::size_t v = 0; v < n; ++v) {
    if (by[v] < 0) add(names_.size() - 1, v, left[v] * lacking[v]);
  }
  found.handed_on = norm(handed_on);
  return found;
}

}  // namespace viscera::sim
