// One libFuzzer target for each format of meshes: .vtu, .msh and .vtp. Their libraries crash on
// some inputs, and run in a process of their own (trial_read.hpp). So the fuzzer asks what a user
// may: that the reader returns or throws Error. It is slow, for it starts up to three processes an
// input. FUZZ_FILE names the file; its ending chooses the reader.
#include "pipeline/base/log.hpp"
#include "stages/mesh/surface_io.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/tetmesh/exchange/import.hpp"
#include "tests/fuzz/fuzz_file.hpp"

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  viscera::log::set_level(viscera::log::Level::error);  // of tets that are turned, mostly
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace viscera;
  const auto path = fuzz::as_file(FUZZ_FILE, bytes, size);
  if (path.extension() == ".vtp") {
    fuzz::may_refuse([&path] { read_vtp(path); });
    return 0;
  }
  fuzz::may_refuse([&path] { import_mesh(path); });
  if (path.extension() == ".vtu") fuzz::may_refuse([&path] { read_vtu(path); });
  return 0;
}
