// Reading VTK's XML files. VTK 9.1 writes outside its arrays on some damaged ones (a text array
// that lies about its count), so that a process of its own reads the file. What this one reads is
// what VTK then wrote of it: whole by its making.
#pragma once

#include <vtkNew.h>
#include <vtkSmartPointer.h>

#include <exception>
#include <filesystem>
#include <string>
#include <utility>

#include "pipeline/base/trial_read.hpp"
#include "stages/mesh/vtk_messages.hpp"
#include "stages/mesh/vtk_threads.hpp"

namespace viscera {

template <class Data>
struct VtkReading {
  vtkSmartPointer<Data> data;  // null where the file cannot be read
  std::string field, found;    // why: for a viscera::Error
};

// `kind` ends the sentence "not readable as ...".
template <class Data, class Reader, class Writer>
VtkReading<Data> read_vtk_xml(const std::filesystem::path& path, const std::string& kind) {
  constexpr char whole = 'w';
  const std::string unreadable = "not readable as " + kind;
  const auto read = [&path, &unreadable] {
    compute_vtk_in_one_thread();
    const VtkMessages messages;
    vtkNew<Reader> reader;
    reader->SetFileName(path.c_str());
    if (reader->CanReadFile(path.c_str()) == 0) {
      return ' ' + (messages.first().empty() ? unreadable : messages.first());
    }
    reader->Update();
    vtkNew<Writer> writer;
    if (reader->GetErrorCode() == 0 && messages.first().empty()) {
      writer->SetInputData(reader->GetOutput());
      writer->SetCompressorTypeToNone();
      writer->SetHeaderTypeToUInt64();
      writer->EncodeAppendedDataOff();
      writer->WriteToOutputStringOn();
      if (writer->Write() != 0) return whole + writer->GetOutputString();
    }
    return ' ' + (messages.first().empty() ? unreadable : messages.first());
  };
  ChildReading handed;
  try {
    handed = read_in_child(path, read);
  } catch (const std::exception& e) {
    return {nullptr, "", e.what()};
  }
  if (!handed.broken.empty()) return {nullptr, "Piece", handed.broken};
  if (handed.result[0] != whole) return {nullptr, "", handed.result.substr(1)};
  const VtkMessages messages;
  vtkNew<Reader> reader;
  reader->ReadFromInputStringOn();
  reader->SetInputString(handed.result.substr(1));
  reader->Update();
  if (reader->GetErrorCode() != 0 || !messages.first().empty()) {
    return {nullptr, "", messages.first()};
  }
  return {reader->GetOutput(), "", ""};
}

}  // namespace viscera
