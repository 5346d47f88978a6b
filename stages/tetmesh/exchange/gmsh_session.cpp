#include "stages/tetmesh/exchange/gmsh_session.hpp"

#include <gmsh.h>

#include <mutex>
#include <stdexcept>

#include "pipeline/base/error.hpp"

namespace viscera {
namespace {

struct Session {
  Session() {
    gmsh::initialize(0, nullptr, false);
    gmsh::option::setNumber("General.Terminal", 0);
    gmsh::option::setNumber("General.NumThreads", 1);
    gmsh::model::add("viscera");
  }
  ~Session() { gmsh::finalize(); }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;
};

std::string last_error(const std::string& thrown) {
  std::string text;
  gmsh::logger::getLastError(text);
  return text.empty() ? thrown : text;
}

}  // namespace

void with_gmsh(const std::function<void()>& work) {
  static std::mutex one_at_a_time;
  const std::scoped_lock alone(one_at_a_time);
  const Session session;
  try {
    work();
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {
    throw std::runtime_error("gmsh: " + last_error(e.what()));
  } catch (const std::string& text) {
    throw std::runtime_error("gmsh: " + last_error(text));
  } catch (...) {
    throw std::runtime_error("gmsh: " + last_error("unknown error"));
  }
}

std::string gmsh_version() {
  return GMSH_API_VERSION;
}

}  // namespace viscera
