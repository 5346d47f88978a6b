// A self-contained page: its shell, style and scripts are files in web/, embedded into the
// executable with three.js and Chart.js; what a report says comes in as JSON, which the scripts
// only ever show as text.
#pragma once

#include <string>
#include <string_view>

#include "pipeline/base/param.hpp"
#include "stages/report/web_files.hpp"

namespace viscera {

// `packed_geometry` (ViewerData::packed) and `packed_slices` (Slices::packed) may be empty: the
// page then has no 3D view, or no slices.
std::string filled_page(const web::Page& page, const std::string& title, const Json& report,
                        const std::string& packed_geometry = {},
                        const std::string& packed_slices = {});

std::string base64(std::string_view bytes);

}  // namespace viscera
