#include "stages/simulate/scene/scene_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <sstream>

#include "pipeline/base/error.hpp"
#include "pipeline/base/yaml_file.hpp"
#include "sim/base/is_any_of.hpp"
#include "stages/mesh/material_params.hpp"
#include "stages/simulate/scene/scene_change.hpp"

namespace viscera {
namespace fs = std::filesystem;

const std::vector<Param>& material_params() {
  static const std::vector<Param> params = [] {
    auto list = elastic_params();
    list.push_back(
        quantity("damping", "0 s", "s", 0.0, 1e4, "relaxation time of a Kelvin-Voigt solid"));
    return list;
  }();
  return params;
}

namespace {

// Of elasticity, of which a body has one.
template <class Effect>
constexpr bool is_law =
    sim::is_any_of<Effect, sim::NeoHookean, sim::SmoothedNeoHookean, sim::MooneyRivlin, sim::Ogden,
                   sim::Linear, sim::StVK, sim::Corotational>;

// `element` decides on it, and no scene names it. (Smoothed Neo-Hookean tissue may be named: it was
// before there was `element`.)
template <class Effect>
constexpr bool is_of_element = std::is_same_v<Effect, sim::GroupedVolume> ||
                               (sim::is_smoothed<Effect> &&
                                !std::is_same_v<Effect, sim::SmoothedNeoHookean>);

const std::vector<Param>& time_params() {
  const sim::TimeGrid grid;
  static const std::vector<Param> params = {
      quantity("frame_rate", fmt::format("{} Hz", 1.0 / grid.frame_s), "Hz", 1.0, 1e5,
               "frames kept per second"),
      {.name = "substeps",
       .type = ParamType::integer,
       .fallback = fewest_substeps,
       .lo = 1.0,
       .hi = 1e6,
       .choices = {fewest_substeps},
       .doc = "steps a frame; auto: the fewest that stability, motion and rest ask for"},
      {.name = "order",
       .type = ParamType::integer,
       .fallback = grid.order,
       .lo = 1.0,
       .hi = 2.0,
       .doc = "of XPBD's time step: 2, BDF2 (in blocks a rule like it), or 1, backward Euler, "
              "which loses energy"},
      quantity("end", fmt::format("{} s", grid.end_s), "s", 1e-6, 1e5, "longest simulated time")};
  return params;
}

const std::vector<Param>& rest_params() {
  const sim::RestCriterion rest;
  static const std::vector<Param> params = {
      quantity("speed", fmt::format("{} m/s", rest.speed), "m/s", 0.0, 1e3,
               "the fastest vertex of a body at rest"),
      quantity("hold", fmt::format("{} s", rest.hold_s), "s", 0.0, 1e3, "for at least"),
      quantity(
          "residual", rest.residual, "1", 0.0, 1e9,
          "of a body at rest: the force that it lacks of equilibrium, as a share of its loads")};
  return params;
}

class SceneReader {
 public:
  explicit SceneReader(const fs::path& path) : path_(path) {}

  SceneFile read(const Json& changes) {
    const YAML::Node root = load_yaml(path_);
    expect_map(root, "scene");
    change_scene(root, changes, path_);
    check_keys(root, "",
               {"scene", "materials", "effects", "element", "schedule", "time", "rest", "stability",
                "accuracy_limit", "expect"});
    if (!root["scene"] || root["scene"].Scalar() != "1") {
      throw fail(root, "scene", "missing or another version",
                 "scene: 1, the version of the schema");
    }
    read_materials(root["materials"]);
    read_effects(root["effects"]);
    read_element(root["element"]);
    read_grid(root);
    read_schedule(root["schedule"]);
    read_stability(root["stability"]);
    read_accuracy_limit(root["accuracy_limit"]);
    read_expect(root["expect"]);
    return std::move(file_);
  }

 private:
  Error fail(const YAML::Node& node, std::string field, std::string found, std::string allowed,
             std::string remedy = "") const {
    return Error(ExitCode::bad_config, {.where = place_of(path_, node),
                                        .field = std::move(field),
                                        .found = std::move(found),
                                        .allowed = std::move(allowed),
                                        .remedy = std::move(remedy)});
  }

