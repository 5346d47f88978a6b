#include "pipeline/record/evidence.hpp"

#include <algorithm>
#include <sstream>

#include "pipeline/base/embedded_file.hpp"

VISCERA_EMBEDDED_FILE(verification_md);
VISCERA_EMBEDDED_FILE(verification_cuda_md);
VISCERA_EMBEDDED_FILE(hard_cases_md);
VISCERA_EMBEDDED_FILE(hard_cases_cuda_md);
VISCERA_EMBEDDED_FILE(error_bar_csv);
VISCERA_EMBEDDED_FILE(measured_csv);

namespace viscera::engine {
namespace {

// What the rows of a section show, and what a run must have for them to concern it: effects, or one
// of the words below. The bodies of these tables have the law neo_hookean (PBD: distance and
// volume), in linear tets where a row names no others.
struct Section {
  const char* name;
  const char* subject;
  std::vector<const char*> needs;
};
constexpr const char* tissue = "tissue";      // the law, whichever elements it has
constexpr const char* elements = "elements";  // of that law alone, which PBD's constraints are not
constexpr const char* several_materials = "several materials";
constexpr const char* several_densities = "several densities";
constexpr const char* obstacle = "obstacle";
constexpr const char* particles = "particles";  // vertices that no element ties together

const std::vector<Section> sections = {
    {"static", "equilibrium under gravity against Newton's method", {tissue, "gravity"}},
    {"substeps", "equilibrium by number of substeps", {tissue, "gravity"}},
    {"precision", "single precision far from the origin", {tissue}},
    {"stillness", "a body that nothing moves", {tissue}},
    {"free fall", "free fall against the discrete law", {tissue, "gravity"}},
    {"momentum", "momentum and angular momentum of a free body", {tissue}},
    {"energy", "energy of a free body without damping", {tissue}},
    {"friction", "Coulomb friction against the closed form", {obstacle}},
    {"restitution", "rebound of free vertices", {particles}},
    {"measured", "a silicone beam against its measurement", {tissue, "gravity"}},
    {"element", "elements against quadratic tets on the same mesh", {elements, "gravity"}},
    {"judge", "displacements and the clamp's force against CalculiX", {tissue, "gravity"}},
    {"1", "recovery from a squashed or mirrored state", {tissue}},
    {"2", "recovery from a state without volume", {tissue}},
    {"3", "recovery from scrambled vertices", {tissue}},
    {"4", "recovery from twist and stretch", {tissue}},
    {"5", "contrast of stiffness", {tissue, several_materials}},
    {"6", "contrast of density", {tissue, several_densities}},
    {"7", "nearly incompressible tissue", {tissue}},
    {"8", "too few substeps", {tissue}},
    {"9", "impact at high speed", {tissue, obstacle}},
    {"10", "flat tets, and meshes that cannot be simulated", {tissue}},
    {"11", "very small and very large bodies", {tissue}},
    {"12", "a body far from the origin", {tissue}},
    {"13", "a body at rest over 1e5 steps", {tissue}},
    {"14", "a body on the ground over 1e5 steps", {tissue, obstacle}},
    {"15", "numbers that make no sense", {}},
    {"16", "equal runs, and the mesh in another order", {tissue}},
    {"17", "degenerate scenes", {tissue}},
    {"18", "rebound, and recovery from crushing", {tissue, obstacle}},
};
constexpr const char* measured_section = "measured";

const Section* find_section(const std::string& name) {
  const auto found = std::ranges::find(sections, name, [](const Section& s) { return s.name; });
  return found == sections.end() ? nullptr : &*found;
}

bool has(const Setting& setting, const std::string& effect) {
  return std::ranges::count(setting.effects, effect) > 0;
}

bool meets(const Setting& setting, const std::string& need) {
  const bool has_elements = has(setting, "neo_hookean") || has(setting, "smoothed_neo_hookean");
  if (need == elements) return has_elements;
  if (need == tissue) {
    return has_elements ||
           (setting.method == "pbd" && has(setting, "distance") && has(setting, "volume"));
  }
  if (need == obstacle) {
    const char* const obstacles[] = {"ground", "plane", "sphere", "capsule", "box"};
    return std::ranges::any_of(obstacles, [&](const char* one) { return has(setting, one); });
  }
  if (need == several_materials) return setting.several_materials;
  if (need == several_densities) return setting.several_densities;
  return has(setting, need);
}

std::vector<std::string> split(const std::string& line, char separator) {
  std::vector<std::string> cells;
  std::istringstream stream(line);
  for (std::string cell; std::getline(stream, cell, separator);) {
    const auto first = cell.find_first_not_of(' ');
    const auto last = cell.find_last_not_of(' ');
    cells.push_back(first == std::string::npos ? "" : cell.substr(first, last + 1 - first));
  }
  return cells;
}

// The text between two others, "" where they do not stand there.
std::string between(std::string_view text, std::string_view before, std::string_view after) {
  const auto begin = text.find(before);
  if (begin == std::string_view::npos) return "";
  const auto end = text.find(after, begin + before.size());
  if (end == std::string_view::npos) return "";
  return std::string(text.substr(begin + before.size(), end - begin - before.size()));
}

ResultTable read_table(const char* file, std::string_view text) {
  ResultTable table{.file = file,
                    .program = between(text, "Written by `", "`"),
                    .dated = between(text, "Figures of ", "."),
                    .rows = {}};
  std::istringstream lines{std::string(text)};
  bool begun = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("|---|")) begun = true;
    if (!begun || !line.starts_with("| ")) continue;
    auto cells = split(line.substr(1), '|');
    if (cells.size() == 6) table.rows.push_back(std::move(cells));
  }
  return table;
}

