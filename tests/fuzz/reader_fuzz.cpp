// One libFuzzer target per format: whatever the bytes, a reader returns or throws Error, within the
// fuzzer's bounds of memory and time. FUZZ_FILE names the file that the bytes are written to; its
// ending chooses the reader.
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "stages/image/image_io.hpp"
#include "stages/labels/dicom_stack.hpp"

namespace {

using namespace viscera;

// As labels.
void read_labels(const std::filesystem::path& path) {
  if (path.extension() != ".dcm") {
    read_volume(path);
    return;
  }
  DicomFile file = read_dicom(path);
  stack_planes(std::move(file.planes), !file.segments.empty());
}

// As a CT.
void read_values(const std::filesystem::path& path) {
  path.extension() == ".dcm" ? void(read_dicom_values(path)) : void(read_scalar_image(path));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  static const TemporaryFolder folder(std::filesystem::temp_directory_path());
  static const std::filesystem::path path = folder.path() / FUZZ_FILE;
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes), static_cast<std::streamsize>(size));
  for (const auto& read : {read_labels, read_values}) {
    try {
      read(path);
    } catch (const Error&) {  // refused, as it should be
    }
  }
  return 0;
}