  void expect_map(const YAML::Node& node, const std::string& field) const {
    if (!node.IsMap()) throw fail(node, field, "not a map", "NAME: VALUE lines");
  }

  void check_keys(const YAML::Node& map, const std::string& prefix,
                  const std::vector<std::string>& names) const {
    for (const auto& item : map) {
      const auto& name = item.first.Scalar();
      if (std::ranges::count(names, name)) continue;
      throw fail(item.first, prefix + name, "unknown key", "", suggest(name, names));
    }
  }

  static Json value(const YAML::Node& node) {
    if (node.IsScalar()) return value_from_text(node.Scalar());
    if (!node.IsSequence()) return nullptr;
    Json list = Json::array();
    for (const auto& item : node) list.push_back(value(item));
    return list;
  }

  // Every param of `map` (which may be empty or absent), each error at its own line.
  Json resolve_map(const std::vector<Param>& params, const YAML::Node& map,
                   const std::string& prefix) const {
    const bool present = map.IsDefined() && !map.IsNull();
    if (present) expect_map(map, prefix.substr(0, prefix.size() - 1));
    std::vector<std::string> names;
    for (const auto& param : params) names.push_back(param.name);
    if (present) check_keys(map, prefix, names);
    Json resolved = Json::object();
    for (const auto& param : params) {
      const YAML::Node node = present ? map[param.name] : YAML::Node(YAML::NodeType::Undefined);
      const bool given = node.IsDefined();
      if (!given && param.fallback.is_null()) {
        throw fail(map, prefix + param.name, "missing", param.doc + " in " + param.unit);
      }
      resolved[param.name] =
          resolve_required(param, given ? value(node) : param.fallback,
                           given ? place_of(path_, node) : path_.string(), prefix + param.name);
    }
    return resolved;
  }

  void read_materials(const YAML::Node& node) {
    if (!node || !node.IsMap() || node.size() == 0) {
      throw Error(ExitCode::bad_config, {.where = path_.string(),
                                         .field = "materials",
                                         .found = "missing",
                                         .allowed = "one material for each label of the mesh"});
    }
    for (const auto& item : node) {
      const std::string& name = item.first.Scalar();
      if (item.second.IsNull()) {
        throw fail(item.first, "materials." + name, "empty", "{E: 5kPa, nu: 0.45, density: …}");
      }
      const Json m = resolve_map(material_params(), item.second, "materials." + name + ".");
      file_.materials[name] = {.youngs_modulus = m["E"],
                               .poisson_ratio = m["nu"],
                               .density = m["density"],
                               .damping = m["damping"]};
    }
  }

  void read_effects(const YAML::Node& node) {
    if (!node || !node.IsMap()) {
      throw Error(ExitCode::bad_config, {.where = path_.string(),
                                         .field = "effects",
                                         .found = "missing",
                                         .allowed = "the effects that are on, by name"});
    }
    std::vector<std::string> names = effect_names();
    sim::Effects::for_each([&]<class Effect, std::size_t>() {
      if constexpr (is_of_element<Effect>) std::erase(names, Effect::name);
    });
    check_keys(node, "effects.", names);
    sim::Effects::for_each([&]<class Effect, std::size_t i>() {
      const YAML::Node named = node[Effect::name];
      if (!named) return;
      auto& all = std::get<i>(file_.scene.effects);
      if (!named.IsSequence()) return read_fields<Effect>(named, all.emplace_back());
      for (const auto& item : named) read_fields<Effect>(item, all.emplace_back());
    });
    check_one_law(node);
  }

  // Each law has all of a label's E and nu: two of them are a tissue twice as stiff. The terms of
  // Ogden's are one law.
  void check_one_law(const YAML::Node& node) const {
    std::vector<std::string> laws;
    sim::Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (is_law<Effect>) {
        const std::size_t terms = std::get<i>(file_.scene.effects).size();
        const bool is_sum = std::is_same_v<Effect, sim::Ogden>;
        laws.insert(laws.end(), is_sum ? std::min<std::size_t>(terms, 1) : terms, Effect::name);
      }
    });
    if (laws.size() < 2) return;
    throw fail(node, "effects." + laws[1], "beside " + laws[0],
               "one law of elasticity, which has all of E and nu", "take one of them away");
  }

