#include "stages/mesh/export_text.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>

#include "pipeline/base/error.hpp"

namespace viscera::export_text {
namespace {

constexpr std::size_t longest_identifier = 60;

}  // namespace

std::map<int, std::string> identifiers(const std::map<int, std::string>& names) {
  std::map<int, std::string> made;
  std::set<std::string> taken;
  for (const auto& [id, name] : names) {
    std::string text;
    for (const char c : name.substr(0, longest_identifier - 8))
      text += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
    if (text.empty() || !std::isalpha(static_cast<unsigned char>(text[0]))) text = "m_" + text;
    const auto lower = [](std::string s) {
      for (char& c : s) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
      return s;
    };
    if (!taken.insert(lower(text)).second) {
      text += fmt::format("_{}", id);
      taken.insert(lower(text));
    }
    made[id] = text;
  }
  return made;
}

std::set<std::string> names_of_formats(const Json& asked, const std::vector<std::string>& known) {
  std::set<std::string> names;
  for (const auto& item : asked) {
    const std::string name = item.is_string() ? item.get<std::string>() : item.dump();
    if (!std::count(known.begin(), known.end(), name)) {
      throw Error(ExitCode::bad_config, {.where = "parameters",
                                         .field = "formats",
                                         .found = name,
                                         .allowed = fmt::format("{}", fmt::join(known, ", ")),
                                         .remedy = suggest(name, known)});
    }
    names.insert(name);
  }
  return names;
}

}  // namespace viscera::export_text
