#include "stages/mesh/landmark_io.hpp"

#include <fmt/format.h>
#include <vtkNew.h>
#include <vtkXMLParser.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/base/markup.hpp"
#include "stages/mesh/vtk_messages.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

Error bad_file(const fs::path& path, std::string field, std::string found, std::string allowed) {
  return Error(ExitCode::bad_input, {.where = path.string(),
                                     .field = std::move(field),
                                     .found = std::move(found),
                                     .allowed = std::move(allowed)});
}

// Whether a file's frame is RAS; 3D Slicer also writes RAS as 0 and LPS as 1.
bool is_ras(const fs::path& path, const std::string& field, const std::string& frame) {
  if (frame == "RAS" || frame == "0") return true;
  if (frame == "LPS" || frame == "1") return false;
  throw bad_file(path, field, "'" + frame + "'", "LPS or RAS");
}

Landmark landmark_of(std::string name, std::array<double, 3> place, bool ras) {
  if (ras) place[0] = -place[0], place[1] = -place[1];
  return {std::move(name), place};
}

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(" \t\r\""), end = text.find_last_not_of(" \t\r\"");
  return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(trimmed(cell));
  return cells;
}

// Where a table has its names and places.
struct Columns {
  std::array<std::size_t, 3> place;
  std::size_t name;

  static Columns of(const fs::path& path, const std::vector<std::string>& heads,
                    const std::string& name) {
    const auto find = [&](const std::string& head) {
      const auto found = std::ranges::find_if(
          heads, [&](const auto& own) { return own == head || own == head + "_mm"; });
      if (found == heads.end()) {
        throw bad_file(path, "columns", fmt::format("no column {}", head),
                       fmt::format("columns {}, x, y and z", name));
      }
      return static_cast<std::size_t>(found - heads.begin());
    };
    return {{find("x"), find("y"), find("z")}, find(name)};
  }
};

double coordinate(const fs::path& path, const std::string& field, const std::string& cell,
                  const char* unit) {
  std::size_t read = 0;
  double value = NAN;
  try {
    value = std::stod(cell, &read);
  } catch (const std::logic_error&) {  // said below
  }
  if (read != cell.size() || !std::isfinite(value)) {
    throw bad_file(path, field, "'" + cell + "'", fmt::format("a coordinate in {}", unit));
  }
  return value;
}

// A table with its heads in the first line, or after `# columns =` where lines with # come first.
Landmarks read_table(const fs::path& path, const std::string& name) {
  Landmarks landmarks;
  std::optional<Columns> columns;
  std::istringstream in(read_file(path));
  std::size_t number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    if (trimmed(line).empty()) continue;
    if (line.starts_with('#')) {
      const auto equals = line.find('=');
      if (equals == std::string::npos) continue;
      const std::string key = trimmed(line.substr(1, equals - 1)), value = line.substr(equals + 1);
      if (key == "columns") columns = Columns::of(path, cells_of(value), name);
      if (key == "CoordinateSystem") {
        landmarks.were_ras = is_ras(path, fmt::format("line {}", number), trimmed(value));
      }
      continue;
    }
    const std::vector<std::string> cells = cells_of(line);
    if (!columns) {
      columns = Columns::of(path, cells, name);
      continue;
    }
    const auto& [place, own_name] = *columns;
    if (cells.size() <= std::max({place[0], place[1], place[2], own_name})) {
      throw bad_file(path, fmt::format("line {}", number), fmt::format("{} cells", cells.size()),
                     "a cell for each column");
    }
    std::array<double, 3> at{};
    for (int k = 0; k < 3; ++k)
      at[k] = coordinate(path, fmt::format("line {}", number), cells[place[k]], "mm");
    landmarks.all.push_back(landmark_of(cells[own_name], at, landmarks.were_ras));
  }
  return landmarks;
}

Landmarks read_markups(const fs::path& path) {
  Landmarks landmarks;
  const JsonText text = read_json(path);
  for (const JsonValue& markup : text.root()["markups"].items()) {
    const auto frame = markup.find("coordinateSystem");
    const bool ras = frame && is_ras(path, "coordinateSystem", frame->text());
    landmarks.were_ras |= ras;
    // A word, or a list of a code, its scheme and its meaning.
    const auto unit = markup.find("coordinateUnits");
    if (unit && unit->raw().dump().find("\"mm\"") == std::string::npos) {
      throw bad_file(path, "coordinateUnits", unit->raw().dump(), "\"mm\"");
    }
    for (const JsonValue& point : markup["controlPoints"].items()) {
      // Slicer keeps points that someone has yet to place, with a position all the same.
      const auto status = point.find("positionStatus");
      if (status && status->text() != "defined") {
        throw bad_file(path, "positionStatus",
                       "'" + status->text() + "' of " + point["label"].text(),
                       "defined: a point that has been placed");
      }
      std::array<double, 3> at{};
      for (std::size_t k = 0; k < 3; ++k) at[k] = point["position"][k].number();
      landmarks.all.push_back(landmark_of(point["label"].text(), at, ras));
    }
  }
  return landmarks;
}

constexpr const char* annotation_format = "ITK-SNAP Annotation File";

