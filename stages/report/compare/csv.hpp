// Tables for spreadsheets and plots, from rows of JSON.
#pragma once

#include <string>

#include "pipeline/base/param.hpp"

namespace viscera {

// One line a row, the columns those of the first row in its order (RFC 4180, lines end with \n).
// Three numbers are quartiles and become NAME_q1, NAME and NAME_q3; null is empty; maps and other
// lists are their JSON. No rows: an empty text.
std::string csv_of(const Json& rows);

}  // namespace viscera
