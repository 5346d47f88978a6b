#include "pipeline/engine/store/store.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

constexpr int entry_schema = 1;
constexpr std::size_t sha256_digits = 64;

void make_folder(const fs::path& folder) {
  std::error_code failure;
  fs::create_directories(folder, failure);
  if (!failure) return;
  throw Error(ExitCode::usage, {.where = folder.string(),
                                .found = "cannot be made: " + failure.message(),
                                .allowed = "a folder you may write to",
                                .remedy = "choose another --out or --cache"});
}

// Whether an entry names files of the store and of one folder only: a stranger's may name others.
bool is_within_folders(const Manifest& manifest) {
  return std::all_of(manifest.outputs.begin(), manifest.outputs.end(), [](const auto& output) {
    return is_file_name(output.path) && output.sha256.size() == sha256_digits &&
           output.sha256.find_first_not_of("0123456789abcdef") == std::string::npos;
  });
}

// An entry's own checksum: what it says cannot change unnoticed.
std::string seal(const std::string& transcript, const Json& manifest) {
  return sha256(transcript + manifest.dump());
}

Error unsound(const std::string& stage, const std::string& found) {
  return Error(ExitCode::internal,
               {.where = stage, .found = found, .remedy = "this is a defect of the stage"});
}

void check_inputs(const Manifest& manifest, const std::multimap<std::string, std::string>& keyed) {
  std::multimap<std::string, std::string> read;
  for (const auto& [role, file] : manifest.inputs) read.emplace(role, file.sha256);
  if (read == keyed) return;
  for (const auto& [role, file] : manifest.inputs) {
    const auto [begin, end] = keyed.equal_range(role);
    const bool known = std::any_of(
        begin, end, [&file = file](const auto& input) { return input.second == file.sha256; });
    if (known) continue;
    throw Error(ExitCode::try_again,
                {.where = file.path,
                 .field = manifest.stage + ", " + role,
                 .found = "changed between the look into the cache and the reading",
                 .allowed = "a file that nobody writes to",
                 .remedy = "run again when it is complete; nothing was kept of this stage"});
  }
  throw unsound(manifest.stage, "its manifest leaves out inputs that it was given");
}

}  // namespace

Store::Store(fs::path folder, bool read_only)
    : folder_(std::move(folder)), read_only_(read_only), digests_(folder_ / "digests.txt") {
  if (read_only_) return;
  for (const char* part : {"objects", "entries", "locks", "work", "scratch", "live", "describe"}) {
    make_folder(folder_ / part);
  }
  const FileLock use(folder_ / use_lock, "", FileLock::Kind::shared);
  live_.emplace(folder_ / "live");
  sweep_work();
}

fs::path Store::object(const std::string& sha256) const {
  return folder_ / "objects" / sha256.substr(0, 2) / sha256;
}

fs::path Store::entry_file(const std::string& key) const {
  return folder_ / "entries" / (key + ".json");
}

Lookup Store::find(const std::string& key) {
  std::optional<FileLock> use;
  if (!read_only_) use.emplace(folder_ / use_lock, "", FileLock::Kind::shared);
  Lookup found = read_entry(key);
  if (!found.entry) return found;
  const std::string damage = damage_of(found.entry->manifest);
  if (!damage.empty()) return {.damage = damage};
  if (live_) {
    live_->note(key);
    std::error_code ignored;  // a time that cannot be set costs the entry its place in gc's order
    fs::last_write_time(entry_file(key), fs::file_time_type::clock::now(), ignored);
  }
  return found;
}

Lookup Store::read_entry(const std::string& key) const {
  if (!fs::exists(entry_file(key))) return {};
  const JsonText json = read_json(entry_file(key));
  try {
    const JsonValue root = json.root();
    Entry entry{.key = key,
                .transcript = root["transcript"].text(),
                .manifest_json = root["manifest"].raw(),
                .manifest = manifest_from_json(root["manifest"])};
    const bool sealed = root["seal"].text() == seal(entry.transcript, entry.manifest_json);
    if (root["schema"].raw() == entry_schema && sha256(entry.transcript) == key && sealed &&
        is_within_folders(entry.manifest)) {
      return {.entry = std::move(entry)};
    }
  } catch (const Error&) {
    // Said below.
  }
  return {.damage = "the cache entry is damaged"};
}

std::string Store::damage_of(const Manifest& manifest) {
  for (const auto& output : manifest.outputs) {
    const fs::path file = object(output.sha256);
    std::error_code failure;
    const auto bytes = fs::file_size(file, failure);
    if (failure) return fmt::format("cached {} is missing", output.path);
    if (bytes != output.bytes || digests_.digest(file) != output.sha256) {
      return fmt::format("cached {} is damaged", output.path);
    }
  }
  return {};
}

