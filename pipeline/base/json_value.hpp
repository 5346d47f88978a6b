// JSON that a stranger may have written: read to a bounded depth and by type. What is missing, or
// of another type than asked for, is an Error that names the file, the place in it, what stands
// there and what may. Nothing else calls the library's parser. And JSON as we write it.
//
//   const JsonText study = read_json(path);
//   for (const JsonValue& scene : study.root()["scenes"].items())
//     use(scene["name"].text());   // "study.json: scenes[3].name: 7 / allowed: a text"
#pragma once

#include <concepts>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "pipeline/base/error.hpp"
#include "pipeline/base/param.hpp"

namespace viscera {

// What we write ourselves is no deeper than 10; the library's values are copied and destroyed
// recursively, so that 200,000 levels would exhaust the stack.
inline constexpr int max_json_depth = 64;

class JsonValue {
 public:
  // `json` must outlive this and all values that come from it. `where`: the file, `field`: the
  // place in it.
  JsonValue(const Json& json, std::string where, std::string field = "")
      : json_(&json), where_(std::move(where)), field_(std::move(field)) {}

  const Json& raw() const { return *json_; }  // as it is, whatever its type

  JsonValue operator[](const std::string& member) const;
  JsonValue operator[](std::size_t item) const;
  std::optional<JsonValue> find(const std::string& member) const;  // none: absent, or null

  std::vector<JsonValue> items() const;                            // of a list
  std::vector<std::pair<std::string, JsonValue>> members() const;  // of an object, in its order

  const Json& object() const;  // with its members as they are
  std::string text() const;
  bool flag() const;
  double number() const;
  template <std::integral Whole>
  Whole whole() const {
    const bool fits = json_->is_number_integer() && in_range<Whole>();
    if (!fits) throw refused("a whole number");
    return json_->get<Whole>();
  }
  std::map<std::string, std::string> texts_by_name() const;
  std::vector<std::string> texts() const;

  // Error(bad_input): this value is not what is allowed here.
  Error refused(const std::string& allowed) const;

 private:
  template <std::integral Whole>
  bool in_range() const {
    if (json_->is_number_unsigned()) {
      return json_->get<std::uint64_t>() <=
             static_cast<std::uint64_t>(std::numeric_limits<Whole>::max());
    }
    return std::in_range<Whole>(json_->get<std::int64_t>());
  }

  const Json* json_;
  std::string where_, field_;
};

// The JSON that a text is. One that is no JSON, or nested deeper than max_json_depth, is of no
// type: whoever asks its root for anything is told so.
class JsonText {
 public:
  JsonText(std::string_view text, std::string where);
  JsonValue root() const { return {json_, where_}; }  // refers to this

 private:
  Json json_;
  std::string where_;
};

JsonText read_json(const std::filesystem::path& path);  // Error(bad_input): it cannot be read

// Whether a text can stand in JSON: no overlong forms, no surrogates, nothing cut off.
bool is_utf8(const std::string& text);

// A document as files and standard output hold it: indented, with its last line ended. Bytes that
// are no UTF-8 are replaced.
std::string document_of(const Json& json);

}  // namespace viscera
