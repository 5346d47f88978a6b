#include "tests/live/screen.hpp"

#include <X11/Xlib.h>
#include <X11/Xutil.h>

#include <stdexcept>

namespace viscera::live {

Screen::Screen(const std::string& display) : display_(XOpenDisplay(display.c_str())) {
  if (!display_) throw std::runtime_error("no display " + display);
}

Screen::~Screen() {
  XCloseDisplay(display_);
}

Picture Screen::look(int width, int height) const {
  Picture picture{width, height, {}};
  XImage* const image =
      XGetImage(display_, DefaultRootWindow(display_), 0, 0, width, height, AllPlanes, ZPixmap);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto p = static_cast<int>(XGetPixel(image, x, y));
      picture.pixels.push_back({p >> 16 & 255, p >> 8 & 255, p & 255});
    }
  }
  XDestroyImage(image);
  return picture;
}

void Screen::close_window(const std::string& name) const {
  XEvent event{};
  event.xclient.type = ClientMessage;
  event.xclient.window = window(name);
  event.xclient.message_type = XInternAtom(display_, "WM_PROTOCOLS", False);
  event.xclient.format = 32;
  event.xclient.data.l[0] = static_cast<long>(XInternAtom(display_, "WM_DELETE_WINDOW", False));
  XSendEvent(display_, event.xclient.window, False, NoEventMask, &event);
  XFlush(display_);
}

unsigned long Screen::window(const std::string& name) const {
  ::Window root = 0, parent = 0, *children = nullptr, found = 0;
  unsigned count = 0;
  XQueryTree(display_, DefaultRootWindow(display_), &root, &parent, &children, &count);
  for (unsigned i = 0; i < count; ++i) {
    char* title = nullptr;
    if (XFetchName(display_, children[i], &title) && title == name) found = children[i];
    if (title) XFree(title);
  }
  if (children) XFree(children);
  return found;
}

}  // namespace viscera::live
