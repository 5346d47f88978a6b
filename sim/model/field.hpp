// A parameter as a scene writes it: what effects and selections declare of theirs, from which the
// scene's keys, `describe` and the documentation derive.
#pragma once

#include <limits>
#include <string>
#include <tuple>

#include "sim/base/math.hpp"
#include "sim/base/refusal.hpp"

namespace viscera::sim {

// The default of a parameter that a scene has to give.
inline constexpr double required = std::numeric_limits<double>::quiet_NaN();

// One parameter as a scene writes it. `member` points into the Params of its effect or selection;
// its type is double, Vec3<double> or std::string. Closed range [lo, hi] in the SI unit named, of
// every component.
template <class Params, class Value>
struct Field {
  const char* name;
  const char* unit;
  Value Params::*member;
  double lo, hi;
  const char* doc;
};

// A parameter of type std::string: one of `choices`, "a|b|c", or empty; without choices any word.
template <class Params>
struct Field<Params, std::string> {
  const char* name;
  const char* choices;
  std::string Params::*member;
  const char* doc;
};

template <class Params, class Value>
Field(const char*, const char*, Value Params::*, double, double, const char*)
    -> Field<Params, Value>;
template <class Params>
Field(const char*, const char*, std::string Params::*, const char*) -> Field<Params, std::string>;

// A field of a part that Params derives from, as one of Params.
template <class Params, class Part, class Value>
constexpr Field<Params, Value> field_of(const Field<Part, Value>& f) {
  return {f.name, f.unit, f.member, f.lo, f.hi, f.doc};
}
template <class Params, class Part>
constexpr Field<Params, std::string> field_of(const Field<Part, std::string>& f) {
  return {f.name, f.choices, f.member, f.doc};
}
template <class Params, class... Part>
constexpr auto fields_of(const std::tuple<Part...>& part) {
  return std::apply([](const auto&... f) { return std::tuple{field_of<Params>(f)...}; }, part);
}

// For an effect's check(): a vector that is to have a direction.
inline void require_direction(const Vec3<double>& vector, const std::string& field,
                              const std::string& example) {
  if (norm(vector) > 0.0) return;
  throw Refusal(Refusal::Cause::scene, field, "a vector of length 0",
                "a direction, for example " + example);
}

}  // namespace viscera::sim
