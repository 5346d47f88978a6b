#include "pipeline/engine/spec/case_table.hpp"

#include <fmt/format.h>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

struct Cell {
  std::string text;
  std::string where;  // file:line:column
};
using Row = std::vector<Cell>;

class TableReader {
 public:
  TableReader(const fs::path& path, std::string text) : path_(path), text_(std::move(text)) {}

  // Rows that hold something.
  std::vector<Row> read() {
    std::vector<Row> rows;
    while (at_ < text_.size()) {
      const bool comment = text_[at_] == '#';
      Row row = read_row();
      const bool empty = row.size() == 1 && row.front().text.empty();
      if (!comment && !empty) rows.push_back(std::move(row));
    }
    return rows;
  }

 private:
  Row read_row() {
    Row row;
    do {
      row.push_back(read_cell());
    } while (skip(','));
    skip('\r');
    if (at_ < text_.size() && !skip('\n')) {
      throw Error(ExitCode::bad_config, {.where = here(),
                                         .found = "text after a closing quote",
                                         .allowed = "a comma or the end of the line"});
    }
    return row;
  }

  Cell read_cell() {
    Cell cell{.where = here()};
    if (!skip('"')) {
      while (at_ < text_.size() && text_[at_] != ',' && text_[at_] != '\n' && text_[at_] != '\r')
        cell.text += next();
      const auto begin = cell.text.find_first_not_of(" \t");
      if (begin == std::string::npos) return {"", cell.where};
      cell.text = cell.text.substr(begin, cell.text.find_last_not_of(" \t") - begin + 1);
      return cell;
    }
    while (true) {
      if (at_ == text_.size()) {
        throw Error(ExitCode::bad_config, {.where = cell.where, .found = "'\"' without its end"});
      }
      const char c = next();
      if (c == '"' && !skip('"')) return cell;
      cell.text += c;
    }
  }

  char next() {
    const char c = text_[at_++];
    ++column_;
    if (c == '\n') ++line_, column_ = 1;
    return c;
  }
  bool skip(char wanted) {
    if (at_ == text_.size() || text_[at_] != wanted) return false;
    next();
    return true;
  }
  std::string here() const { return fmt::format("{}:{}:{}", path_.string(), line_, column_); }

  const fs::path& path_;
  std::string text_;
  std::size_t at_ = 0;
  int line_ = 1, column_ = 1;
};

std::string table_text(const fs::path& path) {
  std::error_code failure;
  const auto fail = [&path](const char* found, const char* allowed) {
    return Error(ExitCode::bad_config,
                 {.where = path.string(), .field = "cases", .found = found, .allowed = allowed});
  };
  if (!fs::is_regular_file(path, failure)) {
    throw fail("no such file", "a table of cases beside the spec");
  }
  if (fs::file_size(path, failure) > max_table_bytes) throw fail("too large", "at most 16 MiB");
  std::string text = read_file(path);
  if (text.starts_with("\xef\xbb\xbf")) text.erase(0, 3);  // as spreadsheets write it
  return text;
}

}  // namespace

std::vector<Case> read_case_table(const fs::path& path) {
  const std::vector<Row> rows = TableReader(path, table_text(path)).read();
  if (rows.size() < 2 || rows.front().front().text != "case") {
    throw Error(
        ExitCode::bad_config,
        {.where = rows.empty() ? path.string() : rows.front().front().where,
         .field = "cases",
         .found = rows.empty() ? "no row" : "'" + rows.front().front().text + "'",
         .allowed = "a row of names, case,VARIABLE,STAGE.PARAM,…, and a row for each case"});
  }
  const Row& names = rows.front();
  std::vector<Case> cases;
  for (auto row = rows.begin() + 1; row != rows.end(); ++row) {
    if (row->size() != names.size()) {
      throw Error(ExitCode::bad_config, {.where = row->front().where,
                                         .field = row->front().text,
                                         .found = fmt::format("{} cells", row->size()),
                                         .allowed = fmt::format("{}, as names", names.size())});
    }
    Case one{.name = row->front().text, .where = row->front().where};
    for (std::size_t i = 1; i < names.size(); ++i) {
      const auto& [text, where] = (*row)[i];
      if (text.empty()) continue;
      const bool flow = text.starts_with('{') || text.starts_with('[');
      try {
        const YAML::Node value = flow ? YAML::Load(text) : YAML::Node(text);
        one.settings.push_back({names[i].text, value, where, path});
      } catch (const YAML::Exception& e) {
        throw Error(ExitCode::bad_config, {.where = where,
                                           .field = names[i].text,
                                           .found = e.msg,
                                           .allowed = "a value, [a, b] or {name: value}"});
      }
    }
    cases.push_back(std::move(one));
  }
  return cases;
}

}  // namespace viscera::engine
