// One input of a fuzzer as the file that a reader opens, in a folder of this process.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"

namespace viscera::fuzz {

// The folder of this process; it goes when the process ends.
inline const std::filesystem::path& folder() {
  static const TemporaryFolder folder(std::filesystem::temp_directory_path());
  return folder.path();
}

// Writes the bytes to `folder()/name`, and returns that path.
inline std::filesystem::path as_file(const std::string& name, const std::uint8_t* bytes,
                                     std::size_t size) {
  const std::filesystem::path path = folder() / name;
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes), static_cast<std::streamsize>(size));
  return path;
}

// Runs `read`; Error is what a reader may throw, and anything else ends the fuzzer.
template <class Read>
void may_refuse(const Read& read) {
  try {
    read();
  } catch (const Error&) {  // refused, as it should be
  }
}

}  // namespace viscera::fuzz
