// Label names as VTK field data: `label_ids` (int) and `label_names` (text), of equal length.
#pragma once

#include <map>
#include <string>

class vtkFieldData;

namespace viscera {

void label_names_to(vtkFieldData& data, const std::map<int, std::string>& names);

// Empty when the two arrays are absent or do not match.
std::map<int, std::string> label_names_from(vtkFieldData& data);

}  // namespace viscera
