// An entry of the cache under libFuzzer: whatever it says, the store serves it or names a damage,
// and writes nothing outside of the folder that it was given. The bytes are read twice: as they
// are, and with the checksums that belong to them, which no chance would hit upon.
#include <cstdlib>
#include <string_view>

#include "pipeline/base/digest.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/engine/store/store.hpp"
#include "tests/fuzz/fuzz_file.hpp"

namespace {

namespace fs = std::filesystem;
using namespace viscera;
using namespace viscera::engine;

constexpr const char* content = "an output";  // the one object that the store has

// A store of one object, made once.
Store& store() {
  static Store store(fuzz::folder() / "cache", false);
  static const fs::path object = [] {
    const fs::path path = store.object(sha256(content));
    fs::create_directories(path.parent_path());
    write_atomically(path, content);
    return path;
  }();
  return store;
}

std::size_t files_below(const fs::path& folder) {
  std::size_t count = 0;
  for (const auto& file : fs::recursive_directory_iterator(folder)) count += file.is_regular_file();
  return count;
}

void serve(const std::string& key, std::string_view entry) {
  const fs::path out = fuzz::folder() / "out" / "run" / "stage";
  fs::create_directories(out);
  write_atomically(store().entry_file(key), entry);
  const std::size_t before = files_below(fuzz::folder()) - files_below(out);
  fuzz::may_refuse([&] {
    const Lookup found = store().find(key);
    if (found.entry) store().materialise(*found.entry, out);
  });
  if (files_below(fuzz::folder()) - files_below(out) != before) std::abort();
  fs::remove(store().entry_file(key));
  fs::remove_all(fuzz::folder() / "out");
}

// What the store would have written if a stage had left this manifest.
void serve_sealed(std::string_view text) {
  const JsonText json(text, "fuzz.json");
  const Json& manifest = json.root().raw();
  if (!manifest.is_object()) return;
  const std::string transcript = "stage fuzz";
  const Json entry{{"schema", 1},
                   {"key", sha256(transcript)},
                   {"seal", sha256(transcript + manifest.dump())},
                   {"transcript", transcript},
                   {"manifest", manifest}};
  serve(sha256(transcript), entry.dump());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(bytes), size);
  serve(sha256("fuzz"), text);
  serve_sealed(text);
  const DigestCache digests(fuzz::as_file("digests.txt", bytes, size));
  return 0;
}
