#include "tests/mutate/statement.hpp"

#include <algorithm>
#include <cctype>
#include <regex>

#include "tests/mutate/operators.hpp"

namespace viscera::mutate {
namespace {

// In one line, spaces single but for those within quotes.
std::string in_one_line(std::string_view text) {
  std::string line;
  char quote = 0;
  bool escaped = false;
  for (const char c : text) {
    if (quote) {
      line += c;
      if (c == quote && !escaped) quote = 0;
      escaped = c == '\\' && !escaped;
      continue;
    }
    const bool space = std::isspace(static_cast<unsigned char>(c));
    if (space && (line.empty() || line.back() == ' ')) continue;
    const bool separates_digits = !line.empty() && std::isalnum(line.back());
    if (c == '"' || (c == '\'' && !separates_digits)) quote = c;
    line += space ? ' ' : c;
  }
  if (!line.empty() && line.back() == ' ') line.pop_back();
  return line;
}

bool matches(std::string_view text, const std::regex& what) {
  return std::regex_search(text.begin(), text.end(), what);
}

// Of the first character of `which` outside brackets and braces, from `at` on; text's end where
// none is.
std::size_t find_outside(std::string_view text, std::string_view which, std::size_t at) {
  int depth = 0;
  for (; at < text.size(); ++at) {
    const char c = text[at];
    if (depth == 0 && which.find(c) != std::string_view::npos) return at;
    if (c == '(' || c == '[' || c == '{') ++depth;
    if (c == ')' || c == ']' || c == '}') --depth;
  }
  return at;
}

std::size_t end_of_brackets(std::string_view text, std::size_t open) {
  int depth = 0;
  for (std::size_t i = open; i < text.size(); ++i) {
    if (text[i] == '(') ++depth;
    if (text[i] == ')' && --depth == 0) return i;
  }
  return text.size();
}

std::size_t skip_space(std::string_view text, std::size_t at) {
  while (at < text.size() && std::isspace(static_cast<unsigned char>(text[at]))) ++at;
  return at;
}

// Of the `=` of a declaration or an assignment; text's end where there is none.
std::size_t find_equals(std::string_view text) {
  for (std::size_t at = find_outside(text, "=", 0); at < text.size();
       at = find_outside(text, "=", at + 1)) {
    const char before = at > 0 ? text[at - 1] : ' ';
    if (before == ' ' && at + 1 < text.size() && text[at + 1] != '=') return at;
    if (at + 1 < text.size() && text[at + 1] == '=') ++at;
  }
  return text.size();
}

}  // namespace

std::string_view StatementSink::code(std::size_t begin, std::size_t end) const {
  return std::string_view(masked_.code).substr(begin, end - begin);
}

void StatementSink::add(const std::string& kind, std::size_t begin, std::size_t end,
                        const std::string& changed, const std::string& text) {
  Place place{
      .file = file_, .kind = kind, .changed = in_one_line(changed), .begin = begin, .end = end};
  const std::string_view bare(masked_.bare);
  place.original = in_one_line(bare.substr(begin, end - begin));
  if (place.original == place.changed) return;
  const auto lines = [this](std::size_t upto) {
    return static_cast<int>(
        std::count(text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(upto), '\n'));
  };
  place.line = lines(begin) + 1;
  place.last_line = lines(end) + 1;
  // As many lines as before, so that the compiler's errors name the lines of the source.
  place.text =
      in_one_line(text) + std::string(static_cast<std::size_t>(place.last_line - place.line), '\n');
  // A block takes the semicolon with it: an else may follow.
  if (text.starts_with("{") && masked_.code.compare(end, 1, ";") == 0) ++place.end;
  places.push_back(place);
}

void StatementSink::add_edits(std::size_t begin, std::size_t end, const std::string& before,
                              const std::string& between, const std::string& after) {
  const std::string original = masked_.bare.substr(begin, end - begin);
  for (const Edit& edit : edits_of(code(begin, end))) {
    std::string changed = original;
    changed.replace(edit.at, edit.length, edit.with);
    add(edit.kind, begin, end, changed, before + changed + between + original + after);
  }
}

void StatementSink::condition(std::size_t begin, std::size_t end, bool leaves) {
  const std::string_view text = code(begin, end);
  static const std::regex declares(R"( = |;|\{)");
  if (matches(text, declares)) return;
  const std::string start = "viscera::mutated(@) ? static_cast<bool>(",
                    middle = ") : static_cast<bool>(";
  add_edits(begin, end, start, middle, ")");
  if (leaves) {
    add("skipped check", begin, end, "false",
        start + "false" + middle + masked_.bare.substr(begin, end - begin) + ")");
  }
}

void StatementSink::loop_head(std::size_t begin, std::size_t end) {
  const std::string_view text = code(begin, end);
  const std::size_t first = find_outside(text, ";", 0);
  if (first >= text.size()) return;
  const std::size_t second = find_outside(text, ";", first + 1);
  static const std::regex from_zero(R"(= 0$)");
  if (matches(text.substr(0, first), from_zero)) {
    add("first left out", begin + first - 1, begin + first, "1", "(viscera::mutated(@) ? 1 : 0)");
    places.back().original = in_one_line(text.substr(0, second));
    places.back().changed = in_one_line(std::string(text.substr(0, first - 1)) + "1" +
                                        std::string(text.substr(first, second - first)));
  }
  condition(begin + skip_space(text, first + 1), begin + second, false);
}

// Takes `else`, `if (…)`, `for (…)` and labels off; returns where the rest begins.
std::size_t StatementSink::strip_heads(std::size_t begin, std::size_t end) {
  static const std::regex head(
      R"(^(else\b|do\b|SIM_NO_UNROLL\b|case [^:]*(::[^:]+)*:(?!:)|default:|(if constexpr|if|for|while|switch) \())");
  for (;;) {
    begin = std::min(skip_space(masked_.code, begin), end);
    const std::string_view text = code(begin, end);
    std::match_results<std::string_view::const_iterator> found;
    if (!std::regex_search(text.begin(), text.end(), found, head)) return begin;
    if (!found[3].matched) {
      begin += static_cast<std::size_t>(found.length());
      continue;
    }
    const std::string word = found[3].str();
    const std::size_t open = static_cast<std::size_t>(found.length()) - 1;
    const std::size_t close = end_of_brackets(text, open);
    if (close >= text.size()) return end;
    const std::string_view rest = text.substr(skip_space(text, close + 1));
    if (word == "for") loop_head(begin + open + 1, begin + close);
    if (word == "if" || word == "while") {
      condition(begin + open + 1, begin + close,
                word == "if" && (rest.starts_with("throw") || rest.starts_with("return") ||
                                 rest.starts_with("continue")));
    }
    begin += close + 1;
  }
}

// Values of a declaration, one after the other: `T a = x, b = y`.
void StatementSink::values(std::size_t begin, std::size_t end) {
  const std::string_view text = code(begin, end);
  for (std::size_t at = find_equals(text); at < text.size();) {
    const std::size_t from = skip_space(text, at + 1);
    const std::size_t to = find_outside(text, ",", from);
    if (text.substr(from, to - from).find('{') == std::string_view::npos) {
      add_edits(begin + from, begin + to, "viscera::mutated(@) ? (", ") : (", ")");
    }
    const std::size_t next = to < text.size() ? find_equals(text.substr(to + 1)) : 0;
    at = to < text.size() ? to + 1 + next : text.size();
  }
}

void StatementSink::statement(std::size_t begin, std::size_t end) {
  begin = strip_heads(begin, end);
  const std::string_view text = code(begin, end);
  static const std::regex none(
      R"(#|^(using|typedef|static|static_assert|constexpr|break|continue|throw|goto|delete|friend|template|public|private|struct|class)\b|\bthrow\b|reserve\(|static_cast<void>|[Ll]og\b|^$)");
  if (matches(text, none)) return;
  const std::string original = masked_.bare.substr(begin, end - begin);
  if (text.starts_with("return")) {
    const std::size_t from = begin + skip_space(text, 6);
    if (from >= end || masked_.code[from] == '{' ||
        code(from, end).find("[&") != std::string_view::npos)
      return;
    // Braces, for the statement may follow an if without any. An edit never touches the word.
    for (const Edit& edit : edits_of(code(from, end))) {
      std::string changed = masked_.bare.substr(from, end - from);
      changed.replace(edit.at, edit.length, edit.with);
      add(edit.kind, begin, end, "return " + changed,
          "{ if (viscera::mutated(@)) return " + changed + "; else " + original + "; }");
    }
    return;
  }
  static const std::regex declares(
      R"(^(const |auto |unsigned )|^[\w:]+(<.*>)?[&*]* [&*]*[A-Za-z_]\w*(\[[^\]]*\])*( = |, |$|\{|\())");
  if (matches(text, declares)) return values(begin, end);
  // What computes or calls: both forms in a block, for it may follow an if without braces.
  const std::string before = "{ if (viscera::mutated(@)) { ", between = "; } else { ",
                    after = "; } }";
  add_edits(begin, end, before, between, after);
  static const std::regex acts(R"(^[\w:.\->\[\]()* +]+(\(| [-+*/]?= ))");
  if (matches(text, acts)) {
    static const std::regex adds(R"( [-+]= )");
    add(matches(text, adds) ? "dropped sum" : "dropped statement", begin, end, "",
        before + between + original + after);
  }
}

}  // namespace viscera::mutate
