// The corpus of malformed images: what each file or folder gets wrong, and what must be said of it.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace viscera::testing {

struct Malformed {
  std::string name;  // of the file or folder in the corpus; what it gets wrong
  std::string says;  // the field that the message must name
};

// Writes all of them into `folder`, which must exist.
std::vector<Malformed> write_malformed(const std::filesystem::path& folder);

}  // namespace viscera::testing
