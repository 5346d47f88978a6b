#include "stages/simulate/scene/scene_number.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
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

template <class Params, class Value>
double* number_in(Params& params, const sim::Field<Params, Value>& field, Names names) {
  if (names.empty() || names[0] != field.name) return nullptr;
  if constexpr (std::is_same_v<Value, double>) {
    if (names.size() == 1) return &(params.*field.member);
  } else if constexpr (std::is_same_v<Value, sim::Vec3<double>>) {
    auto& vector = params.*field.member;
    if (names.size() != 2) return nullptr;
    return names[1] == "x"   ? &vector.x
           : names[1] == "y" ? &vector.y
           : names[1] == "z" ? &vector.z
                             : nullptr;
  }
  return nullptr;
}

double* number_of(sim::Scene& scene, Names names) {
  double* found = nullptr;
  sim::Effects::for_each([&]<class Effect, std::size_t i>() {
    auto& named = std::get<i>(scene.effects);
    if (names.empty() || names[0] != Effect::name || named.empty()) return;
    Names rest = names.subspan(1);
    std::size_t which = 0;
    if (!rest.empty() && rest[0].size() == 1 && rest[0][0] >= '0' && rest[0][0] <= '9') {
      which = static_cast<std::size_t>(rest[0][0] - '0');
      rest = rest.subspan(1);
    }
    if (which >= named.size()) return;
    std::apply(
        [&](const auto&... field) {
          ((found = found ? found : number_in(named[which], field, rest)), ...);
        },
        Effect::fields());
  });
  return found;
}

}  // namespace

SceneNumber scene_number(SceneFile& file, const std::string& name, const std::string& where) {
  const std::vector<std::string> parts = parts_of(name);
  double* found = nullptr;
  bool is_ratio = false;
  if (parts.size() == 3 && parts[0] == "materials") {
    const auto material = file.materials.find(parts[1]);
    if (material != file.materials.end()) found = number_of(material->second, parts[2]);
    is_ratio = parts[2] == "nu";
  } else if (!parts.empty() && parts[0] == "effects") {
    found = number_of(file.scene, Names(parts).subspan(1));
  }
  if (!found) {
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
  double step = *found == 0.0 ? step_at_zero : relative_step * std::abs(*found);
  if (is_ratio) step = std::min(step, of_what_is_left * (0.5 - *found));
  return {*found, step};
}

}  // namespace viscera
