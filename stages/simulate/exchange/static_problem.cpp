#include "stages/simulate/exchange/static_problem.hpp"

#include <algorithm>
#include <optional>
#include <type_traits>

#include "sim/base/is_any_of.hpp"
#include "sim/base/refusal.hpp"
#include "sim/base/tet_face.hpp"
#include "sim/solvers/fem/mesh.hpp"
#include "stages/mesh/export_text.hpp"
#include "stages/simulate/scene/schedule.hpp"

namespace viscera {
namespace {

using export_text::mm_per_m, export_text::mpa_per_pa;

// To the static problem: what has no force at rest, and groups of tets, which have a part of the
// law that smoothed elements beside them name.
template <class Effect>
constexpr bool adds_nothing =
    sim::is_any_of<Effect, sim::Viscosity, sim::Prony, sim::GroupedVolume>;

template <class Effect>
constexpr std::optional<ElasticLaw> law_of() {
  using namespace sim;
  if (std::is_same_v<sim::law_of<Effect>, NeoHookean>) return ElasticLaw::neo_hookean;
  if (std::is_same_v<sim::law_of<Effect>, MooneyRivlin>) return ElasticLaw::mooney_rivlin;
  if (std::is_same_v<sim::law_of<Effect>, Ogden>) return ElasticLaw::ogden;
  if (std::is_same_v<sim::law_of<Effect>, StVK>) return ElasticLaw::stvk;
  if (std::is_same_v<sim::law_of<Effect>, Linear>) return ElasticLaw::linear;
  return {};
}

// StaticProblem::law_shape
double shape_of(const sim::MooneyRivlinParams& params) {
  return params.second;
}
double shape_of(const sim::OgdenParams& params) {
  return params.exponent;
}

[[noreturn]] void refuse(std::string found) {
  throw sim::Refusal(
      sim::Refusal::Cause::scene, "formats", std::move(found),
      "a static problem of one law (neo_hookean, mooney_rivlin, ogden, stvk or linear) "
      "with gravity, "
      "fixed, prescribed, spring, load and pressure");
}

class Collector {
 public:
  Collector(const sim::Model& model, int order, double end_s)
      : nodes_(model, order), body_(nodes_.body(model)), end_s_(end_s) {}

  StaticProblem collect(const sim::Scene& scene, const TetMesh& mesh) {
    take_mesh(mesh);
    const std::size_t vertices = mesh.points.size();
    led_.resize(vertices), is_led_ = body_.fixed;
    is_led_.resize(vertices);
    sim::Effects::for_each([&]<class Effect, std::size_t i>() {
      for (const auto& params : std::get<i>(scene.effects)) take<Effect>(params);
    });
    if (!law_) refuse("no elastic effect");
    out_.law = *law_;
    hold();
    return std::move(out_);
  }

 private:
  void take_mesh(const TetMesh& mesh) {
    out_.nodes = mesh.points;
    for (const auto& [a, b] : nodes_.parents) {
      const auto &p = mesh.points[a], &q = mesh.points[b];
      out_.nodes.push_back({0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), 0.5 * (p[2] + q[2])});
    }
    out_.element_nodes = nodes_.order == 1 ? 4 : 10;
    const auto take_elements = [this](const auto& elements) {
      for (const auto& element : elements) {
        out_.elements.emplace_back();
        std::copy(element.nodes.begin(), element.nodes.end(), out_.elements.back().begin());
      }
    };
    take_elements(nodes_.linear), take_elements(nodes_.quadratic);
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      StaticProblem::Label& label = out_.labels[mesh.labels[t]];
      if (label.elements.empty()) {
        label.name = mesh.label_names.at(mesh.labels[t]);
        label.material = body_.materials[body_.material_of[t]];
      }
      label.elements.push_back(static_cast<int>(t));
    }
  }