// What ITK-SNAP writes of its annotations: folders in folders, each with entries. Those of an
// annotation stand in the folder Element[i] of the folder Annotations.
class Annotations : public vtkXMLParser {
 public:
  static Annotations* New();
  vtkTypeMacro(Annotations, vtkXMLParser);
  std::string format;
  std::map<std::string, std::map<std::string, std::string>> entries;  // of each annotation

 protected:
  void StartElement(const char* name, const char** attributes) override {
    const auto attribute = [attributes](std::string_view asked) -> std::string {
      for (std::size_t k = 0; attributes[k] && attributes[k + 1]; k += 2)
        if (attributes[k] == asked) return attributes[k + 1];
      return "";
    };
    const std::string key = attribute("key");
    if (folders_.size() == 1 && key == "Format") format = attribute("value");
    if (folders_.size() == 3 && folders_[1] == "Annotations" && name == std::string_view("entry")) {
      entries[folders_[2]][key] = attribute("value");
    }
    folders_.push_back(key);
  }
  void EndElement(const char*) override { folders_.pop_back(); }

 private:
  std::vector<std::string> folders_;  // keys of the elements around, the registry's own first
};

vtkStandardNewMacro(Annotations);

Landmarks read_annotations(const fs::path& path) {
  const std::string text = read_file(path);
  const VtkMessages messages;
  const vtkNew<Annotations> annotations;
  const bool parsed = annotations->Parse(text.data(), static_cast<unsigned>(text.size()));
  if (!parsed || annotations->format != annotation_format) {
    throw bad_file(path, "Format", parsed ? "'" + annotations->format + "'" : messages.first(),
                   fmt::format("XML whose entry Format is '{}'", annotation_format));
  }
  Landmarks landmarks{.in_voxels = true};
  for (auto& [element, entries] : annotations->entries) {
    if (entries["Type"] != "LandmarkAnnotation") continue;  // a ruler
    std::istringstream in(entries["Pos"]);
    std::array<std::string, 3> cells;
    in >> cells[0] >> cells[1] >> cells[2];
    std::array<double, 3> at{};
    for (int k = 0; k < 3; ++k) at[k] = coordinate(path, element + ".Pos", cells[k], "voxels");
    landmarks.all.push_back(landmark_of(entries["Text"], at, false));
  }
  return landmarks;
}

}  // namespace

Landmarks read_landmarks(const fs::path& path) {
  const std::string file = path.filename().string();
  Landmarks landmarks;
  if (file.ends_with(".json")) {
    landmarks = read_markups(path);
  } else if (file.ends_with(".fcsv")) {
    landmarks = read_table(path, "label");
  } else if (file.ends_with(".csv")) {
    landmarks = read_table(path, "name");
  } else if (file.ends_with(".annot")) {
    landmarks = read_annotations(path);
  } else {
    throw bad_file(path, "", "a name that ends otherwise", ".csv, .fcsv, .mrk.json or .annot");
  }
  std::set<std::string> names;
  for (const auto& [name, place] : landmarks.all) {
    if (name.empty()) throw bad_file(path, "", "a landmark without a name", "a name for each");
    if (!names.insert(name).second) {
      throw bad_file(path, name, "a name that stands twice", "names that differ");
    }
  }
  return landmarks;
}

std::string landmarks_as_markups(const std::vector<Landmark>& landmarks) {
  Json points = Json::array();
  for (const auto& [name, place] : landmarks) {
    points.push_back({{"id", std::to_string(points.size() + 1)},
                      {"label", name},
                      {"position", place},
                      {"positionStatus", "defined"}});
  }
  const Json markup = {{"type", "Fiducial"},
                       {"coordinateSystem", "LPS"},
                       {"coordinateUnits", "mm"},
                       {"controlPoints", points}};
  return Json{{"@schema",
               "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/"
               "Resources/Schema/markups-schema-v1.0.3.json#"},
              {"markups", Json::array({markup})}}
             .dump(1) +
         "\n";
}

std::string landmarks_as_annotations(const std::vector<Landmark>& landmarks) {
  const auto entry = [](const char* indent, const char* key, const std::string& value) {
    return fmt::format("{}<entry key=\"{}\" value=\"{}\" />\n", indent, key, escaped_markup(value));
  };
  std::string text = "<?xml version=\"1.0\" encoding=\"UTF-8\" ?>\n<registry>\n" +
                     entry("  ", "Format", annotation_format) +
                     entry("  ", "FormatDate", "20150624") + "  <folder key=\"Annotations\" >\n" +
                     entry("    ", "ArraySize", std::to_string(landmarks.size()));
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    const auto& [name, place] = landmarks[i];
    text +=
        fmt::format("    <folder key=\"Element[{}]\" >\n", i) +
        entry("      ", "Type", "LandmarkAnnotation") + entry("      ", "Text", name) +
        entry("      ", "Pos", fmt::format("{:.9g} {:.9g} {:.9g}", place[0], place[1], place[2])) +
        entry("      ", "VisibleInAllSlices", "1") + entry("      ", "VisibleInAllPlanes", "1") +
        "    </folder>\n";
  }
  return text + "  </folder>\n</registry>\n";
}

std::string landmarks_as_table(const std::vector<Landmark>& landmarks) {
  std::string text = "name,x_mm,y_mm,z_mm\n";
  for (const auto& [name, place] : landmarks) {
    text += fmt::format("{},{:.9g},{:.9g},{:.9g}\n", name, place[0], place[1], place[2]);
  }
  return text;
}

}  // namespace viscera
