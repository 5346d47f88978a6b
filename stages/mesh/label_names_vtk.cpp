#include "stages/mesh/label_names_vtk.hpp"

#include <fmt/format.h>
#include <vtkFieldData.h>
#include <vtkIntArray.h>
#include <vtkNew.h>
#include <vtkStringArray.h>

#include <cmath>

#include "pipeline/base/error.hpp"
#include "pipeline/contract/label_name.hpp"

namespace viscera {

void label_names_to(vtkFieldData& data, const std::map<int, std::string>& names) {
  vtkNew<vtkIntArray> ids;
  ids->SetName(label_ids);
  vtkNew<vtkStringArray> texts;
  texts->SetName("label_names");
  for (const auto& [id, name] : names) {
    ids->InsertNextValue(id);
    texts->InsertNextValue(name);
  }
  data.AddArray(ids);
  data.AddArray(texts);
}

std::map<int, std::string> label_names_from(const std::filesystem::path& path, vtkFieldData& data) {
  std::map<int, std::string> names;
  auto* ids = data.GetArray(label_ids);
  auto* texts = vtkStringArray::SafeDownCast(data.GetAbstractArray("label_names"));
  if (ids == nullptr || texts == nullptr ||
      ids->GetNumberOfTuples() != texts->GetNumberOfValues()) {
    return names;
  }
  for (vtkIdType i = 0; i < ids->GetNumberOfTuples(); ++i) {
    const std::string& name = texts->GetValue(i);
    check_label_name(name, ExitCode::bad_input, path.string(), "FieldData/label_names");
    const double id = ids->GetComponent(i, 0);
    if (!(id >= 0.0 && id <= 65535.0) || id != std::floor(id)) {
      throw Error(ExitCode::bad_input, {.where = path.string(),
                                        .field = "FieldData/label_ids",
                                        .found = fmt::format("{}", id),
                                        .allowed = "whole numbers, 0 to 65535",
                                        .remedy = "write the file again"});
    }
    names[static_cast<int>(id)] = name;
  }
  return names;
}

}  // namespace viscera
