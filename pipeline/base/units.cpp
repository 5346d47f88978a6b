#include "pipeline/base/units.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <charconv>
#include <cmath>
#include <optional>

namespace viscera {
namespace {

struct Unit {
  std::string_view name;
  std::string_view dimension;
  double factor;  // to the SI unit of the dimension
};

constexpr double pi = 3.14159265358979323846;

constexpr std::array units = {
    Unit{"1", "number", 1.0},
    Unit{"%", "number", 1e-2},
    Unit{"m", "length", 1.0},
    Unit{"cm", "length", 1e-2},
    Unit{"mm", "length", 1e-3},
    Unit{"um", "length", 1e-6},
    Unit{"m3", "volume", 1.0},
    Unit{"l", "volume", 1e-3},
    Unit{"ml", "volume", 1e-6},
    Unit{"mm3", "volume", 1e-9},
    Unit{"s", "time", 1.0},
    Unit{"ms", "time", 1e-3},
    Unit{"us", "time", 1e-6},
    Unit{"min", "time", 60.0},
    Unit{"Pa", "pressure", 1.0},
    Unit{"kPa", "pressure", 1e3},
    Unit{"MPa", "pressure", 1e6},
    Unit{"GPa", "pressure", 1e9},
    Unit{"Pa.s", "viscosity", 1.0},
    Unit{"kg/m3", "density", 1.0},
    Unit{"g/cm3", "density", 1e3},
    Unit{"g/ml", "density", 1e3},
    Unit{"kg", "mass", 1.0},
    Unit{"g", "mass", 1e-3},
    Unit{"N", "force", 1.0},
    Unit{"mN", "force", 1e-3},
    Unit{"Pa/m", "stiffness per area", 1.0},
    Unit{"kPa/m", "stiffness per area", 1e3},
    Unit{"kPa/mm", "stiffness per area", 1e6},
    Unit{"N/m3", "stiffness per area", 1.0},
    Unit{"m/s", "velocity", 1.0},
    Unit{"mm/s", "velocity", 1e-3},
    Unit{"m/s2", "acceleration", 1.0},
    Unit{"1/s", "rate", 1.0},
    Unit{"/s", "rate", 1.0},
    Unit{"Hz", "rate", 1.0},
    Unit{"rad", "angle", 1.0},
    Unit{"deg", "angle", pi / 180.0},
};

std::optional<Unit> find(std::string_view name) {
  for (const auto& unit : units) {
    if (unit.name == name) return unit;
  }
  return std::nullopt;
}

std::string names_of(std::string_view dimension) {
  std::vector<std::string_view> names;
  for (const auto& unit : units) {
    if (unit.dimension == dimension) names.push_back(unit.name);
  }
  return fmt::format("{}", fmt::join(names, ", "));
}

// Drops blanks and the '^' of "m/s^2", and reads the superscripts of "m/s²" and "kg/m³".
std::string normalised(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const std::string_view rest = text.substr(i);
    if (rest.starts_with("\u00b2") || rest.starts_with("\u00b3")) {
      out += rest.starts_with("\u00b2") ? '2' : '3';
      ++i;
    } else if (text[i] != ' ' && text[i] != '^') {
      out += text[i];
    }
  }
  return out;
}

}  // namespace

double parse_quantity(std::string_view text, std::string_view unit, const std::string& where,
                      const std::string& field) {
  const auto target = find(unit);
  if (!target) {
    throw Error(ExitCode::internal, {.field = field, .found = fmt::format("unit '{}'", unit)});
  }
  const auto fail = [&](std::string_view why) -> Error {
    const bool number = target->dimension == "number";
    return Error(ExitCode::bad_config,
                 {.where = where,
                  .field = field,
                  .found = fmt::format("'{}' {}", text, why),
                  .allowed = number ? std::string("a finite number")
                                    : fmt::format("a {} with its unit ({})", target->dimension,
                                                  names_of(target->dimension)),
                  .remedy = number ? "" : fmt::format("write for example '5{}'", unit)});
  };
  std::string_view number = text;
  while (number.starts_with(' ')) number.remove_prefix(1);
  if (number.starts_with('+')) number.remove_prefix(1);
  double value = 0.0;
  const char* end = number.data() + number.size();
  const auto [rest, failure] = std::from_chars(number.data(), end, value);
  if (failure != std::errc{} || !std::isfinite(value)) throw fail("is not a finite number");
  // The number is read before blanks are dropped: "10 1/s" is not 101/s.
  const std::string suffix = normalised({rest, static_cast<std::size_t>(end - rest)});
  if (suffix.empty()) {
    if (target->dimension == "number") return value;
    throw fail("has no unit");
  }
  const auto given = find(suffix);
  if (!given) throw fail(fmt::format("has an unknown unit '{}'", suffix));
  if (given->dimension != target->dimension) {
    throw fail(fmt::format("is a {}, not a {}", given->dimension, target->dimension));
  }
  return value * (given->factor / target->factor);
}

}  // namespace viscera
