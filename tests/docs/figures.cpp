#include "tests/docs/figures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>
#include <optional>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "pipeline/base/atomic_file.hpp"

namespace viscera {
namespace {

using Row = std::map<std::string, std::string>;  // cell by column

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(' ');
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(' ') - first + 1);
}

// Between separators that stand outside of quotation marks.
std::vector<std::string> parts_of(const std::string& line, char separator) {
  std::vector<std::string> parts(1);
  bool quoted = false;
  for (const char c : line) {
    if (c == '"') quoted = !quoted;
    if (c == separator && !quoted) {
      parts.emplace_back();
    } else if (c != '"') {
      parts.back() += c;
    }
  }
  for (std::string& part : parts) part = trimmed(part);
  return parts;
}

Row row_of(const std::vector<std::string>& columns, const std::vector<std::string>& cells) {
  Row row;
  for (std::size_t i = 0; i < std::min(columns.size(), cells.size()); ++i) {
    row[columns[i]] = cells[i];
  }
  return row;
}

std::vector<Row> rows_of_csv(const std::string& text) {
  std::vector<Row> rows;
  std::vector<std::string> columns;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const auto cells = parts_of(line, ',');
    if (columns.empty()) {
      columns = cells;
    } else {
      rows.push_back(row_of(columns, cells));
    }
  }
  return rows;
}

std::vector<Row> rows_of_markdown(const std::string& text) {
  std::vector<Row> rows;
  std::vector<std::string> columns;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with("|")) {
      columns.clear();
      continue;
    }
    std::vector<std::string> cells;
    std::istringstream between(line.substr(1));
    for (std::string cell; std::getline(between, cell, '|');) cells.push_back(trimmed(plain(cell)));
    if (columns.empty()) {
      columns = cells;
    } else if (line.find_first_not_of("|-: ") != std::string::npos) {
      rows.push_back(row_of(columns, cells));
    }
  }
  return rows;
}

const std::vector<Row>& rows_of(const std::string& name) {
  static std::map<std::string, std::vector<Row>> read;
  const auto known = read.find(name);
  if (known != read.end()) return known->second;
  const std::string text = read_file("docs/results/" + name);
  return read[name] = name.ends_with(".csv") ? rows_of_csv(text) : rows_of_markdown(text);
}

// The first number of a text, as it is printed; thousands may have commas.
std::optional<std::string> first_number(const std::string& text) {
  static const std::regex number(R"([-+]?(\d{1,3}(,\d{3})+|\d+)?(\.\d+|\d)?([eE][-+]?\d+)?)");
  const auto digit = std::ranges::find_if(text, [](unsigned char c) { return std::isdigit(c); });
  if (digit == text.end()) return std::nullopt;
  auto from = digit;
  if (from != text.begin() && *(from - 1) == '.') --from;
  if (from != text.begin() && (*(from - 1) == '-' || *(from - 1) == '+')) --from;
  std::smatch match;
  if (!std::regex_search(from, text.end(), match, number)) return std::nullopt;
  std::string found = match.str();
  std::erase(found, ',');
  return found;
}

class Formula {
 public:
  explicit Formula(const std::string& text) : text_(text) {}

  double value() {
    const double result = sum();
    if (at_ < text_.size()) refuse("nothing more");
    return result;
  }

 private:
  [[noreturn]] void refuse(const std::string& expected) const {
    throw std::runtime_error(
        fmt::format("{}: expected {} at \"{}\"", text_, expected, text_.substr(at_)));
  }
  char next() {
    while (at_ < text_.size() && text_[at_] == ' ') ++at_;
    return at_ < text_.size() ? text_[at_] : '\0';
  }
  bool take(char c) {
    if (next() != c) return false;
    ++at_;
    return true;
  }
  void need(char c) {
    if (!take(c)) refuse(std::string(1, c));
  }
  // Up to one of these, outside of quotation marks.
  std::string until(const char* ends) {
    next();
    const auto begin = at_;
    bool quoted = false;
    for (; at_ < text_.size(); ++at_) {
      if (text_[at_] == '"') quoted = !quoted;
      if (!quoted && std::string(ends).find(text_[at_]) != std::string::npos) break;
    }
    std::string found = trimmed(text_.substr(begin, at_ - begin));
    std::erase(found, '"');
    return found;
  }

