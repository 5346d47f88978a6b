// The window's own loop: at every tick it takes the newest snapshots, draws them, and sends what
// sliders ask for. It never waits for a session.
#include <X11/Xlib.h>
#include <fmt/format.h>
#include <vtkCallbackCommand.h>
#include <vtkCamera.h>
#include <vtkOutputWindow.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderWindow.h>
#include <vtkScalarBarActor.h>
#include <vtkSphereSource.h>
#include <vtkTextActor.h>
#include <vtkTextProperty.h>

#include <chrono>
#include <map>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "stages/live/readout.hpp"
#include "stages/live/window/controls.hpp"
#include "stages/live/window/hand_style.hpp"
#include "stages/live/window_library.hpp"
#include "stages/simulate/body.hpp"

namespace viscera::live {
namespace {

constexpr int width = 1280, height = 800;
constexpr int tick_ms = 16;
constexpr double readout_every_s = 0.5;

const char* const help =
    "left drag on the body   pull it\n"
    "left drag beside it     turn the view; right: zoom; middle: move\n"
    "t   tool, led by the mouse; wheel presses it in\n"
    "space   pause      n   next frame\n"
    "d   drop again     r   reset\n"
    "1 2 3 4   healthy, F2, F3-F4, cirrhosis\n"
    "c   colour by      g   ghost of the rest shape\n"
    "o   opaque         h   help      q   quit";

// E of the outermost material by stage of fibrosis: the middle of the ranges of transient
// elastography (normal about 6.6 kPa; F2 from 7, F3 from 10, F4 from 13 kPa), and 20 kPa for
// cirrhosis, as configs/paper.yaml has them.
const std::map<std::string, const char*> presets = {
    {"1", "6.6 kPa"}, {"2", "8.5 kPa"}, {"3", "11.5 kPa"}, {"4", "20 kPa"}};

// As the source paper's Figure 4 has them.
struct MethodColor {
  const char* name;
  Color color;
};
const std::map<std::string, MethodColor> method_colors = {{"pbd", {"yellow", {0.95, 0.85, 0.15}}},
                                                          {"xpbd", {"red", {0.90, 0.15, 0.15}}},
                                                          {"fem", {"blue", {0.15, 0.35, 0.95}}},
                                                          {"tled", {"green", {0.2, 0.75, 0.3}}}};

void require_display() {
  if (Display* display = XOpenDisplay(nullptr)) {
    XCloseDisplay(display);
    return;
  }
  const char* const name = std::getenv("DISPLAY");
  throw Error(
      ExitCode::device_unavailable,
      {.where = "display",
       .found = name ? fmt::format("DISPLAY={} cannot be opened", name) : "no DISPLAY is set",
       .allowed = "an X server with OpenGL",
       .remedy = "run without a window: --headless 600"});
}

vtkSmartPointer<vtkTextActor> make_text(double x, double y, bool from_top) {
  auto text = vtkSmartPointer<vtkTextActor>::New();
  text->GetPositionCoordinate()->SetCoordinateSystemToNormalizedViewport();
  text->SetPosition(x, y);
  auto* property = text->GetTextProperty();
  property->SetFontFamilyToCourier();
  property->SetFontSize(14);
  property->SetColor(0.92, 0.93, 0.95);
  if (from_top) property->SetVerticalJustificationToTop();
  return text;
}

class Window {
 public:
  explicit Window(const std::vector<Shown>& sessions);
  void run();

 private:
  void set_up_overlay(const std::vector<Shown>& sessions);
  void set_up_tool();
  void set_up_texts();
  void set_up_interaction();
  void post(const Command& command);
  void key(const std::string& name);
  void tick();
  void show(const Snapshot& snapshot);
  bool tell_due();

