// One cell of a table for spreadsheets (RFC 4180).
#pragma once

#include <string>

namespace viscera {

// The text in quotes where it needs them. A spreadsheet takes what begins with = + - @, a tab or a
// carriage return for a formula and computes it: such a text gets an apostrophe in front, which
// spreadsheets read as the mark of a text (OWASP, "CSV Injection").
std::string csv_cell(const std::string& text);

}  // namespace viscera
