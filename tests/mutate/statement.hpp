// The places of one statement or of the head of one: what is replaced, and by what.
#pragma once

#include <string_view>

#include "tests/mutate/mask.hpp"
#include "tests/mutate/mutant.hpp"

namespace viscera::mutate {

class StatementSink {
 public:
  /// `masked` must outlive it.
  StatementSink(const std::string& file, const std::string& text, const Masked& masked)
      : file_(file), text_(text), masked_(masked) {}

  /// [begin, end): up to the semicolon.
  void statement(std::size_t begin, std::size_t end);
  /// [begin, end): up to the brace: if (…), for (…), while (…).
  void head(std::size_t begin, std::size_t end) { strip_heads(begin, end); }

  std::vector<Place> places;

 private:
  std::string_view code(std::size_t begin, std::size_t end) const;
  std::size_t strip_heads(std::size_t begin, std::size_t end);
  void loop_head(std::size_t begin, std::size_t end);
  void condition(std::size_t begin, std::size_t end, bool leaves);
  void values(std::size_t begin, std::size_t end);
  // Every edit of [begin, end) in the form before + changed + between + original + after.
  void add_edits(std::size_t begin, std::size_t end, const std::string& before,
                 const std::string& between, const std::string& after);
  void add(const std::string& kind, std::size_t begin, std::size_t end, const std::string& changed,
           const std::string& text);

  std::string file_, text_;
  const Masked& masked_;
};

}  // namespace viscera::mutate