  std::vector<Session*> sessions_;
  vtkSmartPointer<vtkRenderer> renderer_ = vtkSmartPointer<vtkRenderer>::New();
  vtkSmartPointer<vtkRenderWindow> window_ = vtkSmartPointer<vtkRenderWindow>::New();
  vtkSmartPointer<vtkRenderWindowInteractor> interactor_ =
      vtkSmartPointer<vtkRenderWindowInteractor>::New();
  vtkSmartPointer<HandStyle> style_ = vtkSmartPointer<HandStyle>::New();
  BodyView body_;
  std::optional<BodyView> overlay_;
  Reader reader_;
  std::optional<Controls> controls_;
  vtkSmartPointer<vtkSphereSource> ball_ = vtkSmartPointer<vtkSphereSource>::New();
  vtkSmartPointer<vtkActor> ball_actor_ = vtkSmartPointer<vtkActor>::New();
  vtkSmartPointer<vtkScalarBarActor> bar_ = vtkSmartPointer<vtkScalarBarActor>::New();
  vtkSmartPointer<vtkTextActor> help_ = make_text(0.01, 0.985, true);
  vtkSmartPointer<vtkTextActor> readout_ = make_text(0.01, 0.01, false);
  std::string legend_;  // of the methods' colours, where there are two
  Measure measure_ = Measure::material;
  bool paused_ = false, translucent_ = true, ghost_ = true;
  std::chrono::steady_clock::time_point told_{};
};

Window::Window(const std::vector<Shown>& sessions)
    : body_(sessions.front().session, *renderer_), reader_(sessions.front().session) {
  for (const Shown& shown : sessions) sessions_.push_back(&shown.session);
  renderer_->SetBackground(0.10, 0.11, 0.13);
  window_->SetSize(width, height);
  window_->SetWindowName("viscera-live");
  window_->AddRenderer(renderer_);
  set_up_overlay(sessions);
  show_grounds(*sessions_[0], sessions_[0]->look().setting->scene, *renderer_);
  set_up_tool();
  set_up_texts();
  set_up_interaction();
}

void Window::set_up_overlay(const std::vector<Shown>& sessions) {
  if (sessions.size() < 2) return;
  const auto& [first, color] = method_colors.at(sessions[0].method);
  const auto& [second, over] = method_colors.at(sessions[1].method);
  body_.tint_outermost(color);
  overlay_.emplace(sessions[1].session, *renderer_, over);
  legend_ =
      fmt::format("{} {}, over it {} {}\n", sessions[0].method, first, sessions[1].method, second);
}

void Window::set_up_tool() {
  ball_->SetThetaResolution(32);
  ball_->SetPhiResolution(24);
  auto mapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  mapper->SetInputConnection(ball_->GetOutputPort());
  ball_actor_->SetMapper(mapper);
  ball_actor_->GetProperty()->SetColor(0.75, 0.78, 0.8);
  ball_actor_->GetProperty()->SetDiffuse(0.8);
  ball_actor_->PickableOff();
  ball_actor_->VisibilityOff();
  renderer_->AddActor(ball_actor_);
}

void Window::set_up_texts() {
  help_->SetInput(help);
  readout_->SetInput("");
  renderer_->AddActor2D(help_);
  renderer_->AddActor2D(readout_);
  bar_->SetLookupTable(&body_.colors());
  bar_->SetOrientationToHorizontal();
  bar_->SetNumberOfLabels(4);
  bar_->SetWidth(0.26);
  bar_->SetHeight(0.08);
  bar_->SetPosition(0.52, 0.02);
  bar_->VisibilityOff();
  renderer_->AddActor2D(bar_);
}

void Window::set_up_interaction() {
  style_->connect(
      body_, *renderer_, [this](const Command& command) { post(command); },
      [this](const std::string& name) { key(name); });
  interactor_->SetRenderWindow(window_);
  interactor_->SetInteractorStyle(style_);
  interactor_->Initialize();
  interactor_->AddObserver(vtkCommand::TimerEvent, this, &Window::tick);
  interactor_->CreateRepeatingTimer(tick_ms);
  controls_.emplace(*sessions_[0]->look().setting, sessions_[0]->body().label_names, *interactor_);
  // Anterior side on, feet down: the patient lies in LPS.
  auto* camera = renderer_->GetActiveCamera();
  camera->SetViewUp(0.0, 0.0, 1.0);
  camera->SetFocalPoint(0.0, 0.0, 0.0);
  camera->SetPosition(0.25, -1.0, 0.2);
  renderer_->ResetCamera(body_.actors().back()->GetBounds());
  camera->SetWindowCenter(0.18, 0.0);  // beside the sliders
}

void Window::run() {
  window_->Render();
  interactor_->Start();
}

void Window::post(const Command& command) {
  for (Session* session : sessions_) session->post(command);
}

void Window::key(const std::string& name) {
  const std::string outermost = "materials." + body_.outermost_name() + ".E";
  if (const auto preset = presets.find(name); preset != presets.end()) {
    return post(Change{{{outermost, preset->second}}});
  }
  if (name == "space") {
    paused_ = !paused_;
    for (Session* session : sessions_) session->pause(paused_);
  }
  if (name == "n") {
    for (Session* session : sessions_) session->step();
  }
  if (name == "d" || name == "r") {
    style_->forget_tool();
    post(name == "d" ? Command(Drop{}) : Command(Reset{}));
  }
  if (name == "t") style_->toggle_tool(m_to_mm * sessions_[0]->look().hand.tool_radius);
  if (name == "c") measure_ = next_of(measure_);
  if (name == "g") body_.show_ghost(ghost_ = !ghost_);
  if (name == "o") body_.set_translucent(translucent_ = !translucent_);
  if (name == "h") help_->SetVisibility(!help_->GetVisibility());
  if (name == "q" || name == "Escape") interactor_->TerminateApp();
}

void Window::tick() {
  if (log::interrupted()) return interactor_->TerminateApp();
  for (Session* session : sessions_) {
    if (session->ended()) return interactor_->TerminateApp();
  }
  if (Json changes = controls_->take_changes(); !changes.empty()) post(Change{std::move(changes)});
  show(sessions_[0]->look());
  if (overlay_) overlay_->show(sessions_[1]->look(), Measure::material);
  window_->Render();
}

void Window::show(const Snapshot& snapshot) {
  body_.show(snapshot, measure_);
  controls_->show(*snapshot.setting);
  paused_ = snapshot.paused;
  ball_actor_->SetVisibility(snapshot.hand.has_tool);
  const Point at = m_to_mm * snapshot.hand.tool;
  ball_->SetCenter(at.x, at.y, at.z);
  ball_->SetRadius(m_to_mm * snapshot.hand.tool_radius);
  bar_->SetVisibility(measure_ != Measure::material);
  const MeasureInfo info = info_of(measure_);
  bar_->SetTitle(fmt::format("{}, {}", info.title, info.unit).c_str());
  if (tell_due()) readout_->SetInput((legend_ + to_text(reader_.read(snapshot))).c_str());
}

bool Window::tell_due() {
  const auto now = std::chrono::steady_clock::now();
  if (now - told_ < std::chrono::duration<double>(readout_every_s)) return false;
  told_ = now;
  return true;
}

void show(const std::vector<Shown>& sessions) {
  Window(sessions).run();
}

}  // namespace
}  // namespace viscera::live

const viscera::live::WindowLibrary viscera_live_window = {viscera::live::require_display,
                                                          viscera::live::show};
