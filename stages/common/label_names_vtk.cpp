#include "stages/common/label_names_vtk.hpp"

#include <vtkFieldData.h>
#include <vtkIntArray.h>
#include <vtkNew.h>
#include <vtkStringArray.h>

namespace viscera {

void label_names_to(vtkFieldData& data, const std::map<int, std::string>& names) {
  vtkNew<vtkIntArray> ids;
  ids->SetName("label_ids");
  vtkNew<vtkStringArray> texts;
  texts->SetName("label_names");
  for (const auto& [id, name] : names) {
    ids->InsertNextValue(id);
    texts->InsertNextValue(name);
  }
  data.AddArray(ids);
  data.AddArray(texts);
}

std::map<int, std::string> label_names_from(vtkFieldData& data) {
  std::map<int, std::string> names;
  auto* ids = data.GetArray("label_ids");
  auto* texts = vtkStringArray::SafeDownCast(data.GetAbstractArray("label_names"));
  if (ids == nullptr || texts == nullptr ||
      ids->GetNumberOfTuples() != texts->GetNumberOfValues()) {
    return names;
  }
  for (vtkIdType i = 0; i < ids->GetNumberOfTuples(); ++i)
    names[static_cast<int>(ids->GetComponent(i, 0))] = texts->GetValue(i);
  return names;
}

}  // namespace viscera
