#include "tests/mutate/mask.hpp"

#include <algorithm>
#include <cctype>

namespace viscera::mutate {
namespace {

// Replaces what is no line's end.
void fill(std::string& text, std::size_t begin, std::size_t end, char with) {
  for (std::size_t i = begin; i < std::min(end, text.size()); ++i) {
    if (text[i] != '\n') text[i] = with;
  }
}

std::size_t end_of_quote(const std::string& text, std::size_t at) {
  const char quote = text[at];
  for (++at; at < text.size() && text[at] != quote; ++at) {
    if (text[at] == '\\') ++at;
  }
  return at;
}

void mask_comments_and_strings(Masked& made) {
  std::string& code = made.code;
  for (std::size_t i = 0; i < code.size(); ++i) {
    if (code.compare(i, 2, "//") == 0) {
      const std::size_t end = std::min(code.find('\n', i), code.size());
      fill(made.bare, i, end, ' '), fill(code, i, end, ' ');
      i = end;
    } else if (code.compare(i, 2, "/*") == 0) {
      const std::size_t end = std::min(code.find("*/", i), code.size() - 2) + 2;
      fill(made.bare, i, end, ' '), fill(code, i, end, ' ');
      i = end - 1;
    } else if (code.compare(i, 2, "R\"") == 0) {
      const std::size_t open = code.find('(', i);
      std::string close = ")";
      close.append(code, i + 2, open - i - 2).push_back('"');
      const std::size_t end = std::min(code.find(close, open), code.size());
      fill(code, i, end + close.size(), 'q');
      i = end + close.size() - 1;
    } else if (code[i] == '"' || (code[i] == '\'' && (i == 0 || !std::isalnum(code[i - 1])))) {
      const std::size_t end = end_of_quote(code, i);
      fill(code, i + 1, end, 'q');
      i = end;
    }
  }
}

void mask_preprocessor(Masked& made) {
  int depth = 0, cuda_at = 0;  // how many #if are open, and which of them is CUDA's
  bool goes_on = false;
  for (std::size_t i = 0; i < made.code.size();) {
    const std::size_t end = std::min(made.code.find('\n', i), made.code.size());
    const std::string line = made.code.substr(i, end - i);
    const auto first = line.find_first_not_of(' ');
    const bool directive = first != std::string::npos && line[first] == '#';
    if (directive && line.find("#if") != std::string::npos) {
      ++depth;
      if (!cuda_at && line.find("CUDA") != std::string::npos) cuda_at = depth;
    }
    const bool leaves =
        line.find("#else") != std::string::npos || line.find("#endif") != std::string::npos;
    if (directive && leaves && cuda_at == depth) cuda_at = 0;
    if (directive && line.find("#endif") != std::string::npos) --depth;
    if (directive || goes_on || cuda_at) {
      fill(made.bare, i, end, '#'), fill(made.code, i, end, '#');
    }
    goes_on = (directive || goes_on) && !line.empty() && line.back() == '\\';
    i = end + 1;
  }
}

}  // namespace

Masked mask(const std::string& text) {
  Masked made{text, text};
  mask_comments_and_strings(made);
  mask_preprocessor(made);
  return made;
}

}  // namespace viscera::mutate
