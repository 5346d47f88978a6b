// Declared parameters: name, type, default, range, unit and doc, from which parsing, `describe`,
// the cache key and the docs all derive.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace viscera {

using Json = nlohmann::ordered_json;
class JsonValue;  // json_value.hpp

enum class ParamType { boolean, integer, real, text, list, map };

struct Param {
  std::string name;
  ParamType type = ParamType::text;
  Json fallback;                     // null: the parameter may stay unset (resolved as null)
  std::string unit = "1";            // of a real; its resolved value is a number in this unit
  std::optional<double> lo{}, hi{};  // closed range of a number
  // Of a text, empty: any. Of an integer words that may stand in its place.
  std::vector<std::string> choices{};
  // Of a map, what each of its values is: a map of these, or a value of the one that has no name.
  // Empty: the stage alone knows.
  std::vector<Param> entry{};
  std::string doc;
  bool in_key = true;  // false: cannot change the results (threads, log flags)
};

// The number of CPU threads of a stage, 0 for all: a param `threads` that no result depends on. The
// engine sets it where the spec does not, and a stage lowers it to the cores of its machine.
bool is_thread_count(const Param& param);

// A real in [lo, hi] of `unit`.
Param quantity(const char* name, Json fallback, const char* unit, double lo, double hi,
               const char* doc);

Json to_json(const Param& param);
Param param_from_json(const JsonValue& json);  // throws Error(bad_input)

// A value as written on a command line ("5mm", "true", "{liver: 1}"), read as YAML into JSON.
// Texts that are not numbers, booleans, null, lists or maps stay texts; so does what stands in
// double quotes, whatever it looks like. JSON is read as itself.
Json value_from_text(const std::string& text);

// One value checked and brought to its canonical form. `where` is the file it stands in (with line)
// or "command line"; `field` its full name.
Json resolve_value(const Param& param, const Json& given, const std::string& where,
                   const std::string& field);

// The same where a value must stand: null throws Error(bad_config) too.
Json resolve_required(const Param& param, const Json& given, const std::string& where,
                      const std::string& field);

// Every declared parameter with its given value or default, in declared order. `prefix`
// ("tetmesh.") leads the field names of errors. Unknown names throw Error(bad_config) with the
// nearest valid one.
Json resolve(const std::vector<Param>& declared, const Json& given, const std::string& where,
             const std::string& prefix = "");

}  // namespace viscera
