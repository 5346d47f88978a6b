#include "pipeline/base/atomic_file.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <sstream>

#include "pipeline/base/error.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

Error unwritable(const fs::path& path, const std::string& why) {
  return Error(ExitCode::usage, {.where = path.string(),
                                 .found = "cannot be written: " + why,
                                 .allowed = "a folder you may write to, with space left",
                                 .remedy = "choose another --out, or mend its permissions"});
}

std::string unique_suffix() {
  static std::atomic<int> count{0};
  return fmt::format("{}-{}", getpid(), count++);
}

}  // namespace

void write_atomically(const fs::path& path, std::string_view bytes) {
  const fs::path partial =
      path.parent_path() / fmt::format(".{}.{}", path.filename().string(), unique_suffix());
  std::error_code failure;
  {
    std::ofstream file(partial, std::ios::binary);
    file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    file.close();
    if (!file) {
      fs::remove(partial, failure);
      throw unwritable(path, "the file could not be created or filled");
    }
  }
  fs::rename(partial, path, failure);
  if (failure) {
    std::error_code ignored;
    fs::remove(partial, ignored);
    throw unwritable(path, failure.message());
  }
}

std::string read_file(const fs::path& path) {
  // A device or a pipe may never end.
  std::error_code failure;
  std::ifstream file;
  if (fs::is_regular_file(path, failure)) file.open(path, std::ios::binary);
  std::ostringstream text;
  if (file.is_open()) text << file.rdbuf();
  if (!file.is_open() || !file) {
    throw Error(ExitCode::bad_input, {.where = path.string(),
                                      .found = "cannot be read",
                                      .allowed = "a readable file",
                                      .remedy = "check the path and its permissions"});
  }
  return text.str();
}

TemporaryFolder::TemporaryFolder(const fs::path& parent) {
  std::error_code failure;
  for (fs::path folder = fs::absolute(parent).lexically_normal();
       !fs::exists(fs::symlink_status(folder, failure)) && folder.has_relative_path();
       folder = folder.parent_path()) {
    if (folder.has_filename()) made_.push_back(folder);
  }
  fs::create_directories(parent, failure);
  if (failure) refuse(parent, failure.message());
  path_ = parent / (".partial-" + unique_suffix());
  fs::remove_all(path_, failure);
  fs::create_directory(path_, failure);
  if (failure) refuse(parent, failure.message());
}

// No destructor runs for an object that was not finished.
void TemporaryFolder::refuse(const fs::path& parent, const std::string& why) const {
  remove();
  throw unwritable(parent, why);
}

void TemporaryFolder::remove() const {
  std::error_code ignored;
  if (!path_.empty()) fs::remove_all(path_, ignored);
  for (const auto& folder : made_) fs::remove(folder, ignored);  // only when it is empty
}

TemporaryFolder::~TemporaryFolder() {
  remove();
}

}  // namespace viscera