  double sum() {
    double result = product();
    for (;;) {
      if (take('+')) {
        result += product();
      } else if (take('-')) {
        result -= product();
      } else {
        return result;
      }
    }
  }
  double product() {
    double result = factor();
    for (;;) {
      if (take('*')) {
        result *= factor();
      } else if (take('/')) {
        result /= factor();
      } else {
        return result;
      }
    }
  }
  double factor() {
    if (take('(')) {
      const double result = sum();
      need(')');
      return result;
    }
    if (std::isdigit(static_cast<unsigned char>(next())) || next() == '.') {
      std::size_t read = 0;
      const double result = std::stod(text_.substr(at_), &read);
      at_ += read;
      return result;
    }
    for (const char* of_all : {"max(", "min(", "count("}) {
      if (text_.compare(at_, std::string(of_all).size(), of_all) != 0) continue;
      at_ += std::string(of_all).size();
      const auto values = cells();
      need(')');
      if (of_all[0] == 'c') return static_cast<double>(values.size());
      if (values.empty()) throw std::runtime_error(text_ + ": no row is like that");
      return of_all[1] == 'a' ? std::ranges::max(values) : std::ranges::min(values);
    }
    const auto values = cells();
    if (values.size() != 1) {
      throw std::runtime_error(fmt::format("{}: {} rows are like that", text_, values.size()));
    }
    return values.front();
  }

  std::vector<double> cells() {
    const std::string file = until("{");
    need('{');
    Row wanted;
    while (next() != '}') {
      const std::string column = until("=}");
      need('=');
      wanted[column] = until(",}");
      if (!take(',') && next() != '}') refuse("} ");
    }
    need('}');
    need('.');
    const std::string column = until(" :)*/+-");
    std::string before;
    if (take(':')) before = until(" )*/+-");
    std::vector<double> values;
    for (const Row& row : rows_of(file)) {
      const bool like_that = std::ranges::all_of(wanted, [&row](const auto& cell) {
        const auto found = row.find(cell.first);
        return found != row.end() && found->second == cell.second;
      });
      const auto cell = row.find(column);
      if (!like_that || cell == row.end()) continue;
      const auto place = cell->second.find(before);
      if (place == std::string::npos) continue;
      if (const auto number = first_number(cell->second.substr(place + before.size()))) {
        values.push_back(std::stod(*number));
      }
    }
    return values;
  }

  std::string text_;
  std::size_t at_ = 0;
};

}  // namespace

std::string plain(const std::string& text) {
  static const std::regex link(R"(!?\[([^\]]*)\]\([^)]*\))"), blanks(R"(\s+)");
  std::string result = std::regex_replace(text, link, "$1");
  std::erase(result, '`');
  std::erase(result, '*');
  return std::regex_replace(result, blanks, " ");
}

double value_of(const std::string& formula) {
  return Formula(formula).value();
}

bool is_printed_as(double value, const std::string& figure) {
  const auto number = first_number(figure);
  if (!number) return false;
  const auto exponent_at = number->find_first_of("eE");
  const double exponent =
      exponent_at == std::string::npos ? 0.0 : std::stod(number->substr(exponent_at + 1));
  const std::string digits = number->substr(0, exponent_at);
  const auto point = digits.find('.');
  const double decimals =
      point == std::string::npos ? 0.0 : static_cast<double>(digits.size() - point - 1);
  const double half = 0.5 * std::pow(10.0, exponent - decimals);
  return std::abs(value - std::stod(*number)) <= half * (1.0 + 1e-9);
}

}  // namespace viscera
