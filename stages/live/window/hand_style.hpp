// What mouse and keys do: the left button takes hold of the body where it meets it and turns the
// view elsewhere, the others move and zoom the view; while the tool is out it follows the mouse,
// and the wheel presses it in.
#pragma once

#include <vtkCellPicker.h>
#include <vtkInteractorStyleTrackballCamera.h>
#include <vtkSmartPointer.h>

#include <functional>
#include <optional>

#include "stages/live/command.hpp"
#include "stages/live/window/body_view.hpp"

namespace viscera::live {

class HandStyle : public vtkInteractorStyleTrackballCamera {
 public:
  static HandStyle* New();
  vtkTypeMacro(HandStyle, vtkInteractorStyleTrackballCamera);

  // `post` takes commands, `key` the names of keys.
  void connect(const BodyView& body, vtkRenderer& renderer, std::function<void(Command)> post,
               std::function<void(const std::string&)> key);
  // The tool appears beside the body, where the mouse is; or goes.
  void toggle_tool(double radius_mm);
  void forget_tool() { tool_.reset(); }  // the session has put it away

  void OnLeftButtonDown() override;
  void OnLeftButtonUp() override;
  void OnMouseMove() override;
  void OnMouseWheelForward() override { wheel(1.0); }
  void OnMouseWheelBackward() override { wheel(-1.0); }
  void OnKeyPress() override;
  void OnChar() override {}  // VTK's own keys

 private:
  void wheel(double turns);
  Point under_mouse(const Point& at_depth_of) const;

  const BodyView* body_ = nullptr;
  vtkRenderer* renderer_ = nullptr;
  std::function<void(Command)> post_;
  std::function<void(const std::string&)> key_;
  vtkSmartPointer<vtkCellPicker> picker_ = vtkSmartPointer<vtkCellPicker>::New();
  std::optional<Point> grabbed_;  // where the mouse took hold, mm
  std::optional<Point> tool_;     // mm
  double radius_mm_ = 0.0;
};

}  // namespace viscera::live
