#include "stages/image/stored_segments.hpp"

#include <fmt/format.h>

#include <charconv>
#include <optional>

#include "stages/image/label_image.hpp"

namespace viscera {
namespace {

constexpr int max_segments = 10000;

// The number that a text is, from 0 to 65535.
std::optional<int> id_of(const std::string& text) {
  int id = -1;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), id);
  const bool whole = error == std::errc{} && end == text.data() + text.size();
  return whole && id >= 0 && id <= max_label_id ? std::optional(id) : std::nullopt;
}

std::vector<StoredSegment> from_pairs(const std::map<std::string, std::string>& pairs) {
  constexpr const char* prefix = "label_";
  std::map<int, std::string> names;
  for (auto pair = pairs.lower_bound(prefix); pair != pairs.end(); ++pair) {
    if (!pair->first.starts_with(prefix)) break;
    const auto id = id_of(pair->first.substr(std::string(prefix).size()));
    if (id) names[*id] = pair->second;
  }
  std::vector<StoredSegment> segments;
  for (const auto& [id, name] : names) segments.push_back({.name = name, .value = id});
  return segments;
}

std::vector<StoredSegment> from_slicer(const ImageHeader& header) {
  std::vector<StoredSegment> segments;
  for (int s = 0; s < max_segments; ++s) {
    const auto field = [&](const char* what) {
      const auto found = header.fields.find(fmt::format("Segment{}_{}", s, what));
      return found == header.fields.end() ? std::optional<std::string>() : found->second;
    };
    const auto name = field("Name");
    if (!name) break;
    const auto layer = id_of(field("Layer").value_or("0"));
    // Without layers (Slicer before 4.11) segment s is layer s of value 1.
    const bool old = !field("LabelValue") && !field("Layer");
    const auto value = id_of(field("LabelValue").value_or("1"));
    segments.push_back({*name, old ? s : layer.value_or(header.layers), value.value_or(0)});
    const auto& made = segments.back();
    if (made.layer >= header.layers || made.value < 1) {
      throw bad_image(
          header.path, fmt::format("Segment{}_Layer, _LabelValue", s),
          fmt::format("layer {}, value {}", field("Layer").value_or("unset"),
                      field("LabelValue").value_or("unset")),
          fmt::format("a layer below {}, a value from 1 to {}", header.layers, max_label_id),
          "save the segmentation again");
    }
  }
  return segments;
}

// What stands between `begin` and `end`, from `at` on, which moves behind it.
std::optional<std::string> between(const std::string& text, std::size_t& at,
                                   const std::string& begin, const std::string& end) {
  const auto first = text.find(begin, at);
  if (first == std::string::npos) return std::nullopt;
  const auto last = text.find(end, first + begin.size());
  if (last == std::string::npos) return std::nullopt;
  at = last + end.size();
  return text.substr(first + begin.size(), last - first - begin.size());
}

// <Label Key="1" …><![CDATA[spleen]]></Label>, the label table of a Caret extension.
std::vector<StoredSegment> from_label_table(const std::string& xml) {
  std::vector<StoredSegment> segments;
  std::size_t at = 0;
  while (const auto label = between(xml, at, "<Label ", "</Label>")) {
    std::size_t inside = 0;
    const auto id = id_of(between(*label, inside, "Key=\"", "\"").value_or(""));
    auto name = between(*label, inside, "<![CDATA[", "]]>");
    if (!name) {
      const auto open = label->find('>');
      name = open == std::string::npos ? "" : label->substr(open + 1);
    }
    if (id.value_or(0) > 0 && !name->empty()) segments.push_back({.name = *name, .value = *id});
  }
  return segments;
}

}  // namespace

std::vector<StoredSegment> stored_segments(const ImageHeader& header) {
  auto segments = from_slicer(header);
  if (segments.empty()) segments = from_pairs(header.fields);
  if (segments.empty()) segments = from_label_table(header.extension);
  return segments;
}

}  // namespace viscera
