// The record as a page of Markdown that a reviewer reads: everything in it is in record.json.
#pragma once

#include <string>
#include <vector>

#include "pipeline/base/param.hpp"

namespace viscera::engine {

// @param pictures names of files beside the page
std::string record_page(const Json& record, const std::vector<std::string>& pictures);

}  // namespace viscera::engine
