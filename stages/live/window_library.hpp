// The window, in a library of its own that is loaded when one is wanted: a headless run needs
// neither a display nor OpenGL.
#pragma once

#include <vector>

#include "stages/live/session.hpp"

namespace viscera::live {

// A session and how it is solved ("xpbd"), which decides the colour that it is drawn in when there
// are two.
struct Shown {
  Session& session;
  std::string method;
};

struct WindowLibrary {
  // Throws Error(device_unavailable) where there is no display.
  void (*require_display)();
  // Draws the sessions, the second over the first, and leads all of them by one hand, until the
  // window is closed or a signal comes.
  void (*show)(const std::vector<Shown>& sessions);
};

}  // namespace viscera::live

extern "C" const viscera::live::WindowLibrary viscera_live_window;
