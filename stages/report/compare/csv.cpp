#include "stages/report/compare/csv.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "stages/report/csv_cell.hpp"

namespace viscera {
namespace {

bool is_quartiles(const Json& value) {
  return value.is_array() && value.size() == 3 && value[0].is_number();
}

std::string cell(const Json& value) {
  if (value.is_null()) return "";
  if (value.is_number_float()) return fmt::format("{:.6g}", value.get<double>());
  if (value.is_number()) return value.dump();
  return csv_cell(value.is_string() ? value.get<std::string>() : value.dump());
}

}  // namespace

std::string csv_of(const Json& rows) {
  if (rows.empty()) return "";
  std::vector<std::string> names, columns;
  for (const auto& [name, value] : rows[0].items()) {
    names.push_back(name);
    if (is_quartiles(value)) {
      columns.insert(columns.end(), {name + "_q1", name, name + "_q3"});
    } else {
      columns.push_back(name);
    }
  }
  std::string csv = fmt::format("{}\n", fmt::join(columns, ","));
  for (const auto& row : rows) {
    std::vector<std::string> cells;
    for (const auto& name : names) {
      const Json& value = row.at(name);
      if (is_quartiles(value)) {
        for (const auto& one : value) cells.push_back(cell(one));
      } else {
        cells.push_back(cell(value));
      }
    }
    csv += fmt::format("{}\n", fmt::join(cells, ","));
  }
  return csv;
}

}  // namespace viscera
