// How a stage or the engine ends. The numbers are public: scripts and the cache rely on them.
#pragma once

namespace viscera {

enum class ExitCode : int {
  ok = 0,
  internal = 1,            // a defect of ours; never cached
  usage = 2,               // command line
  bad_config = 3,          // spec, scene or parameter
  bad_input = 4,           // image, surface or mesh
  gate_failed = 5,         // finished, metrics written, a quality gate failed; cached
  device_unavailable = 6,  // asked-for device absent or lost; never cached
  diverged = 7,            // simulation stopped at the last good frame; outputs kept
  try_again = 75,          // busy or out of a passing resource; never cached
  interrupted = 130,       // SIGINT or SIGTERM; never cached
};

}  // namespace viscera
