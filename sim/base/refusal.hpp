// Why the simulation refuses a model or scene before the first step. The stage turns it into a
// message with the file's name and an exit code.
#pragma once

#include <stdexcept>
#include <string>

namespace viscera::sim {

struct Refusal : std::runtime_error {
  enum class Cause { scene, mesh, device };
  Refusal(Cause why, std::string field_name, std::string what_was_found,
          std::string what_is_allowed, std::string what_to_do = "")
      : std::runtime_error(field_name + ": " + what_was_found),
        cause(why),
        field(std::move(field_name)),
        found(std::move(what_was_found)),
        allowed(std::move(what_is_allowed)),
        remedy(std::move(what_to_do)) {}
  Cause cause;
  std::string field, found, allowed, remedy;
};

}  // namespace viscera::sim
