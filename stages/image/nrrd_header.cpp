// NRRD headers (teem's format, revision 1 to 5), attached and detached in one file.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "stages/image/header_checks.hpp"

namespace viscera {
namespace {

struct NrrdType {
  const char* name;
  int bytes;
  std::vector<std::string> spellings;
};

const std::vector<NrrdType> nrrd_types = {
    {"int8", 1, {"signed char", "int8", "int8_t"}},
    {"uint8", 1, {"uchar", "unsigned char", "uint8", "uint8_t"}},
    {"int16", 2, {"short", "short int", "signed short", "signed short int", "int16", "int16_t"}},
    {"uint16", 2, {"ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"}},
    {"int32", 4, {"int", "signed int", "int32", "int32_t"}},
    {"uint32", 4, {"uint", "unsigned int", "uint32", "uint32_t"}},
    {"int64",
     8,
     {"longlong", "long long", "long long int", "signed long long", "signed long long int", "int64",
      "int64_t"}},
    {"uint64",
     8,
     {"ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"}},
    {"float32", 4, {"float"}},
    {"float64", 8, {"double"}}};

const NrrdType& pixel_type(const HeaderChecks& checks, const std::string& text) {
  for (const auto& type : nrrd_types)
    if (std::count(type.spellings.begin(), type.spellings.end(), text)) return type;
  checks.refuse("type", fmt::format("'{}'", text), "whole or floating numbers (uchar … double)");
}

Encoding encoding(const HeaderChecks& checks, const std::string& text) {
  if (text == "raw") return Encoding::raw;
  if (text == "gzip" || text == "gz") return Encoding::deflated;
  if (text == "txt" || text == "text" || text == "ascii") return Encoding::text;
  if (text == "hex") return Encoding::hex;
  checks.refuse("encoding", fmt::format("'{}'", text), "raw, gzip, ascii or hex");
}

// Key/value pairs have a backslash as \\ and the end of a line as \n, with a letter n.
std::string unescaped(const std::string& text) {
  std::string plain;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char next = text[i] == '\\' && i + 1 < text.size() ? text[i + 1] : '\0';
    if (next == '\\' || next == 'n') ++i;
    plain += next == 'n' ? '\n' : text[i];
  }
  return plain;
}

TextHeader read_nrrd_lines(const HeaderChecks& checks) {
  HeaderLines lines(checks, 1 << 20);  // Slicer keeps whole tables in one line
  TextHeader header;
  const auto magic = lines.next();
  if (!magic || !magic->starts_with("NRRD000"))
    checks.refuse("header", "no NRRD magic in its first line", "NRRD0001 to NRRD0005");
  for (auto line = lines.next(); line && !trimmed(*line).empty(); line = lines.next()) {
    if (line->starts_with('#')) continue;
    const auto pair = line->find(":="), mark = line->find(": ");
    if (pair < mark) {
      header.pairs[unescaped(line->substr(0, pair))] = unescaped(trimmed(line->substr(pair + 2)));
      continue;
    }
    if (mark == std::string::npos)
      checks.refuse("header", fmt::format("line '{}'", line->substr(0, 60)), "FIELD: VALUE");
    std::string name = trimmed(line->substr(0, mark));
    if (name == "datafile") name = "data file";
    if (name == "lineskip") name = "line skip";
    if (name == "byteskip") name = "byte skip";
    if (!header.fields.emplace(name, trimmed(line->substr(mark + 2))).second)
      checks.refuse(name, "given twice", "each field once");
    if (name == "data file" && header.fields[name].starts_with("LIST")) break;
  }
  header.end = lines.position();
  return header;
}

// Lengths are taken as millimetres, by ITK as here, whatever the header says.
void check_units(const HeaderChecks& checks, const TextHeader& header) {
  static const std::vector<std::string> millimetres = {"mm", "millimeter", "millimeters",
                                                       "millimetre", "millimetres"};
  for (const char* const name : {"space units", "units"}) {
    if (!header.has(name)) continue;
    std::string text = header.field(checks, name);
    std::ranges::replace(text, '"', ' ');
    std::istringstream words(text);
    for (std::string unit; words >> unit;) {
      const bool is_millimetres = std::ranges::count(millimetres, unit) > 0;
      // Of an axis of layers there is none.
      if (is_millimetres || unit == "none" || unit == "???") continue;
      checks.refuse(name, fmt::format("'{}'", unit), "mm");
    }
  }
}

// ITK turns the wrong axis of it.
void check_space(const HeaderChecks& checks, const TextHeader& header) {
  if (!header.has("space")) return;
  std::string space = header.field(checks, "space");
  std::ranges::transform(space, space.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (space == "left-anterior-superior" || space == "las")
    checks.refuse("space", fmt::format("'{}'", space),
                  "left-posterior-superior or right-anterior-superior");
}

void check_vectors(const HeaderChecks& checks, const TextHeader& header, bool layered) {
  check_units(checks, header);
  check_space(checks, header);
  if (header.has("space origin")) {
    checks.finite("space origin",
                  checks.numbers("space origin", header.field(checks, "space origin")));
  }
  if (header.has("spacings")) {
    const auto values = checks.numbers("spacings", header.field(checks, "spacings"));
    for (std::size_t a = layered; a < std::min<std::size_t>(values.size(), 3 + layered); ++a) {
      if (!(std::isfinite(values[a]) && values[a] > 0.0))
        checks.refuse("spacings", fmt::format("{} on axis {}", values[a], a), "positive mm");
    }
  }
  if (!header.has("space directions")) return;
  std::string text = header.field(checks, "space directions");
  for (auto none = text.find("none"); none != std::string::npos; none = text.find("none"))
    text.erase(none, 4);
  const auto values = checks.numbers("space directions", text);
  std::array<double, 9> axes{};
  if (values.size() != axes.size()) {
    checks.refuse("space directions", fmt::format("{} numbers", values.size()),
                  "three vectors of three numbers");
  }
  std::copy(values.begin(), values.end(), axes.begin());
  checks.spans_volume("space directions", axes);
}

std::int64_t skip(const HeaderChecks& checks, const TextHeader& header, const char* name,
                  std::int64_t lowest) {
  if (!header.has(name)) return 0;
  const auto values = checks.integers(name, header.field(checks, name));
  if (values.size() != 1 || values[0] < lowest || values[0] > 1 << 24)
    checks.refuse(name, header.field(checks, name), fmt::format("{} to {}", lowest, 1 << 24));
  return values[0];
}

StoredData nrrd_data(const HeaderChecks& checks, const TextHeader& header) {
  StoredData data{.file = checks.path(), .field = "sizes", .offset = header.end};
  if (header.has("data file")) {
    const std::string& name = header.field(checks, "data file");
    if (name.starts_with("LIST") || name.find('%') != std::string::npos)
      checks.refuse("data file", fmt::format("'{}'", name), "one file with all voxels");
    data.file = detached_file(checks, "data file", name);
    data.offset = 0;
  }
  data.encoding = encoding(checks, header.field(checks, "encoding"));
  const auto lines = skip(checks, header, "line skip", 0);
  const auto bytes = skip(checks, header, "byte skip", -1);
  if (lines > 0) checks.refuse("line skip", fmt::format("{}", lines), "0; 'byte skip' instead");
  if (bytes > 0 && data.encoding != Encoding::raw)
    checks.refuse("byte skip", fmt::format("{}", bytes), "0 unless the encoding is raw");
  data.ends_file = bytes < 0;
  data.offset += static_cast<std::uint64_t>(std::max<std::int64_t>(bytes, 0));
  return data;
}

}  // namespace

ImageHeader read_nrrd_header(const HeaderChecks& checks) {
  const TextHeader header = read_nrrd_lines(checks);
  ImageHeader result{.path = checks.path(), .format = ImageFormat::nrrd, .fields = header.pairs};
  const auto& type = pixel_type(checks, header.field(checks, "type"));
  result.pixel_type = type.name;
  const auto axes = checks.integers("dimension", header.field(checks, "dimension"));
  auto sizes = checks.integers("sizes", header.field(checks, "sizes"));
  if (axes.size() != 1 || axes[0] != static_cast<std::int64_t>(sizes.size()) || axes[0] > 8) {
    checks.refuse(
        "sizes", fmt::format("{} of them", sizes.size()),
        fmt::format("as many as the dimension says ({})", header.field(checks, "dimension")));
  }
  const bool layered =
      sizes.size() == 4 && header.has("kinds") && header.field(checks, "kinds").starts_with("list");
  if (layered) {
    if (sizes[0] < 1 || sizes[0] > 1000)
      checks.refuse("sizes", fmt::format("{} layers", sizes[0]), "1 to 1000");
    result.layers = static_cast<int>(sizes[0]);
    sizes.erase(sizes.begin());
  }
  result.size = checks.size("sizes", sizes, result.layers);
  check_vectors(checks, header, layered);
  StoredData data = nrrd_data(checks, header);
  data.values = result.voxels() * static_cast<std::uint64_t>(result.layers);
  data.bytes = data.values * static_cast<std::uint64_t>(type.bytes);
  check_stored(checks, data);
  return result;
}

}  // namespace viscera