  void read_element(const YAML::Node& node) {
    if (!node) return;
    const auto found = node.IsScalar() ? elements().find(node.Scalar()) : elements().end();
    if (found == elements().end()) {
      throw fail(node, "element", node.IsScalar() ? "'" + node.Scalar() + "'" : "not a word",
                 "auto | linear | smoothed");
    }
    file_.element = found->second;
    if (file_.element == sim::Element::smoothed && !sim::has_law_to_smooth(file_.scene)) {
      throw fail(node, "element", "smoothed, without " + sim::laws_to_smooth(),
                 "smoothed elements of these; other laws have linear tets",
                 "name one of them under effects, or leave element out");
    }
  }

  // Each change starts from what holds before it.
  void read_schedule(const YAML::Node& node) {
    if (!node || node.IsNull()) return;
    const char* const example = "- {at: 0.5 s, materials: {LABEL: {E: 20 kPa}}, effects: {…}}";
    if (!node.IsSequence()) throw fail(node, "schedule", "not a list", example);
    const Param at = quantity("at", nullptr, "s", 0.0, 1e5, "from when on");
    SceneChange now{0.0, file_.materials, file_.scene.effects};
    for (const auto& item : node) {
      expect_map(item, "schedule");
      check_keys(item, "schedule.", {"at", "materials", "effects"});
      if (!item["at"]) throw fail(item, "schedule.at", "missing", example);
      const double before = now.at_s;
      now.at_s =
          resolve_required(at, value(item["at"]), place_of(path_, item["at"]), "schedule.at");
      if (!(now.at_s > before)) {
        throw fail(item["at"], "schedule.at", fmt::format("{} s", now.at_s),
                   fmt::format("later than {} s: changes in the order of time", before));
      }
      change_materials(item["materials"], now.materials);
      const auto last = now.effects;
      change_effects(item["effects"], now.effects);
      // From where it is in the frame that the change begins with.
      const double frame_s = file_.scene.time.frame_s;
      sim::go_on_from(last, now.effects, frame_s * std::ceil(now.at_s / frame_s - 1e-6));
      file_.schedule.push_back(now);
    }
  }

  void change_materials(const YAML::Node& node, std::map<std::string, sim::Material>& materials) {
    if (!node || node.IsNull()) return;
    expect_map(node, "schedule.materials");
    std::vector<std::string> known;
    for (const auto& [name, material] : materials) known.push_back(name);
    check_keys(node, "schedule.materials.", known);
    for (const auto& item : node) {
      const std::string name = item.first.Scalar();
      sim::Material& m = materials.at(name);
      // Masses are those of the start.
      std::vector<Param> params = material_params();
      std::erase_if(params, [](const Param& param) { return param.name == "density"; });
      const Json now{{"E", m.youngs_modulus}, {"nu", m.poisson_ratio}, {"damping", m.damping}};
      for (Param& param : params) {
        param.fallback = fallback(now[param.name].get<double>(), param.unit);
      }
      const Json given = resolve_map(params, item.second, "schedule.materials." + name + ".");
      m.youngs_modulus = given["E"], m.poisson_ratio = given["nu"], m.damping = given["damping"];
    }
  }

  void change_effects(const YAML::Node& node, sim::Effects::Choice& effects) {
    if (!node || node.IsNull()) return;
    expect_map(node, "schedule.effects");
    check_keys(node, "schedule.effects.", effects_on(file_.scene));
    sim::Effects::for_each([&]<class Effect, std::size_t i>() {
      const YAML::Node named = node[Effect::name];
      if (!named) return;
      const std::string field = std::string("schedule.effects.") + Effect::name;
      auto& all = std::get<i>(effects);
      const std::size_t given = named.IsSequence() ? named.size() : 1;
      if (given != all.size()) {
        throw fail(named, field, fmt::format("{} of them", given),
                   fmt::format("{}, as the scene names it", all.size()),
                   "give {} for one that stays as it is");
      }
      for (std::size_t k = 0; k < given; ++k) {
        read_fields<Effect>(named.IsSequence() ? named[k] : named, all[k], "schedule.");
      }
    });
  }

