// Collects what VTK would print to its output window, so that a reader's complaint becomes part of
// a viscera::Error instead of noise on the terminal. One at a time; restores the old window.
#pragma once

#include <vtkAlgorithm.h>
#include <vtkErrorCode.h>
#include <vtkLogger.h>
#include <vtkObjectFactory.h>
#include <vtkOutputWindow.h>
#include <vtkSmartPointer.h>

#include <cstring>
#include <string>

namespace viscera {

class VtkMessages {
 public:
  VtkMessages() : window_(vtkSmartPointer<Window>::New()), before_(vtkOutputWindow::GetInstance()) {
    vtkOutputWindow::SetInstance(window_);
    vtkLogger::SetStderrVerbosity(vtkLogger::VERBOSITY_OFF);
  }
  ~VtkMessages() { vtkOutputWindow::SetInstance(before_); }
  VtkMessages(const VtkMessages&) = delete;
  VtkMessages& operator=(const VtkMessages&) = delete;

  // The first error or warning, without VTK's file and line prefix; empty when there was none.
  std::string first() const {
    const auto end_of_prefix = window_->text.find("): ");
    std::string text =
        window_->text.substr(end_of_prefix == std::string::npos ? 0 : end_of_prefix + 3);
    return text.substr(0, text.find('\n'));
  }

 private:
  class Window : public vtkOutputWindow {
   public:
    static Window* New();
    vtkTypeMacro(Window, vtkOutputWindow);
    void DisplayText(const char* message) override { text += message; }
    std::string text;
  };

  vtkSmartPointer<Window> window_;
  vtkSmartPointer<vtkOutputWindow> before_;
};

inline VtkMessages::Window* VtkMessages::Window::New() {
  VTK_STANDARD_NEW_BODY(Window);
}

// Why a writer did not write: the system's error where VTK kept it, which its message leaves out.
inline std::string write_problem(vtkAlgorithm& writer, const VtkMessages& messages) {
  const auto code = writer.GetErrorCode();
  const bool of_system = code > 0 && code < vtkErrorCode::FirstVTKErrorCode;
  return of_system ? std::strerror(static_cast<int>(code)) : messages.first();
}

}  // namespace viscera
