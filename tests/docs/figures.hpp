// Figures that stand in the tables of docs/results, and arithmetic on them.
#pragma once

#include <string>

namespace viscera {

// `text` with the marks of Markdown (code, bold, links) taken away and every run of blanks as one.
std::string plain(const std::string& text);

// The value of a formula such as
//
//   h200/liver_5kPa.csv{tets=50225, scheme=gauss_seidel, substeps=32}.frame_ms / 2
//
// Numbers, cells, + - * / and brackets; max(CELLS), min(CELLS) and count(CELLS). A cell is named by
// a file under docs/results, what the columns of its row hold (in quotes where there is a comma)
// and its own column (in quotes where there is a blank). :"TEXT" after it takes the first number
// that follows TEXT in the cell. Of a Markdown file all tables that have these columns are
// searched. Throws std::runtime_error where a formula cannot be read, or a cell alone is none or
// several.
double value_of(const std::string& formula);

// Whether `value`, rounded to as many digits as the first number of `figure` is printed with, is
// that number. False where there is no number.
bool is_printed_as(double value, const std::string& figure);

}  // namespace viscera