  // What would be ignored, or taken to be 0, is refused.
  void check_selection(const YAML::Node& node, const std::string& prefix) const {
    if (!node.IsMap()) return;
    const auto is_given = [&node](const char* key) { return static_cast<bool>(node[key]); };
    if (is_given("box_lo") != is_given("box_hi")) {
      throw fail(node, prefix + (is_given("box_lo") ? "box_hi" : "box_lo"), "missing",
                 "both corners of the box, least and greatest x, y, z");
    }
    if (is_given("within") && !is_given("side") && !is_given("near")) {
      throw fail(node["within"], prefix + "within", "given without side or near",
                 "a distance from these", "take it away, or say from what");
    }
  }

  // What is not given stays as it is in `params`.
  template <class Effect>
  void read_fields(const YAML::Node& node, typename Effect::Params& params,
                   const std::string& parent = "") {
    const std::string prefix = parent + "effects." + Effect::name + ".";
    std::vector<Param> declared;
    std::apply([&](const auto&... field) { (declared.push_back(declare(field, params)), ...); },
               Effect::fields());
    const Json values = resolve_map(declared, node, prefix);
    if constexpr (std::derived_from<typename Effect::Params, sim::Selection>) {
      if (parent.empty()) check_selection(node, prefix);  // a schedule gives what changes alone
    }
    std::apply(
        [&](const auto&... field) { (assign(field, values[field.name], params, prefix), ...); },
        Effect::fields());
  }

  template <class Params>
  static Param declare(const sim::Field<Params, double>& field, const Params& defaults) {
    return quantity(field.name, fallback(defaults.*field.member, field.unit), field.unit, field.lo,
                    field.hi, field.doc);
  }
  template <class Params>
  static Param declare(const sim::Field<Params, sim::Vec3<double>>& field, const Params& defaults) {
    const auto& v = defaults.*field.member;
    Json list = Json::array(
        {fallback(v.x, field.unit), fallback(v.y, field.unit), fallback(v.z, field.unit)});
    return {.name = field.name,
            .type = ParamType::list,
            .fallback = list[0].is_null() ? Json(nullptr) : std::move(list),
            .unit = field.unit,
            .doc = field.doc};
  }
  // As a scene would write it; null for what it has to give.
  static Json fallback(double value, const std::string& unit) {
    if (std::isnan(value)) return nullptr;
    return unit == "1" ? Json(value) : Json(fmt::format("{} {}", value, unit));
  }

  template <class Params>
  static Param declare(const sim::Field<Params, std::string>& field, const Params& defaults) {
    Param param{.name = field.name,
                .type = ParamType::text,
                .fallback = defaults.*field.member,
                .doc = field.doc};
    std::istringstream choices(field.choices);
    for (std::string choice; std::getline(choices, choice, '|');) param.choices.push_back(choice);
    if (!param.choices.empty()) param.choices.emplace_back();
    return param;
  }

  template <class Params>
  void assign(const sim::Field<Params, double>& field, const Json& value, Params& params,
              const std::string&) const {
    params.*field.member = value;
  }
  template <class Params>
  void assign(const sim::Field<Params, std::string>& field, const Json& value, Params& params,
              const std::string&) const {
    params.*field.member = value;
  }
  template <class Params>
  void assign(const sim::Field<Params, sim::Vec3<double>>& field, const Json& value, Params& params,
              const std::string& prefix) const {
    const Param component =
        quantity(field.name, nullptr, field.unit, field.lo, field.hi, field.doc);
    if (value.size() != 3) {
      throw Error(ExitCode::bad_config, {.where = path_.string(),
                                         .field = prefix + field.name,
                                         .found = value.dump(),
                                         .allowed = "three numbers, [x, y, z]"});
    }
    std::array<double, 3> v;
    for (int i = 0; i < 3; ++i) {
      const Json number =
          resolve_required(component, value[i], path_.string(), prefix + field.name);
      if (number.is_null()) {
        throw Error(ExitCode::bad_config, {.where = path_.string(),
                                           .field = prefix + field.name,
                                           .found = value.dump(),
                                           .allowed = "three numbers, [x, y, z]"});
      }
      v[i] = number;
    }
    params.*field.member = {v[0], v[1], v[2]};
  }

