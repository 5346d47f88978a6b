// Files appear whole or not at all: written beside their place, then renamed. Nothing is committed
// in a destructor, so an exception leaves the old file as it was.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace viscera {

// Throws Error(usage) naming the path when the folder cannot be written.
void write_atomically(const std::filesystem::path& path, std::string_view bytes);

std::string read_file(const std::filesystem::path& path);  // throws Error(bad_input)

// A folder that is removed with its contents when this object goes, whatever happens; parents that
// it had to make go too when nothing else was put there.
class TemporaryFolder {
 public:
  // Makes `parent` when needed, and `parent/.partial-<pid>-<n>` in it; Error(usage) when it cannot.
  explicit TemporaryFolder(const std::filesystem::path& parent);
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  [[noreturn]] void refuse(const std::filesystem::path& parent, const std::string& why) const;
  void remove() const;

  std::filesystem::path path_;
  std::vector<std::filesystem::path> made_;  // innermost first
};

}  // namespace viscera
