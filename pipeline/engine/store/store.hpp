// The content-addressed store of finished stage outputs.
//
//   objects/ab/<sha256>   one read-only file per distinct content
//   entries/<key>.json    what a stage run made: its key's transcript and its manifest, which names
//                         the objects; published last, so that a killed run leaves none
//   locks/<key>           held while that key is being computed
//   work/<key>/           where the stage of that key writes; swept when nobody holds its lock
//   scratch/<key>/        what an interrupted stage of that key left to go on from; gone with its
//                         result, or with gc
//   live/<process>-<n>    held by a run while it lives: what it took or made, which gc leaves alone
//   use.lock              shared by runs while they take or make a result, held alone by gc
//   digests.txt, describe/*.json   remembered file digests and stage declarations
//
// Every file appears by a rename within its folder. Nothing is served that was not verified: sizes
// always, content whenever a file's stat differs from the remembered one.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "pipeline/contract/manifest.hpp"
#include "pipeline/engine/store/digest_cache.hpp"
#include "pipeline/engine/store/file_lock.hpp"
#include "pipeline/engine/store/live_run.hpp"

namespace viscera::engine {

struct Entry {
  std::string key, transcript;
  Json manifest_json;  // as the stage wrote it, and the key
  Manifest manifest;   // the same, read
};

struct Lookup {
  std::optional<Entry> entry;
  std::string damage;  // why an existing entry cannot be served; empty when there was none
};

struct WorkFolders {
  std::filesystem::path work;     // fresh, for what the stage writes
  std::filesystem::path scratch;  // perhaps not there
};

inline constexpr const char* use_lock = "use.lock";

class Store {
 public:
  // Makes the folders, unless `read_only` (then nothing is ever written). Throws Error(usage) when
  // the folder cannot be used.
  Store(std::filesystem::path folder, bool read_only);

  // A result that is found counts as used now.
  Lookup find(const std::string& key);

  // Moves the outputs that `work`'s manifest names into the store and enters them under `key`,
  // unless the manifest says that they are not for later runs. Throws Error(internal) when the
  // manifest is missing or does not agree with the files or with how the stage `claim`s to have
  // ended, and Error(try_again) when it read other inputs than those of the key: a file changed in
  // between.
  struct Claim {
    std::string stage;
    ExitCode exit = ExitCode::ok;                    // of its process
    std::multimap<std::string, std::string> inputs;  // digests by role, as in the key
  };
  Entry publish(const std::string& key, const std::string& transcript,
                const std::filesystem::path& work, const Claim& claim);

  // Makes `folder` hold the entry's outputs as hard links (copies where links cannot be made), with
  // the manifest last, and removes those of an earlier entry. Leaves alone what is already so.
  void materialise(const Entry& entry, const std::filesystem::path& folder);

  // One output of the entry as `target`.
  void place(const FileDigest& output, const std::filesystem::path& target);

  // Null while another process computes that key, which `held_by` then names.
  std::unique_ptr<FileLock> lock(const std::string& key, const std::string& purpose,
                                 std::string& held_by) const;
  WorkFolders work_folders(const std::string& key) const;  // hold the key's lock

  // The entry as it stands, whether or not its objects are there.
  Lookup read_entry(const std::string& key) const;

  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path object(const std::string& sha256) const;
  std::filesystem::path entry_file(const std::string& key) const;
  bool read_only() const { return read_only_; }
  DigestCache& digests() { return digests_; }

 private:
  std::string damage_of(const Manifest& manifest);
  void sweep_work() const;

  std::filesystem::path folder_;
  bool read_only_;
  DigestCache digests_;
  std::optional<LiveRun> live_;
};

}  // namespace viscera::engine
