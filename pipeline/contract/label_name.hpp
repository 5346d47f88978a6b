// What may name a label (a material): a text that every file format and page on the way takes as it
// is, so that a name means the same in every stage.
#pragma once

#include <string>

#include "pipeline/base/error.hpp"

namespace viscera {

// Bytes. Two names make that of an interface, of which Gmsh takes 256.
inline constexpr std::size_t max_label_name = 100;

// Throws Error(code) in the name of `where` and `field` unless the name is UTF-8 of 1 to
// max_label_name bytes, without control characters, and without blanks at its ends. Backslashes,
// quotes and brackets are letters like others.
void check_label_name(const std::string& name, ExitCode code, const std::string& where,
                      const std::string& field);

}  // namespace viscera
