#include "stages/live/window/controls.hpp"

#include <fmt/format.h>
#include <vtkCommand.h>
#include <vtkProperty2D.h>
#include <vtkSliderRepresentation2D.h>
#include <vtkTextProperty.h>

#include <algorithm>

namespace viscera::live {
namespace {

constexpr double left = 0.79, right = 0.97, top = 0.93, between = 0.085;  // of the window

vtkSliderRepresentation2D& shape_of(vtkSliderWidget& widget) {
  return *vtkSliderRepresentation2D::SafeDownCast(widget.GetSliderRepresentation());
}

vtkSmartPointer<vtkSliderRepresentation2D> make_shape(const std::string& title, double lo,
                                                      double hi) {
  auto shape = vtkSmartPointer<vtkSliderRepresentation2D>::New();
  shape->SetMinimumValue(lo);
  shape->SetMaximumValue(hi);
  shape->SetTitleText(title.c_str());
  shape->SetLabelFormat("%.3g");
  shape->SetSliderLength(0.012);
  shape->SetSliderWidth(0.018);
  shape->SetTubeWidth(0.004);
  shape->SetEndCapLength(0.004);
  shape->SetEndCapWidth(0.012);
  shape->SetTitleHeight(0.017);
  shape->SetLabelHeight(0.017);
  shape->GetSliderProperty()->SetColor(0.85, 0.87, 0.9);
  shape->GetTubeProperty()->SetColor(0.4, 0.43, 0.48);
  for (auto* text : {shape->GetTitleProperty(), shape->GetLabelProperty()}) {
    text->SetColor(0.92, 0.93, 0.95);
    text->ShadowOff();
    text->BoldOff();
  }
  return shape;
}

}  // namespace

Controls::Controls(const Setting& setting, const std::vector<std::string>& materials,
                   vtkRenderWindowInteractor& interactor) {
  for (std::size_t i = 0; i < materials.size(); ++i) {
    const std::string name = "materials." + materials[i];
    const auto kpa = [i](const Setting& s) { return 1e-3 * s.materials[i].youngs_modulus; };
    const auto nu = [i](const Setting& s) { return s.materials[i].poisson_ratio; };
    add(name + ".E", materials[i] + " E, kPa", "kPa", 0.5, std::max(40.0, 2.0 * kpa(setting)), kpa,
        setting);
    add(name + ".nu", materials[i] + " nu", "", 0.0, 0.5, nu, setting);
  }
  sim::Effects::for_each([&]<class Effect, std::size_t k>() {
    if constexpr (requires(typename Effect::Params p) { p.friction; }) {
      const auto& named = std::get<k>(setting.scene.effects);
      if (named.size() != 1) return;  // of several the scene makes a list: no name for one
      const std::string effect = Effect::name;
      add(
          "effects." + effect + ".friction", effect + " friction", "", 0.0, 1.0,
          [](const Setting& s) { return std::get<k>(s.scene.effects).front().friction; }, setting);
    }
  });
  place(interactor);
}

void Controls::add(std::string name, std::string title, std::string unit, double lo, double hi,
                   std::function<double(const Setting&)> value, const Setting& now) {
  auto& slider = *sliders_.emplace_back(std::make_unique<Slider>());
  slider.name = std::move(name);
  slider.unit = std::move(unit);
  slider.value = std::move(value);
  slider.widget = vtkSmartPointer<vtkSliderWidget>::New();
  const auto shape = make_shape(title, lo, hi);
  shape->SetValue(slider.value(now));
  slider.widget->SetRepresentation(shape);
  slider.widget->SetAnimationModeToJump();
}

void Controls::place(vtkRenderWindowInteractor& interactor) {
  const double step =
      std::min(between, top / static_cast<double>(std::max<std::size_t>(1, sliders_.size())));
  double height = top;
  for (const auto& slider : sliders_) {
    auto& shape = shape_of(*slider->widget);
    for (auto* end : {shape.GetPoint1Coordinate(), shape.GetPoint2Coordinate()}) {
      end->SetCoordinateSystemToNormalizedDisplay();
      end->SetValue(end == shape.GetPoint1Coordinate() ? left : right, height);
    }
    height -= step;
    slider->widget->SetInteractor(&interactor);
    slider->widget->SetEnabled(1);
    Slider* const own = slider.get();
    slider->widget->AddObserver(vtkCommand::StartInteractionEvent, own, &Slider::hold);
    slider->widget->AddObserver(vtkCommand::InteractionEvent, own, &Slider::move);
    slider->widget->AddObserver(vtkCommand::EndInteractionEvent, own, &Slider::let_go);
  }
}

Json Controls::take_changes() {
  Json changes = Json::object();
  for (const auto& slider : sliders_) {
    if (!std::exchange(slider->is_moved, false)) continue;
    const double value = shape_of(*slider->widget).GetValue();
    changes[slider->name] =
        slider->unit.empty() ? Json(value) : Json(fmt::format("{} {}", value, slider->unit));
  }
  return changes;
}

void Controls::show(const Setting& setting) {
  for (const auto& slider : sliders_) {
    if (slider->is_held || slider->is_moved) continue;
    shape_of(*slider->widget).SetValue(slider->value(setting));
  }
}

}  // namespace viscera::live
