#include "tests/mutate/find.hpp"

#include <algorithm>
#include <cctype>
#include <regex>

#include "tests/mutate/mask.hpp"
#include "tests/mutate/statement.hpp"

namespace viscera::mutate {
namespace {

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(" \n");
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(" \n") - begin + 1);
}

enum class Brace { code, type, value };

// What a brace opens, by the text between the last statement and it.
Brace kind_of(const std::string& head, bool within_brackets) {
  static const std::regex body(
      R"((\)|\]|\}|\bconst|\boverride|\bnoexcept|\belse|\bdo|\btry|\bmutable|->\s*[\w:<>&, ]+)$)");
  static const std::regex type(
      R"(^(template.*>\s*)?(inline )?(namespace|struct|class|enum|union|extern)\b)");
  if (!within_brackets && std::regex_search(head, type) && head.back() != ')') return Brace::type;
  if (head.empty()) return within_brackets ? Brace::value : Brace::code;
  if (std::regex_search(head, body)) return Brace::code;
  return Brace::value;
}

struct Frame {
  Brace kind;
  bool forbidden;     // constant expressions: the number of a mutant is none
  int brackets;       // open ones before the brace
  std::size_t start;  // of the statement that holds the brace
  bool holds_braces;  // whether that statement did before
};

class Scanner {
 public:
  Scanner(const std::string& file, const std::string& text)
      : masked_(mask(text)), sink_(file, text, masked_) {}

  std::vector<Place> scan() {
    for (std::size_t i = 0; i < masked_.code.size(); ++i) {
      const char c = masked_.code[i];
      if (c == '(' || c == '[') ++brackets_;
      if (c == ')' || c == ']') --brackets_;
      if (c == '{') open(i);
      if (c == '}') close(i);
      if (c == ';' && brackets_ == 0) end_statement(i);
      if (c == '#' && trimmed(masked_.code.substr(start_, i - start_)).empty()) start_ = i + 1;
    }
    return std::move(sink_.places);
  }

 private:
  bool in_code() const { return !frames_.empty() && frames_.back().kind == Brace::code; }
  bool forbidden() const { return !frames_.empty() && frames_.back().forbidden; }

  void open(std::size_t at) {
    const std::string head = trimmed(masked_.code.substr(start_, at - start_));
    const Brace kind = kind_of(head, brackets_ > 0);
    static const std::regex constant(
        R"((^|[^f] |[^f ])\b(constexpr|consteval|static_assert|enum)\b)");
    if (in_code() && kind == Brace::code && brackets_ == 0 && !forbidden() && !holds_braces_) {
      sink_.head(start_, at);
    }
    const bool fixed = forbidden() || std::regex_search(head, constant);
    frames_.push_back({kind, fixed, brackets_, start_, holds_braces_});
    brackets_ = 0;
    if (kind != Brace::value) start_ = at + 1, holds_braces_ = false;
  }

  void close(std::size_t at) {
    if (frames_.empty()) return;
    const Frame frame = frames_.back();
    frames_.pop_back();
    const bool within =
        frame.kind == Brace::value || frame.brackets > 0 || is_lambda(frame.start, at);
    brackets_ = frame.brackets;
    start_ = within ? frame.start : at + 1;
    holds_braces_ = within && (frame.holds_braces || frame.kind == Brace::code);
  }

  // `const auto work = [&] { … };` goes on after its brace.
  bool is_lambda(std::size_t begin, std::size_t end) const {
    const std::string head =
        masked_.code.substr(begin, std::min(masked_.code.find('{', begin), end) - begin);
    return head.find("= [") != std::string::npos || head.find("return [") != std::string::npos;
  }

  void end_statement(std::size_t at) {
    if (in_code() && !forbidden() && !holds_braces_) sink_.statement(start_, at);
    start_ = at + 1;
    holds_braces_ = false;
  }

  Masked masked_;
  StatementSink sink_;
  std::vector<Frame> frames_;
  int brackets_ = 0;
  std::size_t start_ = 0;
  bool holds_braces_ = false;  // of a lambda, whose statements are places of their own
};

}  // namespace

std::vector<Place> places_of(const std::string& file, const std::string& text) {
  return Scanner(file, text).scan();
}

}  // namespace viscera::mutate
