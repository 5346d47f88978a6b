// A folder that appears as a whole: what was there stays until the new one is complete.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "pipeline/base/atomic_file.hpp"

namespace viscera::engine {

class ReplacedFolder {
 public:
  // @param mark the file by which an earlier folder of this kind is known, which alone is replaced
  // @param kind of such a folder, for messages: "record"
  // Throws Error(usage) when something else is at `out`.
  ReplacedFolder(const std::filesystem::path& out, const std::string& mark,
                 const std::string& kind);

  std::filesystem::path path() const { return staging_->path() / "made"; }  // to be written to
  // Returns where it is.
  const std::filesystem::path& put_in_place() const;

 private:
  std::filesystem::path out_;
  std::optional<TemporaryFolder> staging_;
};

}  // namespace viscera::engine
