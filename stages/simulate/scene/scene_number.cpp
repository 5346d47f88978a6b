#include "stages/simulate/scene/scene_number.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <span>
#include <sstream>

#include "pipeline/base/error.hpp"

namespace viscera {
namespace {

// Large beside rounding, and its square small beside 1e-5.
constexpr double relative_step = 1e-4;
constexpr double step_at_zero = 1e-6;     // of the SI unit
constexpr double of_what_is_left = 1e-3;  // of 1/2 - nu, where forces grow without bound

std::vector<std::string> parts_of(const std::string& name) {
  std::vector<std::string> parts;
  std::istringstream words(name);
  for (std::string part; std::getline(words, part, '.');) parts.push_back(part);
  return parts;
}

double* number_of(sim::Material& material, const std::string& name) {
  return name == "E"         ? &material.youngs_modulus
         : name == "nu"      ? &material.poisson_ratio
         : name == "density" ? &material.density
         : name == "damping" ? &material.damping
                             : nullptr;
}

// The names that are left of a number of one effect: its field, and an axis.
using Names = std::span<const std::string>;

// A number and its range; null: there is none of this name.
struct Found {
  double* value = nullptr;
  double lo = 0.0, hi = 0.0;
};

// Whether a param says which vertices or tets an effect acts on: these are taken whole, and nothing
// changes with a small change of it.
template <class Params>
bool selects(const std::string& name) {
  bool found = false;
  if constexpr (std::derived_from<Params, sim::Selection>) {
    std::apply([&](const auto&... field) { ((found = found || name == field.name), ...); },
               sim::Selection::fields());
  }
  return found;
}

template <class Params, class Value>
Found number_in(Params& params, const sim::Field<Params, Value>& field, Names names) {
  if (names.empty() || names[0] != field.name || selects<Params>(names[0])) return {};
  if constexpr (std::is_same_v<Value, double>) {
    if (names.size() == 1) return {&(params.*field.member), field.lo, field.hi};
  } else if constexpr (std::is_same_v<Value, sim::Vec3<double>>) {
    auto& vector = params.*field.member;
    if (names.size() != 2) return {};
    double* const along = names[1] == "x"   ? &vector.x
                          : names[1] == "y" ? &vector.y
                          : names[1] == "z" ? &vector.z
                                            : nullptr;
    return {along, field.lo, field.hi};
  }
  return {};
}

Found number_of(sim::Scene& scene, Names names) {
  Found found;
  sim::Effects::for_each([&]<class Effect, std::size_t i>() {
    auto& named = std::get<i>(scene.effects);
    // A scene names the law, whatever its elements.
    if (names.empty() || named.empty()) return;
    if (names[0] != Effect::name && names[0] != sim::law_of<Effect>::name) return;
    Names rest = names.subspan(1);
    std::size_t which = 0;
    if (!rest.empty() && rest[0].size() == 1 && rest[0][0] >= '0' && rest[0][0] <= '9') {
      which = static_cast<std::size_t>(rest[0][0] - '0');
      rest = rest.subspan(1);
    }
    if (which >= named.size()) return;
    std::apply(
        [&](const auto&... field) {
          ((found = found.value ? found : number_in(named[which], field, rest)), ...);
        },
        Effect::fields());
  });
  return found;
}

Found number_of(SceneFile& file, const std::vector<std::string>& parts) {
  if (!parts.empty() && parts[0] == "effects")
    return number_of(file.scene, Names(parts).subspan(1));
  if (parts.size() != 3 || parts[0] != "materials") return {};
  const auto material = file.materials.find(parts[1]);
  const auto param = std::ranges::find(material_params(), parts[2], &Param::name);
  if (material == file.materials.end() || param == material_params().end()) return {};
  return {number_of(material->second, parts[2]), *param->lo, *param->hi};
}

}  // namespace

SceneNumber scene_number(SceneFile& file, const std::string& name, const std::string& where) {
  const Found found = number_of(file, parts_of(name));
  if (!found.value) {
    std::vector<std::string> materials;
    for (const auto& [known, material] : file.materials) materials.push_back(known);
    throw Error(ExitCode::bad_config,
                {.where = where,
                 .field = name,
                 .found = "no number of this scene",
                 .allowed = fmt::format(
                     "materials.NAME.E, nu or density of {}; effects.EFFECT.PARAM, with "
                     ".x, .y or .z where it is a vector, of {}",
                     fmt::join(materials, ", "), fmt::join(effects_on(file.scene), ", ")),
                 .remedy = "as in materials.liver.E"});
  }
  double& value = *found.value;
  double step = value == 0.0 ? step_at_zero : relative_step * std::abs(value);
  if (name.starts_with("materials.") && name.ends_with(".nu"))
    step = std::min(step, of_what_is_left * (0.5 - value));
  return {value, step, found.lo, found.hi};
}

}  // namespace viscera
