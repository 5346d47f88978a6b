// A lock on a file, held by a process and gone with it: a killed holder leaves nothing to clean up.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

namespace viscera::engine {

class FileLock {
 public:
  enum class Kind { exclusive, shared };  // shared: with others that share it

  // Makes the file when needed. Waits while another process holds it, and says once who that is and
  // what for: "waits for process 12 (run demo)". Throws Error(usage) when the file cannot be made,
  // Error(interrupted) on SIGINT or SIGTERM.
  FileLock(const std::filesystem::path& path, const std::string& purpose,
           Kind kind = Kind::exclusive);
  // Without waiting: null when another process holds it, which `held_by` then names.
  static std::unique_ptr<FileLock> attempt(const std::filesystem::path& path,
                                           const std::string& purpose, std::string& held_by);
  // Who holds it alone; "" when nobody does, or there is no such file. Writes nothing.
  static std::string holder_of(const std::filesystem::path& path);
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

 private:
  explicit FileLock(const std::filesystem::path& path);
  bool taken(const std::filesystem::path& path, const std::string& purpose, Kind kind);

  int file_ = -1;
};

}  // namespace viscera::engine
