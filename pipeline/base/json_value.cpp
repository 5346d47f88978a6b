#include "pipeline/base/json_value.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "pipeline/base/atomic_file.hpp"

namespace viscera {
namespace {

constexpr std::size_t max_shown = 60;  // bytes of a value that an error shows

// The most brackets open at once outside of texts.
int depth_of(std::string_view text) {
  int depth = 0, deepest = 0;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '"') quoted = !quoted;
    if (quoted) {
      if (c == '\\') ++i;
      continue;
    }
    if (c == '[' || c == '{') deepest = std::max(deepest, ++depth);
    if (c == ']' || c == '}') --depth;
  }
  return deepest;
}

// A discarded value, which is of no type, where it is no JSON or too deep.
Json parse(std::string_view text) {
  if (depth_of(text) > max_json_depth) return Json(Json::value_t::discarded);
  return Json::parse(text, nullptr, false);
}

std::string shown(const Json& json) {
  if (json.is_discarded()) {
    return fmt::format("not JSON, or nested deeper than {} levels", max_json_depth);
  }
  const std::string text = json.dump(-1, ' ', true, Json::error_handler_t::replace);
  return text.size() <= max_shown ? text : text.substr(0, max_shown) + " …";
}

}  // namespace

Error JsonValue::refused(const std::string& allowed) const {
  return Error(ExitCode::bad_input, {.where = where_,
                                     .field = field_,
                                     .found = shown(*json_),
                                     .allowed = allowed,
                                     .remedy = "let the program that wrote it write it again"});
}

JsonValue JsonValue::operator[](const std::string& member) const {
  const auto found = object().find(member);
  const std::string field = field_.empty() ? member : field_ + "." + member;
  if (found != json_->end()) return {*found, where_, field};
  throw Error(ExitCode::bad_input, {.where = where_,
                                    .field = field,
                                    .found = "missing",
                                    .remedy = "let the program that wrote it write it again"});
}

JsonValue JsonValue::operator[](std::size_t item) const {
  if (!json_->is_array() || json_->size() <= item) {
    throw refused(fmt::format("a list of at least {} items", item + 1));
  }
  return {(*json_)[item], where_, fmt::format("{}[{}]", field_, item)};
}

std::optional<JsonValue> JsonValue::find(const std::string& member) const {
  const auto found = object().find(member);
  if (found == json_->end() || found->is_null()) return std::nullopt;
  return (*this)[member];
}

std::vector<JsonValue> JsonValue::items() const {
  if (!json_->is_array()) throw refused("a list");
  std::vector<JsonValue> all;
  for (std::size_t i = 0; i < json_->size(); ++i) all.push_back((*this)[i]);
  return all;
}

std::vector<std::pair<std::string, JsonValue>> JsonValue::members() const {
  std::vector<std::pair<std::string, JsonValue>> all;
  for (const auto& [name, value] : object().items()) all.emplace_back(name, (*this)[name]);
  return all;
}

const Json& JsonValue::object() const {
  if (!json_->is_object()) throw refused("an object");
  return *json_;
}

std::string JsonValue::text() const {
  if (!json_->is_string()) throw refused("a text");
  return json_->get<std::string>();
}

bool JsonValue::flag() const {
  if (!json_->is_boolean()) throw refused("true or false");
  return json_->get<bool>();
}

double JsonValue::number() const {
  if (!json_->is_number()) throw refused("a number");
  return json_->get<double>();
}

std::map<std::string, std::string> JsonValue::texts_by_name() const {
  std::map<std::string, std::string> texts;
  for (const auto& [name, value] : members()) texts[name] = value.text();
  return texts;
}

std::vector<std::string> JsonValue::texts() const {
  std::vector<std::string> texts;
  for (const auto& item : items()) texts.push_back(item.text());
  return texts;
}

JsonText::JsonText(std::string_view text, std::string where)
    : json_(parse(text)), where_(std::move(where)) {}

JsonText read_json(const std::filesystem::path& path) {
  return {read_file(path), path.string()};
}

bool is_utf8(const std::string& text) {
  try {
    (void)Json(text).dump();  // the library's writer refuses all else
    return true;
  } catch (const Json::exception&) {
    return false;
  }
}

std::string document_of(const Json& json) {
  return json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace viscera
