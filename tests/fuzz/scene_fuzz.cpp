// Scenes under libFuzzer: whatever the file says, the simulation reads it or throws Error, and what
// was read can be written down for the report.
#include "stages/simulate/scene/scene_file.hpp"
#include "tests/fuzz/fuzz_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace viscera;
  const auto path = fuzz::as_file("scene.yaml", bytes, size);
  fuzz::may_refuse([&path] { (void)to_json(read_scene(path)).dump(); });
  return 0;
}
