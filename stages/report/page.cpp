#include "stages/report/page.hpp"

#include <array>
#include <map>
#include <string_view>

#include "pipeline/base/markup.hpp"

namespace viscera {
namespace {

// JSON that cannot end the script element it stands in. Bytes that are not UTF-8 are replaced.
std::string script_json(const Json& json) {
  std::string out;
  for (const char c : json.dump(-1, ' ', false, Json::error_handler_t::replace)) {
    if (c == '<') {
      out += "\\u003c";
    } else {
      out += c;
    }
  }
  return out;
}

// Every {{name}} of the shell replaced once; the replacements are not searched again.
std::string filled(std::string_view shell, const std::map<std::string_view, std::string>& parts) {
  std::string page;
  while (true) {
    const auto begin = shell.find("{{");
    if (begin == std::string_view::npos) return page.append(shell);
    const auto end = shell.find("}}", begin);
    page.append(shell.substr(0, begin));
    page += parts.at(shell.substr(begin + 2, end - begin - 2));
    shell.remove_prefix(end + 2);
  }
}

}  // namespace

std::string base64(std::string_view bytes) {
  constexpr std::string_view digits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    unsigned group = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const unsigned byte = i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u;
      group = group << 8 | byte;
    }
    for (std::size_t k = 0; k < 4; ++k) {
      out += i + k <= bytes.size() ? digits[group >> (18 - 6 * k) & 63] : '=';
    }
  }
  return out;
}

std::string filled_page(const web::Page& page, const std::string& title, const Json& report,
                        const std::string& packed_geometry, const std::string& packed_slices) {
  std::string scripts;
  for (const std::string_view file : page.scripts) {
    scripts += "<script>\n";
    scripts += file;
    scripts += "\n</script>\n";
  }
  return filled(web::shell(), {{"title", escaped_markup(title)},
                               {"style", std::string(web::style())},
                               {"first", std::string(page.first)},
                               {"main", std::string(page.main)},
                               {"stage", std::string(page.stage)},
                               {"licences", std::string(web::licences())},
                               {"scripts", scripts},
                               {"report", script_json(report)},
                               {"geometry", base64(packed_geometry)},
                               {"slices", base64(packed_slices)}});
}

}  // namespace viscera
