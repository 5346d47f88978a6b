// SHA-256 of files, remembered by path, size, inode, and the times (ns) of the last change of its
// content (mtime) and of its inode (ctime), so that a file that nobody touched is not read again.
// Whoever changes a file can put its mtime back, but not its ctime. A ctime also changes when a
// link to the file is made or removed: such a file is read once more. A file changed in the two
// seconds before it was hashed is not remembered: it could change again within the clock's grain.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>

namespace viscera::engine {

class DigestCache {
 public:
  // Reads `file` when it exists; a damaged one is ignored, which costs time and nothing else.
  explicit DigestCache(std::filesystem::path file);

  // Throws Error(bad_input) when the file cannot be read.
  std::string digest(const std::filesystem::path& path);

  // For a file that we have just made and hashed ourselves.
  void remember(const std::filesystem::path& path, const std::string& sha256);

  // Makes a change of our own that leaves the file's content as it is, a link to it for example:
  // what is remembered of the file stays.
  void keep_over(const std::filesystem::path& path, const std::function<void()>& change);

  // As input_digest.hpp defines it, of remembered files.
  std::string input_digest(const std::filesystem::path& path);

  // Writes what was learnt, if anything was; forgets files that are gone.
  void save();

  // The same, at most every two seconds: it looks at every file, of which a cohort has thousands. A
  // run that is killed in between has to read some of them again.
  void save_now_and_then();

 private:
  struct Known {
    std::uintmax_t size = 0, inode = 0;
    std::int64_t mtime_ns = 0, ctime_ns = 0;
    std::string sha256;
    bool same_content(const Known& other) const {
      return size == other.size && inode == other.inode && mtime_ns == other.mtime_ns;
    }
    bool same_file(const Known& other) const {
      return same_content(other) && ctime_ns == other.ctime_ns;
    }
  };
  static std::optional<Known> look_at(const std::filesystem::path& path);

  std::filesystem::path file_;
  std::map<std::string, Known> known_;  // by absolute path
  bool changed_ = false;
  std::chrono::steady_clock::time_point saved_{};
};

}  // namespace viscera::engine
