// SHA-256 digests, and the transcript from which a cache key is made.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace viscera {

std::string sha256(std::string_view bytes);  // 64 hex digits

// Throws Error(bad_input) for what cannot be read or is no regular file (a device would never end),
// Error(interrupted) on SIGINT or SIGTERM.
std::string sha256_file(const std::filesystem::path& path);

// Every component of a key, one "type name = value" line each, in the order given. The readable
// transcript is kept beside the key so that a change can be explained.
class KeyTranscript {
 public:
  void add(std::string_view type, std::string_view name, std::string_view value);
  const std::string& text() const { return text_; }
  std::string key() const { return sha256(text_); }

 private:
  std::string text_;
};

}  // namespace viscera