  template <class Effect>
  void take(const typename Effect::Params& params) {
    if constexpr (std::is_same_v<Effect, sim::Gravity>) {
      out_.gravity += mm_per_m * sim::Gravity::vector(params);
    } else if constexpr (Effect::kind == sim::EffectKind::motion) {
      const auto path = Effect::template device<double>(body_, params);
      for (const int v : Effect::vertices(body_, params)) {
        is_led_[v] = 1;
        led_[v] = mm_per_m * Effect::target(path, body_.rest[v], end_s_);
      }
    } else if constexpr (std::is_same_v<Effect, sim::Load>) {
      const sim::LoadedNodes loaded = sim::Load::elements(body_, params);
      for (std::size_t i = 0; i < loaded.size(); ++i)
        out_.forces[loaded[i][0]] += loaded.share[i] * params.force;
    } else if constexpr (std::is_same_v<Effect, sim::Spring>) {
      const sim::PatchNodes patch = sim::Spring::elements(body_, params);
      for (std::size_t i = 0; i < patch.size(); ++i)
        out_.beds[patch[i][0]] += params.stiffness * patch.area[i] / mm_per_m;
    } else if constexpr (std::is_same_v<Effect, sim::Pressure>) {
      push(sim::Pressure::elements(body_, params), mpa_per_pa * params.pressure);
    } else if constexpr (law_of<Effect>().has_value()) {
      if (law_ && law_ != law_of<Effect>()) refuse("two elastic laws at once");
      if constexpr (requires { shape_of(params); }) {
        if (law_) refuse("several terms of one elastic law");
        out_.law_shape = shape_of(params);
      }
      law_ = law_of<Effect>();
    } else if constexpr (!adds_nothing<Effect>) {
      refuse(std::string("effects.") + Effect::name);
    }
  }

  void push(const std::vector<sim::Triangle>& triangles, double pressure) {
    if (faces_.empty()) {
      for (std::size_t t = 0; t < body_.tet_count(); ++t) {
        for (int opposite = 0; opposite < 4; ++opposite) {
          sim::Triangle face = sim::face_of_tet(body_.tets[t], opposite);
          std::ranges::sort(face);
          faces_[face] = {static_cast<int>(t), opposite};  // of the surface: one tet's alone
        }
      }
    }
    for (sim::Triangle triangle : triangles) {
      std::ranges::sort(triangle);
      const auto [tet, opposite] = faces_.at(triangle);
      out_.pushed.push_back({tet, opposite, pressure});
    }
  }

  // Nodes between two that are held are held, too, as in the finite elements here.
  void hold() {
    for (std::size_t v = 0; v < led_.size(); ++v) {
      if (is_led_[v]) out_.held[static_cast<int>(v)] = led_[v];
    }
    for (std::size_t m = 0; m < nodes_.parents.size(); ++m) {
      const auto [a, b] = nodes_.parents[m];
      if (is_led_[a] && is_led_[b])
        out_.held[static_cast<int>(led_.size() + m)] = 0.5 * (led_[a] + led_[b]);
    }
  }

  sim::FemMesh nodes_;
  sim::Model body_;
  double end_s_;
  StaticProblem out_;
  std::optional<ElasticLaw> law_;
  std::vector<sim::Vec3<double>> led_;  // [vertices] mm
  std::vector<char> is_led_;            // [vertices]
  std::map<sim::Triangle, std::pair<int, int>> faces_;
};

}  // namespace

StaticProblem static_problem(const SceneFile& file, const TetMesh& mesh, const sim::Model& model) {
  if (!model.youngs_modulus.empty()) refuse("a measured stiffness in every tet");
  sim::Model body = model;
  sim::Scene scene = file.scene;
  const Schedule schedule(file);
  schedule.set(schedule.count() - 1, body, scene);
  const bool linear = file.element.value_or(sim::Element::linear) == sim::Element::linear;
  return Collector(body, linear ? 1 : 2, scene.time.end_s).collect(scene, mesh);
}

const std::vector<SceneFormat>& scene_formats() {
  static const std::vector<SceneFormat> table{
      {"inp", "scene.inp", "the body with supports and loads at the end, for CalculiX and Abaqus",
       write_scene_inp},
      {"feb", "scene.feb", "the same for FEBio 4", write_scene_feb}};
  return table;
}

}  // namespace viscera