Entry Store::publish(const std::string& key, const std::string& transcript, const fs::path& work,
                     const Claim& claim) {
  const fs::path manifest_file = work / "manifest.json";
  if (!fs::exists(manifest_file)) throw unsound(work.string(), "the stage left no manifest.json");
  Entry entry{.key = key, .transcript = transcript};
  const JsonText manifest = read_json(manifest_file);
  try {
    entry.manifest = manifest_from_json(manifest.root());
    entry.manifest_json = manifest.root().raw();
  } catch (const Error& e) {
    throw unsound(manifest_file.string(), e.problem().field + ": " + e.problem().found);
  }
  if (entry.manifest.stage != claim.stage || entry.manifest.exit != claim.exit) {
    throw unsound(
        claim.stage,
        fmt::format("its manifest speaks of stage '{}' with exit {}, its process ended with "
                    "{}",
                    entry.manifest.stage, static_cast<int>(entry.manifest.exit),
                    static_cast<int>(claim.exit)));
  }
  check_inputs(entry.manifest, claim.inputs);
  entry.manifest_json["key"] = key;
  for (const auto& output : entry.manifest.outputs) {
    const fs::path file = work / output.path;
    if (!is_file_name(output.path) || !fs::is_regular_file(fs::symlink_status(file)) ||
        sha256_file(file) != output.sha256 || fs::file_size(file) != output.bytes) {
      throw unsound(entry.manifest.stage, output.path + " is not what the manifest says it is");
    }
  }
  const FileLock use(folder_ / use_lock, "", FileLock::Kind::shared);
  live_->note(key);
  for (const auto& output : entry.manifest.outputs) {
    live_->note(output.sha256);  // of a result that is not kept nothing else speaks
    const fs::path file = work / output.path, stored = object(output.sha256);
    make_folder(stored.parent_path());
    if (fs::exists(stored) && digests_.digest(stored) == output.sha256) continue;
    fs::permissions(file, fs::perms::owner_read | fs::perms::group_read | fs::perms::others_read);
    fs::rename(file, stored);
    digests_.remember(stored, output.sha256);
  }
  if (entry.manifest.uncacheable.empty()) {
    const Json json{{"schema", entry_schema},
                    {"key", key},
                    {"seal", seal(transcript, entry.manifest_json)},
                    {"transcript", transcript},
                    {"manifest", entry.manifest_json}};
    write_atomically(entry_file(key), json.dump(1) + "\n");
  }
  fs::remove_all(work);
  fs::remove_all(folder_ / "scratch" / key);
  return entry;
}

void Store::materialise(const Entry& entry, const fs::path& folder) {
  make_folder(folder);
  const fs::path manifest_file = folder / "manifest.json";
  const std::string manifest = entry.manifest_json.dump(1) + "\n";
  const std::string old = fs::exists(manifest_file) ? read_file(manifest_file) : "";
  if (old != manifest && !old.empty()) {
    fs::remove(manifest_file);
    for (const auto& name : outputs_named_by(old)) fs::remove(folder / name);
  }
  for (const auto& output : entry.manifest.outputs) place(output, folder / output.path);
  if (old != manifest) write_atomically(manifest_file, manifest);
}

void Store::place(const FileDigest& output, const fs::path& target) {
  const fs::path stored = object(output.sha256);
  std::error_code failure;
  if (fs::exists(target, failure)) {
    if (fs::equivalent(stored, target, failure)) return;
    const bool same_size = fs::file_size(target, failure) == output.bytes && !failure;
    if (same_size && digests_.digest(target) == output.sha256) return;
  }
  const fs::path partial =
      target.parent_path() / fmt::format(".{}.{}", target.filename().string(), getpid());
  fs::remove(partial, failure);
  digests_.keep_over(stored, [&] {
    fs::create_hard_link(stored, partial, failure);
    if (failure) fs::copy_file(stored, partial);  // another file system, or one without links
    fs::rename(partial, target);
  });
}

std::unique_ptr<FileLock> Store::lock(const std::string& key, const std::string& purpose,
                                      std::string& held_by) const {
  return FileLock::attempt(folder_ / "locks" / key, purpose, held_by);
}

WorkFolders Store::work_folders(const std::string& key) const {
  const fs::path work = folder_ / "work" / key;
  fs::remove_all(work);
  make_folder(work);
  return {work, folder_ / "scratch" / key};
}

// What killed runs left behind, told by a lock that nobody holds.
void Store::sweep_work() const {
  for (const auto& left : fs::directory_iterator(folder_ / "work")) {
    const fs::path lock_file = folder_ / "locks" / left.path().filename();
    const int file = open(lock_file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (file < 0) continue;
    std::error_code ignored;
    if (flock(file, LOCK_EX | LOCK_NB) == 0) fs::remove_all(left.path(), ignored);
    close(file);
  }
}

}  // namespace viscera::engine
