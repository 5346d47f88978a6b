// Specs under libFuzzer: whatever the file says, the engine reads it or throws Error.
#include <cstdint>
#include <filesystem>
#include <fstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/engine/spec/spec.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace viscera;
  static const TemporaryFolder folder(std::filesystem::temp_directory_path());
  static const std::filesystem::path path = folder.path() / "spec.yaml";
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes), static_cast<std::streamsize>(size));
  try {
    engine::load_spec({.path = path});
  } catch (const Error&) {  // refused, as it should be
  }
  return 0;
}
