// Label names as VTK field data: `label_ids` (int) and `label_names` (text), of equal length.
#pragma once

#include <filesystem>
#include <map>
#include <string>

class vtkFieldData;

namespace viscera {

inline constexpr const char* label_ids = "label_ids";

void label_names_to(vtkFieldData& data, const std::map<int, std::string>& names);

// Empty when the two arrays are absent or do not match. Throws Error(bad_input) naming `path` for a
// text that is no name (label_name.hpp).
std::map<int, std::string> label_names_from(const std::filesystem::path& path, vtkFieldData& data);

}  // namespace viscera
