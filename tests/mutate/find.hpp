// Finds the places of a source that can be changed. It knows braces, statements and the heads of
// if, for and while, which the house style makes easy to tell; what it takes for code and is none
// does not compile and is dropped.
#pragma once

#include "tests/mutate/mutant.hpp"

namespace viscera::mutate {

/// All of them, in the order of the text. Those of one statement overlap: only one can be chosen.
std::vector<Place> places_of(const std::string& file, const std::string& text);

}  // namespace viscera::mutate