  void read_grid(const YAML::Node& root) {
    const Json time = resolve_map(time_params(), root["time"], "time.");
    file_.scene.time = {.frame_s = 1.0 / time["frame_rate"].get<double>(),
                        .end_s = time["end"],
                        .order = time["order"]};
    set_substeps(time["substeps"], file_.scene.time);
    const Json rest = resolve_map(rest_params(), root["rest"], "rest.");
    file_.scene.rest = {
        .speed = rest["speed"], .hold_s = rest["hold"], .residual = rest["residual"]};
  }

  void read_stability(const YAML::Node& node) {
    if (!node) return;
    const auto found =
        node.IsScalar() ? stability_policies().find(node.Scalar()) : stability_policies().end();
    if (found == stability_policies().end()) {
      throw fail(node, "stability", node.IsScalar() ? "'" + node.Scalar() + "'" : "not a word",
                 "refuse | warn | substeps | form");
    }
    file_.scene.stability = found->second;
  }

  void read_accuracy_limit(const YAML::Node& node) {
    if (!node) return;
    const Param limit = quantity("accuracy_limit", nullptr, "1", 1e-6, 1.0,
                                 "what XPBD's own error at rest may be, as a share");
    const Json given = resolve_value(limit, value(node), path_.string(), "accuracy_limit");
    if (!given.is_null()) file_.scene.accuracy_limit = given;
  }

  void read_expect(const YAML::Node& node) {
    if (!node || node.IsNull()) return;
    expect_map(node, "expect");
    for (const auto& item : node) {
      const std::string metric = item.first.Scalar(), field = "expect." + metric;
      expect_map(item.second, field);
      check_keys(item.second, field + ".", {"min", "max"});
      Expectation expectation{.metric = metric};
      const auto bound = [&](const char* key) -> std::optional<double> {
        const YAML::Node limit = item.second[key];
        if (!limit) return std::nullopt;
        const Json number = value(limit);
        if (!number.is_number()) {
          throw fail(limit, field + "." + key, number.dump(), "a number in the metric's unit");
        }
        return number.get<double>();
      };
      expectation.min = bound("min");
      expectation.max = bound("max");
      if (!expectation.min && !expectation.max) {
        throw fail(item.second, field, "neither min nor max", "{min: NUMBER, max: NUMBER}, or one");
      }
      if (expectation.min > expectation.max && expectation.max) {
        throw fail(item.second, field,
                   fmt::format("min {} above max {}", *expectation.min, *expectation.max),
                   "min at most max", "exchange the two");
      }
      file_.expect.push_back(std::move(expectation));
    }
  }

  fs::path path_;
  SceneFile file_;
};

}  // namespace

void set_substeps(const Json& given, sim::TimeGrid& time) {
  time.fewest_substeps = given.is_string();
  time.substeps = given.is_string() ? 1 : given.get<int>();
}

SceneFile read_scene(const fs::path& path, const Json& changes) {
  return SceneReader(path).read(changes);
}

const std::map<std::string, std::optional<sim::Element>>& elements() {
  static const std::map<std::string, std::optional<sim::Element>> elements = {
      {"auto", std::nullopt},
      {"linear", sim::Element::linear},
      {"smoothed", sim::Element::smoothed}};
  return elements;
}

const std::map<std::string, sim::StabilityPolicy>& stability_policies() {
  static const std::map<std::string, sim::StabilityPolicy> policies = {
      {"refuse", sim::StabilityPolicy::refuse},
      {"warn", sim::StabilityPolicy::warn},
      {"substeps", sim::StabilityPolicy::substeps},
      {"form", sim::StabilityPolicy::form}};
  return policies;
}

std::vector<std::string> effect_names() {
  std::vector<std::string> names;
  sim::Effects::for_each([&]<class Effect, std::size_t>() { names.emplace_back(Effect::name); });
  return names;
}

std::vector<std::string> effects_on(const sim::Scene& scene) {
  std::vector<std::string> names;
  sim::Effects::for_each([&]<class Effect, std::size_t i>() {
    if (!std::get<i>(scene.effects).empty()) names.emplace_back(Effect::name);
  });
  return names;
}

}  // namespace viscera
