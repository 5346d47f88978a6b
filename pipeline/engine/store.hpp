// The content-addressed store of finished stage outputs.
//
//   objects/ab/<sha256>   one read-only file per distinct content
//   entries/<key>.json    what a stage run made: its key's transcript and its manifest, which names
//                         the objects; published last, so that a killed run leaves none
//   locks/<key>           held while that key is being computed
//   work/<key>/           where the stage of that key writes; swept when nobody holds its lock
//   digests.json, describe/*.json   remembered file digests and stage declarations
//
// Every file appears by a rename within its folder. Nothing is served that was not verified: sizes
// always, content whenever a file's stat differs from the remembered one.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "pipeline/contract/manifest.hpp"
#include "pipeline/engine/digest_cache.hpp"
#include "pipeline/engine/file_lock.hpp"

namespace viscera {

struct Entry {
  std::string key, transcript;
  Json manifest_json;  // as the stage wrote it, and the key
  Manifest manifest;   // the same, read
};

struct Lookup {
  std::optional<Entry> entry;
  std::string damage;  // why an existing entry cannot be served; empty when there was none
};

class Store {
 public:
  // Makes the folders, unless `read_only` (then nothing is ever written). Throws Error(usage) when
  // the folder cannot be used.
  Store(std::filesystem::path folder, bool read_only);

  Lookup find(const std::string& key);

  // Moves the outputs that `work`'s manifest names into the store and enters them under `key`,
  // unless the manifest says that they are not for later runs. Throws Error(internal) when the
  // manifest is missing or does not agree with the files, and Error(try_again) when the stage read
  // other inputs than `inputs` (digests by role), those of the key: a file changed in between.
  Entry publish(const std::string& key, const std::string& transcript,
                const std::filesystem::path& work,
                const std::multimap<std::string, std::string>& inputs);

  // Makes `folder` hold the entry's outputs as hard links (copies where links cannot be made), with
  // the manifest last, and removes those of an earlier entry. Leaves alone what is already so.
  void materialise(const Entry& entry, const std::filesystem::path& folder);

  // One output of the entry as `target`.
  void place(const FileDigest& output, const std::filesystem::path& target);

  FileLock lock(const std::string& key, const std::string& purpose) const;
  std::filesystem::path fresh_work_folder(const std::string& key) const;  // hold the key's lock

  const std::filesystem::path& folder() const { return folder_; }
  bool read_only() const { return read_only_; }
  DigestCache& digests() { return digests_; }

 private:
  std::filesystem::path object(const std::string& sha256) const;
  std::filesystem::path entry_file(const std::string& key) const;
  std::string damage_of(const Manifest& manifest);
  void sweep_work() const;

  std::filesystem::path folder_;
  bool read_only_;
  DigestCache digests_;
};

}  // namespace viscera
