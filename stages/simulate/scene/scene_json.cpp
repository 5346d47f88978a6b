// scene.json: the scene as it ran.
#include <algorithm>

#include "sim/measures/stability.hpp"
#include "stages/simulate/scene/scene_file.hpp"

namespace viscera {
namespace {

template <class Params, class Value>
Json field_json(const sim::Field<Params, Value>& field, const Params& params) {
  return params.*field.member;
}
template <class Params>
Json field_json(const sim::Field<Params, sim::Vec3<double>>& field, const Params& params) {
  const auto& v = params.*field.member;
  return Json::array({v.x, v.y, v.z});
}

Json materials_json(const std::map<std::string, sim::Material>& materials) {
  Json json = Json::object();
  for (const auto& [name, m] : materials) {
    json[name] = {{"E", m.youngs_modulus},
                  {"nu", m.poisson_ratio},
                  {"density", m.density},
                  {"damping", m.damping}};
  }
  return json;
}

template <class Params, class Value>
Json unit_json(const sim::Field<Params, Value>& field) {
  return field.unit;
}
template <class Params>
Json unit_json(const sim::Field<Params, std::string>&) {
  return nullptr;  // a word
}

// The unit of each parameter of the effects that are on.
Json units_json(const sim::Effects::Choice& effects) {
  Json json = Json::object();
  sim::Effects::for_each([&]<class Effect, std::size_t i>() {
    if (std::get<i>(effects).empty()) return;
    Json& units = json[Effect::name] = Json::object();
    std::apply([&](const auto&... f) { ((units[f.name] = unit_json(f)), ...); }, Effect::fields());
  });
  return json;
}

Json effects_json(const sim::Effects::Choice& effects) {
  Json json = Json::object();
  sim::Effects::for_each([&]<class Effect, std::size_t i>() {
    Json named = Json::array();
    for (const auto& params : std::get<i>(effects)) {
      Json& effect = named.emplace_back(Json::object());
      std::apply([&](const auto&... f) { ((effect[f.name] = field_json(f, params)), ...); },
                 Effect::fields());
    }
    // As a scene is written: a map, or a list of maps for what is named several times.
    if (!named.empty()) json[Effect::name] = named.size() == 1 ? named[0] : named;
  });
  return json;
}

}  // namespace

Json to_json(const SceneFile& file) {
  Json json{{"scene", 1}, {"units", "SI"}};
  json["materials"] = materials_json(file.materials);
  json["effects"] = effects_json(file.scene.effects);
  json["effect_units"] = units_json(file.scene.effects);
  json["schedule"] = Json::array();
  for (const auto& change : file.schedule) {
    json["schedule"].push_back({{"at", change.at_s},
                                {"materials", materials_json(change.materials)},
                                {"effects", effects_json(change.effects)}});
  }
  const auto& scene = file.scene;
  json["time"] = {{"frame", scene.time.frame_s},
                  {"substeps", scene.time.substeps},
                  {"order", scene.time.order},
                  {"end", scene.time.end_s}};
  json["rest"] = {
      {"speed", scene.rest.speed}, {"hold", scene.rest.hold_s}, {"residual", scene.rest.residual}};
  for (const auto& [name, policy] : stability_policies()) {
    if (policy == scene.stability) json["stability"] = name;
  }
  if (scene.accuracy_limit > 0.0) json["accuracy_limit"] = scene.accuracy_limit;
  if (scene.force_hold_s > 0.0) json["force_hold"] = scene.force_hold_s;
  // Those that `form` has given to the corotational law.
  if (const std::size_t taken = sim::tets_taken(scene)) json["corotational_tets"] = taken;
  json["expect"] = Json::object();
  for (const auto& expected : file.expect) {
    Json& limits = json["expect"][expected.metric] = Json::object();
    if (expected.min) limits["min"] = *expected.min;
    if (expected.max) limits["max"] = *expected.max;
  }
  return json;
}

}  // namespace viscera