// Cells in quotes may hold separators, and no quotes.
std::vector<std::string> csv_cells(const std::string& line) {
  std::vector<std::string> cells(1);
  bool quoted = false;
  for (const char c : line) {
    if (c == '"') {
      quoted = !quoted;
    } else if (c == ',' && !quoted) {
      cells.emplace_back();
    } else if (c != '\r') {
      cells.back() += c;
    }
  }
  return cells;
}

std::vector<Json> csv_objects(std::string_view text) {
  std::istringstream lines{std::string(text)};
  std::string line;
  std::getline(lines, line);
  const auto header = csv_cells(line);
  std::vector<Json> objects;
  while (std::getline(lines, line)) {
    const auto cells = csv_cells(line);
    Json& object = objects.emplace_back(Json::object());
    for (std::size_t i = 0; i < std::min(cells.size(), header.size()); ++i)
      object[header[i]] = cells[i];
  }
  return objects;
}

// "xpbd gauss_seidel, 64 × 1" is of the method xpbd and the scheme gauss_seidel, "xpbd" of all
// schemes, "any" of all methods.
bool is_solver_of(const Setting& setting, const std::string& solver) {
  const std::string asked = setting.method + (setting.scheme.empty() ? "" : " " + setting.scheme);
  std::string found = solver.substr(0, solver.find_first_of(",("));
  if (found.ends_with(' ')) found.pop_back();
  return found == asked || found == setting.method || found == "any";
}

bool concerns(const Setting& setting, const std::vector<std::string>& row) {
  const Section* const section = find_section(row[0]);
  const bool limited = row[1].find("accuracy_limit") != std::string::npos;
  return section && is_solver_of(setting, row[2]) && (!limited || setting.accuracy_limit) &&
         std::ranges::all_of(section->needs,
                             [&](const char* need) { return meets(setting, need); });
}

struct ElementWords {
  const char *name, *plural;
};
// The elements of a row, which its solver's cell names where they are not linear tets.
ElementWords elements_of(const std::string& solver) {
  for (const ElementWords& words :
       {ElementWords{"quadratic", "quadratic tets"}, {"smoothed", "smoothed elements"}}) {
    if (solver.find(words.name) != std::string::npos) return words;
  }
  return {"linear", "linear tets"};
}

Json row_json(const Setting& setting, const ResultTable& table,
              const std::vector<std::string>& row) {
  Json differs = Json::array();
  const ElementWords own = elements_of(row[2]);
  if (setting.method != "pbd" && setting.element != own.name) differs.push_back(own.plural);
  if (row[3] != setting.precision && row[3] != "any") differs.push_back(row[3]);
  const bool failed = row[4].find("failed") != std::string::npos;
  return {{"table", table.file},
          {"program", table.program},
          {"dated", table.dated},
          {"section", row[0]},
          {"subject", subject_of(row[0])},
          {"case", row[1]},
          {"solver", row[2]},
          {"precision", row[3]},
          {"outcome", failed ? "failed" : row[4]},
          {"figures", row[5]},
          {"differs", std::move(differs)}};
}

// Of equal cases in two precisions the one that is the run's.
Json rows_of(const Setting& setting, bool measured) {
  Json rows = Json::array();
  for (const ResultTable& table : result_tables(setting.on_device)) {
    for (const auto& row : table.rows) {
      if ((row[0] == measured_section) != measured || !concerns(setting, row)) continue;
      const bool is_other =
          row[3] != setting.precision && std::ranges::any_of(table.rows, [&](const auto& twin) {
            return twin[0] == row[0] && twin[1] == row[1] && twin[2] == row[2] &&
                   twin[3] == setting.precision;
          });
      if (!is_other) rows.push_back(row_json(setting, table, row));
    }
  }
  return rows;
}

}  // namespace

std::vector<ResultTable> result_tables(bool on_device) {
  if (on_device) {
    return {read_table("verification_cuda.md", VISCERA_EMBEDDED_TEXT(verification_cuda_md)),
            read_table("hard_cases_cuda.md", VISCERA_EMBEDDED_TEXT(hard_cases_cuda_md))};
  }
  return {read_table("verification.md", VISCERA_EMBEDDED_TEXT(verification_md)),
          read_table("hard_cases.md", VISCERA_EMBEDDED_TEXT(hard_cases_md))};
}

std::string subject_of(const std::string& section) {
  const Section* const found = find_section(section);
  return found ? found->subject : "";
}

Json verification_rows(const Setting& setting) {
  return rows_of(setting, false);
}

Json measured_rows(const Setting& setting) {
  Json rows = rows_of(setting, true);
  for (Json& row : csv_objects(VISCERA_EMBEDDED_TEXT(measured_csv))) {
    const auto solver = row.find("solver");
    if (solver == row.end() || !is_solver_of(setting, *solver)) continue;
    row["table"] = "measured.csv";
    rows.push_back(std::move(row));
  }
  return rows;
}

Json error_bar_rows(const std::string& element) {
  Json rows = Json::array();
  for (Json& row : csv_objects(VISCERA_EMBEDDED_TEXT(error_bar_csv))) {
    if (row["element"] == element) rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace viscera::engine
