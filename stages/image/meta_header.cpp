// MetaImage headers, with the voxels behind them (.mha) or in one file beside them (.mhd).
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "stages/image/header_checks.hpp"

namespace viscera {
namespace {

struct MetaType {
  const char* stored;
  const char* name;
  int bytes;
};

constexpr MetaType meta_types[] = {{"MET_CHAR", "int8", 1},       {"MET_UCHAR", "uint8", 1},
                                   {"MET_SHORT", "int16", 2},     {"MET_USHORT", "uint16", 2},
                                   {"MET_INT", "int32", 4},       {"MET_UINT", "uint32", 4},
                                   {"MET_LONG_LONG", "int64", 8}, {"MET_ULONG_LONG", "uint64", 8},
                                   {"MET_FLOAT", "float32", 4},   {"MET_DOUBLE", "float64", 8}};

constexpr std::size_t longest_name = 254;  // MetaIO aborts the program at a longer one
// As at a longer value of these fields, which it copies.
constexpr std::size_t longest_text = 254;
constexpr std::string_view copied_fields[] = {
    "ObjectType",    "ObjectSubType", "TransformType",         "Name",
    "Comment",       "Modality",      "AnatomicalOrientation", "AcquisitionDate",
    "DistanceUnits", "ElementType",   "ElementDataFile"};

// Fields that are read here. MetaIO tells them by their exact spelling.
constexpr const char* known_fields[] = {
    "NDims",       "DimSize",        "ElementType",     "ElementNumberOfChannels",
    "Offset",      "Position",       "Origin",          "ElementSpacing",
    "Rotation",    "Orientation",    "TransformMatrix", "CenterOfRotation",
    "HeaderSize",  "BinaryData",     "CompressedData",  "CompressedDataSize",
    "ElementSize", "ElementDataFile"};

// What this reader and MetaIO would take for different fields: MetaIO ends a name at a colon too,
// and a line at a carriage return, and goes on behind a last field that is spelled otherwise.
void check_line(const HeaderChecks& checks, const std::string& line, const std::string& name,
                const std::string& value) {
  if (value.size() > longest_text && std::ranges::count(copied_fields, name)) {
    checks.refuse(name, fmt::format("{} characters", value.size()),
                  fmt::format("at most {}", longest_text));
  }
  if (name.find(':') != std::string::npos) {
    checks.refuse(name.substr(0, 60), "a colon in a field's name", "FIELD = VALUE");
  }
  if (trimmed(line).find('\r') != std::string::npos) {
    checks.refuse(name.substr(0, 60), "a carriage return within a line", "lines that end with it");
  }
  constexpr NoCase before;
  for (const char* known : known_fields) {
    const bool is_like = !before(name, known) && !before(known, name);
    if (is_like && name != known) checks.refuse(name, "spelled otherwise", known);
  }
}

TextHeader read_meta_lines(const HeaderChecks& checks) {
  HeaderLines lines(checks, 500);  // as many as MetaIO reads at once
  TextHeader header;
  while (!header.has("ElementDataFile")) {
    const auto line = lines.next();
    if (!line) checks.refuse("ElementDataFile", "missing", "the header's last field");
    if (trimmed(*line).empty()) continue;
    const auto mark = line->find('=');
    if (mark == std::string::npos)
      checks.refuse("header", fmt::format("line '{}'", line->substr(0, 60)), "FIELD = VALUE");
    if (mark > longest_name) {
      checks.refuse("header", fmt::format("a field's name of {} characters", mark),
                    fmt::format("at most {}", longest_name));
    }
    const std::string name = trimmed(line->substr(0, mark));
    const std::string value = trimmed(line->substr(mark + 1));
    check_line(checks, *line, name, value);
    if (!header.fields.emplace(name, value).second)
      checks.refuse(name, "given twice", "each field once");
  }
  header.end = lines.position();
  return header;
}

bool is_true(const TextHeader& header, const HeaderChecks& checks, const char* name,
             bool otherwise) {
  if (!header.has(name)) return otherwise;
  const std::string& text = header.field(checks, name);
  return !text.empty() && (text[0] == 'T' || text[0] == 't' || text[0] == '1');
}

// The numbers of a field that may be called by several names.
std::vector<double> numbers(const HeaderChecks& checks, const TextHeader& header,
                            const std::vector<const char*>& names) {
  for (const char* name : names)
    if (header.has(name)) {
      const auto values = checks.numbers(name, header.field(checks, name));
      checks.finite(name, values);
      return values;
    }
  return {};
}

void check_frame(const HeaderChecks& checks, const TextHeader& header) {
  const auto spacing = numbers(checks, header, {"ElementSpacing", "ElementSize"});
  for (std::size_t a = 0; a < spacing.size(); ++a) {
    if (!(spacing[a] > 0.0)) {
      checks.refuse("ElementSpacing", fmt::format("{} on axis {}", spacing[a], a), "positive mm");
    }
  }
  numbers(checks, header, {"Offset", "Position", "Origin"});
  numbers(checks, header, {"CenterOfRotation"});
  const auto matrix = numbers(checks, header, {"TransformMatrix", "Rotation", "Orientation"});
  if (matrix.size() != 9) return;  // of a volume of other dimension: ITK's default
  std::array<double, 9> axes{};
  std::copy(matrix.begin(), matrix.end(), axes.begin());
  checks.spans_volume("TransformMatrix", axes);
}

std::int64_t one_integer(const HeaderChecks& checks, const TextHeader& header, const char* name,
                         std::int64_t lo, std::int64_t hi) {
  const auto values = checks.integers(name, header.field(checks, name));
  if (values.size() != 1 || values[0] < lo || values[0] > hi)
    checks.refuse(name, header.field(checks, name), fmt::format("{} to {}", lo, hi));
  return values[0];
}

StoredData meta_data(const HeaderChecks& checks, const TextHeader& header) {
  StoredData data{.file = checks.path(), .field = "DimSize", .offset = header.end};
  const std::string& name = header.field(checks, "ElementDataFile");
  const bool local = name == "LOCAL" || name == "Local" || name == "local";
  if (!local) {
    if (name.starts_with("LIST") || name.find('%') != std::string::npos)
      checks.refuse("ElementDataFile", fmt::format("'{}'", name), "one file with all voxels");
    data.file = detached_file(checks, "ElementDataFile", name);
    data.offset = 0;
  }
  if (header.has("HeaderSize")) {
    const auto skip = one_integer(checks, header, "HeaderSize", -1, local ? 0 : 1 << 24);
    data.ends_file = skip < 0;
    data.offset += static_cast<std::uint64_t>(std::max<std::int64_t>(skip, 0));
  }
  if (!is_true(header, checks, "BinaryData", true)) data.encoding = Encoding::text;
  if (is_true(header, checks, "CompressedData", false)) data.encoding = Encoding::deflated;
  if (header.has("CompressedDataSize")) {
    const auto there = static_cast<std::int64_t>(std::filesystem::file_size(data.file));
    one_integer(checks, header, "CompressedDataSize", 0, there);
  }
  return data;
}

}  // namespace

ImageHeader read_meta_header(const HeaderChecks& checks) {
  const TextHeader header = read_meta_lines(checks);
  ImageHeader result{.path = checks.path(), .format = ImageFormat::meta};
  const auto axes = one_integer(checks, header, "NDims", 1, 8);
  const auto sizes = checks.integers("DimSize", header.field(checks, "DimSize"));
  if (static_cast<std::int64_t>(sizes.size()) != axes)
    checks.refuse("DimSize", fmt::format("{} numbers", sizes.size()), fmt::format("{}", axes));
  result.size = checks.size("DimSize", sizes, 1);
  const std::string& stored = header.field(checks, "ElementType");
  const auto type = std::find_if(std::begin(meta_types), std::end(meta_types),
                                 [&stored](const MetaType& t) { return stored == t.stored; });
  if (type == std::end(meta_types))
    checks.refuse("ElementType", fmt::format("'{}'", stored), "MET_UCHAR … MET_DOUBLE");
  result.pixel_type = type->name;
  if (header.has("ElementNumberOfChannels"))
    one_integer(checks, header, "ElementNumberOfChannels", 1, 1);
  check_frame(checks, header);
  StoredData data = meta_data(checks, header);
  data.values = result.voxels();
  data.bytes = data.values * static_cast<std::uint64_t>(type->bytes);
  check_stored(checks, data);
  return result;
}

}  // namespace viscera
