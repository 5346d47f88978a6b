#include "pipeline/engine/store/upkeep.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iostream>
#include <map>
#include <set>

#include "pipeline/base/digest.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "pipeline/engine/store/store.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

Store open_store(const fs::path& cache) {
  if (!fs::is_directory(cache / "entries")) {
    throw Error(ExitCode::usage,
                {.where = cache.string(),
                 .found = "no cache",
                 .allowed = "the folder of a cache",
                 .remedy = "name it with --cache, or its run's folder with --out"});
  }
  return {cache, true};
}

// Sorted, so that what is removed first does not depend on the file system.
std::vector<fs::path> files_below(const fs::path& folder) {
  std::vector<fs::path> files;
  if (!fs::exists(folder)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

bool half_written(const fs::path& file) {
  return file.filename().string().starts_with('.');
}

std::string size_text(std::uintmax_t bytes) {
  const char* units[] = {"B", "kB", "MB", "GB", "TB"};
  double size = static_cast<double>(bytes);
  int unit = 0;
  for (; size >= 1000.0 && unit < 4; ++unit) size /= 1000.0;
  return fmt::format("{:.3g} {}", size, units[unit]);
}

// One entry: what it names and when it was last used.
struct Result {
  std::string key, stage;
  fs::path file;
  std::set<std::string> objects;
  double age_s = 0.0;
  bool live = false;
};

class Collector {
 public:
  explicit Collector(const GcOptions& options)
      : options_(options),
        store_(open_store(options.cache)),
        alone_(options.cache / use_lock, "gc",
               options.dry_run ? FileLock::Kind::shared : FileLock::Kind::exclusive),
        live_(live_runs(options.cache / "live", !options.dry_run)) {}

  void run() {
    measure_objects();
    read_results();
    for (const auto& result : results_) {
      if (options_.max_age_s && result.age_s > *options_.max_age_s && !result.live) drop(result);
    }
    for (const auto& result : results_) {
      if (!options_.max_size || total_ <= *options_.max_size) break;
      if (!result.live && !dropped_.count(result.key)) drop(result);
    }
    drop_unnamed();
    if (live_.count == 0) drop_leftovers();
    report();
  }

 private:
  void measure_objects() {
    for (const auto& file : files_below(options_.cache / "objects")) {
      sizes_[file.filename().string()] = fs::file_size(file);
      total_ += fs::file_size(file);
    }
  }

  // The longest unused first. A time ahead of the clock is none: the result counts as just used.
  void read_results() {
    const auto now = fs::file_time_type::clock::now();
    for (const auto& file : files_below(options_.cache / "entries")) {
      if (half_written(file)) continue;
      Result result{.key = file.stem().string(), .stage = "?", .file = file};
      if (const auto entry = store_.read_entry(result.key).entry) {
        result.stage = entry->manifest.stage;
        for (const auto& output : entry->manifest.outputs) result.objects.insert(output.sha256);
      }
      result.age_s =
          std::max(0.0, std::chrono::duration<double>(now - fs::last_write_time(file)).count());
      result.live = live_.noted.count(result.key) > 0;
      total_ += fs::file_size(file);
      for (const auto& object : result.objects) ++named_[object];
      results_.push_back(std::move(result));
    }
    std::stable_sort(results_.begin(), results_.end(),
                     [](const Result& a, const Result& b) { return a.age_s > b.age_s; });
  }

  void drop(const Result& result) {
    log::info("{} {} {:.12}, unused for {:.1f} days", options_.dry_run ? "would remove" : "removes",
              result.stage, result.key, result.age_s / 86400.0);
    dropped_.insert(result.key);
    total_ -= fs::file_size(result.file);
    remove(result.file);  // before its objects: a result never names what is not there
    for (const auto& object : result.objects) {
      if (--named_[object] == 0) drop_object(object);
    }
  }

  void drop_object(const std::string& object) {
    const auto size = sizes_.find(object);
    if (size == sizes_.end() || live_.noted.count(object)) return;
    total_ -= size->second;
    freed_ += size->second;
    remove(store_.object(object));
    sizes_.erase(size);
  }

  // Of runs that were killed between their files and the entry.
  void drop_unnamed() {
    const auto objects = sizes_;
    for (const auto& [object, size] : objects) {
      const auto named = named_.find(object);
      if (named == named_.end()) drop_object(object);
    }
  }

  // Nobody lives who could hold a lock, write a file or work in a folder.
  void drop_leftovers() {
    for (const char* folder : {"entries", "describe", ""}) {
      for (const auto& entry : fs::directory_iterator(options_.cache / folder)) {
        if (entry.is_regular_file() && half_written(entry.path())) remove(entry.path());
      }
    }
    for (const char* folder : {"locks", "work", "scratch"}) {
      for (const auto& entry : fs::directory_iterator(options_.cache / folder))
        remove(entry.path());
    }
  }

  void remove(const fs::path& path) const {
    std::error_code ignored;
    if (!options_.dry_run) fs::remove_all(path, ignored);
  }

  void report() const {
    std::string text = fmt::format("{} {} of {} results, {}; {} left",
                                   options_.dry_run ? "would remove" : "removed", dropped_.size(),
                                   results_.size(), size_text(freed_), size_text(total_));
    if (live_.count > 0) {
      const auto kept = std::count_if(results_.begin(), results_.end(),
                                      [](const Result& result) { return result.live; });
      text += fmt::format(" ({} live run{}: {} results stay)", live_.count,
                          live_.count == 1 ? "" : "s", kept);
    }
    std::cout << text << std::endl;
  }

  const GcOptions& options_;
  Store store_;
  FileLock alone_;
  LiveRuns live_;
  std::map<std::string, std::uintmax_t> sizes_;  // of objects
  std::map<std::string, int> named_;             // by how many results an object is named
  std::vector<Result> results_;
  std::set<std::string> dropped_;
  std::uintmax_t total_ = 0, freed_ = 0;
};

}  // namespace

void collect_garbage(const GcOptions& options) {
  Collector(options).run();
}

ExitCode verify_store(const fs::path& cache) {
  const Store store = open_store(cache);
  const FileLock use(cache / use_lock, "", FileLock::Kind::shared);
  std::set<std::string> sound;
  int damaged = 0;
  std::uintmax_t bytes = 0;
  const auto objects = files_below(cache / "objects");
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const std::string name = objects[i].filename().string();
    log::progress("reading", static_cast<double>(i) / static_cast<double>(objects.size()));
    bytes += fs::file_size(objects[i]);
    if (sha256_file(objects[i]) == name) {
      sound.insert(name);
      continue;
    }
    ++damaged;
    log::error("object {:.12} is damaged: removed", name);
    fs::remove(objects[i]);
  }
  log::clear_progress();
  int results = 0, incomplete = 0;
  for (const auto& file : files_below(cache / "entries")) {
    if (half_written(file)) continue;
    ++results;
    const auto entry = store.read_entry(file.stem().string()).entry;
    if (!entry) {
      ++damaged;
      log::error("entry {:.12} is damaged: removed", file.stem().string());
      fs::remove(file);
      continue;
    }
    for (const auto& output : entry->manifest.outputs) {
      if (sound.count(output.sha256)) continue;
      ++incomplete;
      log::error("{} {:.12} lacks {}: it will be made again", entry->manifest.stage, entry->key,
                 output.path);
      break;
    }
  }
  std::cout << fmt::format("read {} objects, {}, and {} results: {}", objects.size(),
                           size_text(bytes), results,
                           damaged + incomplete == 0
                               ? "all sound"
                               : fmt::format("{} damaged, {} incomplete", damaged, incomplete))
            << std::endl;
  if (damaged + incomplete == 0) return ExitCode::ok;
  fs::remove(cache / "digests.txt");  // what is remembered of files that are links to them
  return ExitCode::bad_input;
}

}  // namespace viscera::engine
