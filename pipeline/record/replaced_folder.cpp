#include "pipeline/record/replaced_folder.hpp"

#include <fcntl.h>
#include <fmt/format.h>

#include <cstdio>

#include "pipeline/base/error.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

void check_replaceable(const fs::path& out, const std::string& mark, const std::string& kind) {
  std::error_code failure;
  if (!fs::exists(fs::symlink_status(out, failure))) return;
  const bool is_folder = fs::is_directory(out, failure);
  if (is_folder && (fs::is_empty(out, failure) || fs::is_regular_file(out / mark))) return;
  throw Error(ExitCode::usage,
              {.where = out.string(),
               .field = "--out",
               .found = is_folder ? "a folder that holds something else" : "no folder",
               .allowed = fmt::format(
                   "a new folder, an empty one, or an earlier {}, which is replaced", kind),
               .remedy = "choose another --out"});
}

}  // namespace

ReplacedFolder::ReplacedFolder(const fs::path& out, const std::string& mark,
                               const std::string& kind)
    : out_(out.lexically_normal()) {
  if (!out_.has_filename()) out_ = out_.parent_path();
  check_replaceable(out_, mark, kind);
  staging_.emplace(out_.has_parent_path() ? out_.parent_path() : fs::path("."));
  fs::create_directory(path());
}

// What was there goes with the temporary folder.
const fs::path& ReplacedFolder::put_in_place() const {
  if (fs::exists(out_)) {
    if (renameat2(AT_FDCWD, path().c_str(), AT_FDCWD, out_.c_str(), RENAME_EXCHANGE) == 0)
      return out_;
    fs::rename(out_, staging_->path() / "before");  // a file system that cannot exchange
  }
  fs::rename(path(), out_);
  return out_;
}

}  // namespace viscera::engine
