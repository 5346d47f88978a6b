#include "pipeline/contract/label_name.hpp"

#include <fmt/format.h>

#include "pipeline/base/json_value.hpp"

namespace viscera {
namespace {

// C0, DEL, and C1 as UTF-8 has them.
bool has_control_character(const std::string& text) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto c = static_cast<unsigned char>(text[i]);
    const auto next = static_cast<unsigned char>(i + 1 < text.size() ? text[i + 1] : 0xff);
    if (c < 0x20 || c == 0x7f || (c == 0xc2 && next < 0xa0)) return true;
  }
  return false;
}

std::string what_is_wrong(const std::string& name) {
  if (name.empty()) return "an empty name";
  if (name.size() > max_label_name) return fmt::format("a name of {} bytes", name.size());
  if (!is_utf8(name)) return "a name that is not UTF-8";
  if (has_control_character(name)) return "a name with a control character";
  if (name.front() == ' ' || name.back() == ' ') return "a name with a blank at its end";
  return "";
}

}  // namespace

void check_label_name(const std::string& name, ExitCode code, const std::string& where,
                      const std::string& field) {
  const std::string wrong = what_is_wrong(name);
  if (wrong.empty()) return;
  const Json shown = name.substr(0, max_label_name);
  throw Error(code,
              {.where = where,
               .field = field,
               .found = fmt::format("{}: {}", wrong,
                                    shown.dump(-1, ' ', true, Json::error_handler_t::replace)),
               .allowed = fmt::format("UTF-8 of 1 to {} bytes, without control characters "
                                      "and without blanks at its ends",
                                      max_label_name),
               .remedy = "rename it; viscera-labels takes names: labels: {liver: 1}"});
}

}  // namespace viscera
