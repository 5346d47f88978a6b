// Sliders for the values that may change while a run goes on: E and nu of every material, friction
// of every obstacle that the scene names. What they ask for are changes of the scene by name; what
// is refused springs back.
#pragma once

#include <vtkRenderWindowInteractor.h>
#include <vtkSliderWidget.h>
#include <vtkSmartPointer.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "stages/live/session.hpp"

namespace viscera::live {

class Controls {
 public:
  Controls(const Setting& setting, const std::vector<std::string>& materials,
           vtkRenderWindowInteractor& interactor);

  // What the sliders have been moved to since the last call; empty: nothing.
  Json take_changes();
  // Sliders that nobody drags show what holds.
  void show(const Setting& setting);

 private:
  struct Slider {
    std::string name;  // in the scene, "materials.liver.E"
    std::string unit;  // that its value is written in
    std::function<double(const Setting&)> value;
    vtkSmartPointer<vtkSliderWidget> widget;
    bool is_moved = false, is_held = false;

    void hold() { is_held = true; }
    void move() { is_moved = true; }
    void let_go() { is_held = false, is_moved = true; }
  };
  void add(std::string name, std::string title, std::string unit, double lo, double hi,
           std::function<double(const Setting&)> value, const Setting& now);
  void place(vtkRenderWindowInteractor& interactor);

  std::vector<std::unique_ptr<Slider>> sliders_;
};

}  // namespace viscera::live
