// The one self-contained page: its skeleton, style and scripts are files in web/, embedded into the
// executable with three.js and Chart.js; what a report says comes in as JSON, which the scripts
// only ever show as text.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "pipeline/contract/param.hpp"

namespace viscera {

// A page of one's own: every {{title}}, {{style}}, {{scripts}} and {{report}} of the skeleton
// filled.
std::string filled_page(std::string_view skeleton, const std::vector<std::string_view>& scripts,
                        const std::string& title, const Json& report,
                        const std::string& packed_geometry = {},
                        const std::string& packed_slices = {});

std::string base64(std::string_view bytes);

// `packed_geometry` (ViewerData::packed) and `packed_slices` (Slices::packed) may be empty: the
// page then has no 3D view, or no slices.
std::string report_page(const std::string& title, const Json& report,
                        const std::string& packed_geometry, const std::string& packed_slices);

}  // namespace viscera
