#include "pipeline/engine/store/digest_cache.hpp"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <charconv>
#include <chrono>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "pipeline/contract/input_digest.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

constexpr std::int64_t second_ns = 1'000'000'000;
constexpr std::ptrdiff_t digest_digits = 64;

std::int64_t nanoseconds(const timespec& time) {
  return time.tv_sec * second_ns + time.tv_nsec;
}

}  // namespace

// "SHA256 SIZE INODE MTIME CTIME PATH" lines; what is no such line is ignored.
DigestCache::DigestCache(fs::path file) : file_(std::move(file)) {
  if (!fs::exists(file_)) return;
  const std::string text = read_file(file_);
  const char *at = text.data(), *const end = at + text.size();
  for (const char* next = at; at < end; at = next + 1) {
    next = std::find(at, end, '\n');
    if (next - at <= digest_digits) continue;
    Known known{.sha256 = std::string(at, digest_digits)};
    const char* rest = at + digest_digits;
    const auto read = [&rest, next](auto& number) {
      const auto [after, failure] = std::from_chars(std::min(rest + 1, next), next, number);
      rest = after;
      return failure == std::errc{} && after < next && *after == ' ';
    };
    if (read(known.size) && read(known.inode) && read(known.mtime_ns) && read(known.ctime_ns)) {
      known_.insert_or_assign(known_.end(), std::string(rest + 1, next), std::move(known));
    }
  }
}

std::optional<DigestCache::Known> DigestCache::look_at(const fs::path& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return std::nullopt;
  return Known{.size = static_cast<std::uintmax_t>(info.st_size),
               .inode = info.st_ino,
               .mtime_ns = nanoseconds(info.st_mtim),
               .ctime_ns = nanoseconds(info.st_ctim),
               .sha256 = ""};
}

std::string DigestCache::digest(const fs::path& path) {
  const std::string name = fs::absolute(path).lexically_normal().string();
  auto now = look_at(path);
  const auto known = known_.find(name);
  if (now && known != known_.end() && known->second.same_file(*now)) return known->second.sha256;
  const std::string sha256 = sha256_file(path);
  const auto clock = std::chrono::system_clock::now().time_since_epoch();
  const bool settled =
      now && now->ctime_ns < std::chrono::duration_cast<std::chrono::nanoseconds>(clock).count() -
                                 2 * second_ns;
  if (settled) {
    now->sha256 = sha256;
    known_[name] = *now;
    changed_ = true;
  } else {
    changed_ = known_.erase(name) > 0 || changed_;
  }
  return sha256;
}

void DigestCache::remember(const fs::path& path, const std::string& sha256) {
  auto now = look_at(path);
  if (!now) return;
  now->sha256 = sha256;
  known_[fs::absolute(path).lexically_normal().string()] = *now;
  changed_ = true;
}

void DigestCache::keep_over(const fs::path& path, const std::function<void()>& change) {
  const auto known = known_.find(fs::absolute(path).lexically_normal().string());
  const auto before = look_at(path);
  const bool trusted = known != known_.end() && before && known->second.same_file(*before);
  change();
  const auto after = look_at(path);
  if (!trusted || !after || !after->same_content(*before)) return;
  known->second.ctime_ns = after->ctime_ns;
  changed_ = true;
}

std::string DigestCache::input_digest(const fs::path& path) {
  return viscera::input_digest(path, [this](const fs::path& file) { return digest(file); }).sha256;
}

void DigestCache::save_now_and_then() {
  if (std::chrono::steady_clock::now() - saved_ > std::chrono::seconds(2)) save();
}

void DigestCache::save() {
  if (!changed_) return;
  saved_ = std::chrono::steady_clock::now();
  std::string text;
  for (const auto& [path, known] : known_) {
    const auto now = look_at(path);
    if (!now || !known.same_file(*now) || path.find('\n') != std::string::npos) continue;
    text += fmt::format("{} {} {} {} {} {}\n", known.sha256, known.size, known.inode,
                        known.mtime_ns, known.ctime_ns, path);
  }
  write_atomically(file_, text);
  changed_ = false;
}

}  // namespace viscera::engine
