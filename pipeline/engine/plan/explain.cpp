#include "pipeline/engine/plan/explain.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>

namespace viscera::engine {
namespace {

const KeyComponent* find(const std::vector<KeyComponent>& components, const KeyComponent& like) {
  const auto found = std::find_if(
      components.begin(), components.end(),
      [&like](const KeyComponent& c) { return c.type == like.type && c.name == like.name; });
  return found == components.end() ? nullptr : &*found;
}

std::string shortened(const std::string& value) {
  constexpr std::size_t limit = 60;
  return value.size() <= limit ? value : value.substr(0, limit) + "...";
}

std::string in_words(const KeyComponent& now, const std::string* before) {
  if (now.type == "param") {
    return fmt::format("{} {} -> {}", now.name, before ? shortened(*before) : "unset",
                       shortened(now.value));
  }
  if (now.type == "stage")
    return fmt::format("version {} -> {}", before ? *before : "?", now.value);
  if (now.type == "library") {
    return fmt::format("{} {} -> {}", now.name, before ? *before : "none", now.value);
  }
  if (now.type == "program") return now.name + " was rebuilt";
  if (now.type == "manifest") return fmt::format("settings or gates behind {} changed", now.name);
  return now.name + (before ? " changed" : " added");
}

bool is_cascade(const KeyComponent& component, const std::vector<std::string>& produced_roles) {
  const bool fed = component.type == "input" || component.type == "manifest";
  const std::string role = component.name.substr(0, component.name.find('#'));
  return fed && std::count(produced_roles.begin(), produced_roles.end(), role) > 0;
}

}  // namespace

std::vector<KeyComponent> read_transcript(const std::string& text) {
  std::vector<KeyComponent> components;
  std::size_t at = 0;
  while (at < text.size()) {
    const auto space = text.find(' ', at);
    const auto mark = text.find(" = [", at);
    const auto close = text.find("] ", mark);
    if (space == std::string::npos || mark == std::string::npos || close == std::string::npos) {
      break;
    }
    std::size_t length = 0;
    std::from_chars(text.data() + mark + 4, text.data() + close, length);
    if (close + 2 + length > text.size()) break;
    components.push_back({text.substr(at, space - at), text.substr(space + 1, mark - space - 1),
                          text.substr(close + 2, length)});
    at = close + 2 + length + 1;
  }
  return components;
}

std::string explain(const std::string& before, const std::string& after,
                    const std::vector<std::string>& produced_roles) {
  const auto old_parts = read_transcript(before), new_parts = read_transcript(after);
  std::vector<std::string> causes, cascades;
  const auto note = [&](const KeyComponent& component, const std::string& words) {
    auto& list = is_cascade(component, produced_roles) ? cascades : causes;
    if (!std::count(list.begin(), list.end(), words)) list.push_back(words);
  };
  for (const auto& now : new_parts) {
    const KeyComponent* old = find(old_parts, now);
    if (!old || old->value != now.value) note(now, in_words(now, old ? &old->value : nullptr));
  }
  for (const auto& old : old_parts) {
    if (!find(new_parts, old)) note(old, old.name + " removed");
  }
  std::string text;
  if (!causes.empty()) text = fmt::format("{} (cause)", fmt::join(causes, ", "));
  if (!cascades.empty()) {
    text += fmt::format("{}{} (cascade)", text.empty() ? "" : "; ", fmt::join(cascades, ", "));
  }
  return text;
}

}  // namespace viscera::engine
