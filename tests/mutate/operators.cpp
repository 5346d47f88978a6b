#include "tests/mutate/operators.hpp"

#include <regex>
#include <utility>

namespace viscera::mutate {
namespace {

struct Pattern {
  const char* kind;
  std::regex what;
  const char* with;  // $1, $2: what the brackets of the pattern found
};

// The house style puts spaces around binary operators and none into the brackets of templates.
const std::vector<Pattern>& patterns() {
  static const std::vector<Pattern> all = [] {
    const std::pair<const char*, std::pair<const char*, const char*>> list[] = {
        {"sign", {R"( \+ (?!1\b(?!\.)))", " - "}},
        {"sign", {R"( - (?!1\b(?!\.)))", " + "}},
        {"sign", {R"( \+= )", " -= "}},
        {"sign", {R"( -= )", " += "}},
        {"sign", {R"(([(,=*?:\[{] ?|return |^)-(?=[A-Za-z_(]))", "$1"}},
        {"off by one", {R"( < )", " <= "}},
        {"off by one", {R"( <= )", " < "}},
        {"off by one", {R"( > )", " >= "}},
        {"off by one", {R"( >= )", " > "}},
        {"off by one", {R"( [-+] 1\b(?!\.))", ""}},
        {"index", {R"(\[0\])", "[1]"}},
        {"index", {R"(\[1\])", "[0]"}},
        {"index", {R"(\[2\])", "[0]"}},
        {"index", {R"(\.x\b(?!\())", ".y"}},
        {"index", {R"(\.y\b(?!\())", ".z"}},
        {"index", {R"(\.z\b(?!\())", ".x"}},
        {"index", {R"(\[([a-z])\]\[(?!\1)([a-z])\])", "[$2][$1]"}},
        {"least for most", {R"(std::min\()", "std::max("}},
        {"least for most", {R"(std::max\()", "std::min("}},
        {"condition", {R"( && )", " || "}},
        {"condition", {R"( \|\| )", " && "}},
        {"condition", {R"( == )", " != "}},
        {"condition", {R"( != )", " == "}},
        {"condition", {R"(!(?=[A-Za-z_(]))", ""}},
        {"condition", {R"(\btrue\b)", "false"}},
        {"condition", {R"(\bfalse\b)", "true"}},
        {"factor 2", {R"( \* )", " * 2 * "}},
        {"factor 2", {R"( / )", " / 2 / "}},
        {"factor 2", {R"(\b0\.5\b)", "1.0"}},
        {"factor 2", {R"(\b2\.0\b)", "4.0"}},
        {"factor 2", {R"(\bT\(([1-9])\))", "T(2 * $1)"}},
    };
    std::vector<Pattern> made;
    for (const auto& [kind, change] : list) {
      made.push_back({kind, std::regex(change.first), change.second});
    }
    return made;
  }();
  return all;
}

}  // namespace

std::vector<Edit> edits_of(std::string_view masked) {
  std::vector<Edit> edits;
  for (const Pattern& pattern : patterns()) {
    using Match = std::cregex_iterator;
    for (Match match(masked.data(), masked.data() + masked.size(), pattern.what); match != Match();
         ++match) {
      edits.push_back({pattern.kind, static_cast<std::size_t>(match->position()),
                       static_cast<std::size_t>(match->length()), match->format(pattern.with)});
    }
  }
  return edits;
}

}  // namespace viscera::mutate
