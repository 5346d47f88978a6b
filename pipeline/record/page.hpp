// Records and differences as pages of Markdown that people read: all of it is in record.json and
// diff.json.
#pragma once

#include <string>
#include <vector>

#include "pipeline/base/param.hpp"

namespace viscera::engine {

// @param pictures names of files beside the page
std::string record_page(const Json& record, const std::vector<std::string>& pictures);
// @param diff as diff_of gives it
// @param why_not why there are no pictures; empty: there are
std::string diff_page(const Json& diff, const std::vector<std::string>& pictures,
                      const std::string& why_not);

}  // namespace viscera::engine
