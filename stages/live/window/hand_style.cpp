#include "stages/live/window/hand_style.hpp"

#include <vtkCamera.h>
#include <vtkObjectFactory.h>
#include <vtkRenderWindowInteractor.h>

#include <algorithm>

namespace viscera::live {
namespace {

constexpr double wheel_step = 0.1;  // of the tool's radius

Point to_point(const double* p) {
  return {p[0], p[1], p[2]};
}

// The view's direction, away from who looks.
Point direction_of(vtkCamera& camera) {
  return to_point(camera.GetDirectionOfProjection());
}

}  // namespace

vtkStandardNewMacro(HandStyle);

void HandStyle::connect(const BodyView& body, vtkRenderer& renderer,
                        std::function<void(Command)> post,
                        std::function<void(const std::string&)> key) {
  body_ = &body;
  renderer_ = &renderer;
  post_ = std::move(post);
  key_ = std::move(key);
  picker_->SetTolerance(1e-4);
  picker_->PickFromListOn();
  for (const auto& actor : body.actors()) picker_->AddPickList(actor);
}

void HandStyle::OnLeftButtonDown() {
  const int* at = GetInteractor()->GetEventPosition();
  if (!picker_->Pick(at[0], at[1], 0.0, renderer_) || picker_->GetCellId() < 0) {
    return vtkInteractorStyleTrackballCamera::OnLeftButtonDown();
  }
  grabbed_ = to_point(picker_->GetPickPosition());
  const sim::Triangle& face = body_->face(picker_->GetActor(), picker_->GetCellId());
  const auto& x = body_->positions();
  const auto away = [&](int v) {
    return norm(Point{x[3 * v], x[3 * v + 1], x[3 * v + 2]} - *grabbed_);
  };
  post_(Grab{*std::ranges::min_element(face, {}, away)});
}

void HandStyle::OnLeftButtonUp() {
  if (!grabbed_) return vtkInteractorStyleTrackballCamera::OnLeftButtonUp();
  grabbed_.reset();
  post_(Release{});
}

void HandStyle::OnMouseMove() {
  if (grabbed_) return post_(Drag{under_mouse(*grabbed_) - *grabbed_});
  if (tool_ && GetState() == VTKIS_NONE) {
    tool_ = under_mouse(*tool_);
    return post_(MoveTool{*tool_});
  }
  vtkInteractorStyleTrackballCamera::OnMouseMove();
}

void HandStyle::OnKeyPress() {
  key_(GetInteractor()->GetKeySym());
}

void HandStyle::toggle_tool(double radius_mm) {
  if (tool_) {
    tool_.reset();
    return post_(LiftTool{});
  }
  radius_mm_ = radius_mm;
  const Point towards = direction_of(*renderer_->GetActiveCamera());
  const auto& x = body_->positions();
  double nearest = 1e30;
  for (std::size_t i = 0; i < x.size(); i += 3) {
    nearest = std::min(nearest, dot(towards, Point{x[i], x[i + 1], x[i + 2]}));
  }
  const Point focus = to_point(renderer_->GetActiveCamera()->GetFocalPoint());
  const double depth = nearest - 1.2 * radius_mm - dot(towards, focus);
  tool_ = under_mouse(focus + depth * towards);
  post_(MoveTool{*tool_});
}

void HandStyle::wheel(double turns) {
  if (!tool_) {
    return turns > 0.0 ? vtkInteractorStyleTrackballCamera::OnMouseWheelForward()
                       : vtkInteractorStyleTrackballCamera::OnMouseWheelBackward();
  }
  *tool_ += (turns * wheel_step * radius_mm_) * direction_of(*renderer_->GetActiveCamera());
  post_(MoveTool{*tool_});
}

// The point under the mouse that is as far away as another.
Point HandStyle::under_mouse(const Point& at_depth_of) const {
  renderer_->SetWorldPoint(at_depth_of.x, at_depth_of.y, at_depth_of.z, 1.0);
  renderer_->WorldToDisplay();
  const double depth = renderer_->GetDisplayPoint()[2];
  const int* at = Interactor->GetEventPosition();
  renderer_->SetDisplayPoint(at[0], at[1], depth);
  renderer_->DisplayToWorld();
  const double* world = renderer_->GetWorldPoint();
  return (1.0 / world[3]) * to_point(world);
}

}  // namespace viscera::live
