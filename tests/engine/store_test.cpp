// Entries of the cache that a stranger wrote, with the checksums that belong to them.
#include "pipeline/engine/store/store.hpp"

#include <gtest/gtest.h>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"

namespace viscera::engine {
namespace {

// What find() says of an entry whose one output has this name and this digest.
Lookup found(const std::string& name, const std::string& digest) {
  const TemporaryFolder folder(std::filesystem::temp_directory_path());
  Store store(folder.path() / "cache", false);
  const std::string transcript = "a stage", object = sha256("an output");
  std::filesystem::create_directories(store.object(object).parent_path());
  write_atomically(store.object(object), "an output");
  Manifest manifest{.stage = "alpha", .params = Json::object()};
  manifest.outputs = {{.path = name, .sha256 = digest, .bytes = 9}};
  const Json json = to_json(manifest);
  write_atomically(store.entry_file(sha256(transcript)),
                   Json{{"schema", 1},
                        {"seal", sha256(transcript + json.dump())},
                        {"transcript", transcript},
                        {"manifest", json}}
                       .dump());
  return store.find(sha256(transcript));
}

TEST(Store, AnEntryIsServedOnlyWhereItsOutputsStayInTheirFolders) {
  const std::string digest = sha256("an output");
  EXPECT_TRUE(found("a.txt", digest).entry);
  for (const std::string& name :
       {std::string("../a.txt"), std::string("/tmp/a.txt"), std::string(".."), std::string(""),
        std::string("a\0b", 3), std::string(256, 'a')}) {
    EXPECT_EQ(found(name, digest).damage, "the cache entry is damaged") << name;
  }
  for (const std::string& other : {"../../" + digest.substr(6), digest.substr(1), std::string()}) {
    EXPECT_EQ(found("a.txt", other).damage, "the cache entry is damaged") << other;
  }
}

}  // namespace
}  // namespace viscera::engine
