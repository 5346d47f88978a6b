#include "pipeline/engine/digest_cache.hpp"

#include <sys/stat.h>

#include <chrono>

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/digest.hpp"
#include "pipeline/contract/input_digest.hpp"
#include "pipeline/contract/param.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

constexpr std::int64_t second_ns = 1'000'000'000;

}  // namespace

DigestCache::DigestCache(fs::path file) : file_(std::move(file)) {
  if (!fs::exists(file_)) return;
  const Json json = Json::parse(read_file(file_), nullptr, false);
  if (!json.is_object()) return;
  try {
    for (const auto& [path, entry] : json.items()) {
      known_[path] = {.size = entry.at(0),
                      .inode = entry.at(1),
                      .mtime_ns = entry.at(2),
                      .sha256 = entry.at(3)};
    }
  } catch (const Json::exception&) {
    known_.clear();
  }
}

std::optional<DigestCache::Known> DigestCache::look_at(const fs::path& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return std::nullopt;
  return Known{.size = static_cast<std::uintmax_t>(info.st_size),
               .inode = info.st_ino,
               .mtime_ns = info.st_mtim.tv_sec * second_ns + info.st_mtim.tv_nsec,
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
      now && now->mtime_ns < std::chrono::duration_cast<std::chrono::nanoseconds>(clock).count() -
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

std::string DigestCache::input_digest(const fs::path& path) {
  return viscera::input_digest(path, [this](const fs::path& file) { return digest(file); }).sha256;
}

void DigestCache::save_now_and_then() {
  if (std::chrono::steady_clock::now() - saved_ > std::chrono::seconds(2)) save();
}

void DigestCache::save() {
  if (!changed_) return;
  saved_ = std::chrono::steady_clock::now();
  Json json = Json::object();
  for (const auto& [path, known] : known_) {
    const auto now = look_at(path);
    if (now && known.same_file(*now)) {
      json[path] = {known.size, known.inode, known.mtime_ns, known.sha256};
    }
  }
  write_atomically(file_, json.dump(0) + "\n");
  changed_ = false;
}

}  // namespace viscera
