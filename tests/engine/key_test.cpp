#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "pipeline/engine/plan/explain.hpp"
#include "pipeline/engine/store/digest_cache.hpp"

namespace viscera::engine {
namespace {

namespace fs = std::filesystem;

std::string transcript(const std::vector<KeyComponent>& components) {
  KeyTranscript text;
  for (const auto& component : components)
    text.add(component.type, component.name, component.value);
  return text.text();
}

TEST(Transcript, IsReadBackWhateverTheValuesHold) {
  const std::vector<KeyComponent> components = {
      {"param", "title", "two\nlines = [3] abc"}, {"param", "empty", ""}, {"input", "a", "00ff"}};
  const auto read = read_transcript(transcript(components));
  ASSERT_EQ(read.size(), components.size());
  for (std::size_t i = 0; i < read.size(); ++i) {
    EXPECT_EQ(read[i].type, components[i].type);
    EXPECT_EQ(read[i].name, components[i].name);
    EXPECT_EQ(read[i].value, components[i].value);
  }
}

TEST(Transcript, DamagedTextEndsTheReadingWithoutHarm) {
  const std::string good = transcript({{"param", "a", "1"}, {"param", "b", "22"}});
  for (std::size_t length = 0; length < good.size(); ++length) {
    EXPECT_LE(read_transcript(good.substr(0, length)).size(), 2u);
  }
  EXPECT_TRUE(read_transcript("param a = [99999] x\n").empty());
}

TEST(Explain, NamesCausesBeforeCascades) {
  const std::string before = transcript({{"stage", "tetmesh", "1"},
                                         {"param", "cell_size", "4 mm"},
                                         {"input", "surface", "aa"},
                                         {"input", "extra", "bb"},
                                         {"library", "CGAL", "5.5"}});
  const std::string after = transcript({{"stage", "tetmesh", "2"},
                                        {"param", "cell_size", "5 mm"},
                                        {"input", "surface", "cc"},
                                        {"library", "CGAL", "5.6"}});
  EXPECT_EQ(explain(before, after, {"surface"}),
            "version 1 -> 2, cell_size 4 mm -> 5 mm, CGAL 5.5 -> 5.6, extra removed (cause); "
            "surface changed (cascade)");
  EXPECT_EQ(explain(before, before, {"surface"}), "");
}

class Digests : public testing::Test {
 protected:
  fs::path file(const std::string& name, const std::string& text, bool old = true) const {
    const fs::path path = folder_.path() / name;
    fs::create_directories(path.parent_path());
    std::ofstream(path) << text;
    if (old) fs::last_write_time(path, fs::file_time_type::clock::now() - std::chrono::hours(1));
    return path;
  }
  // As somebody would who hides the change: same size, inode and time of the content's change.
  static void change_in_secret(const fs::path& path, const std::string& text) {
    const auto time = fs::last_write_time(path);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));  // the clock's grain is below
    std::ofstream(path) << text;
    fs::last_write_time(path, time);
  }
  fs::path cache_file() const { return folder_.path() / "digests.json"; }

  TemporaryFolder folder_{fs::temp_directory_path()};
};

TEST_F(Digests, AFileThatNobodyTouchedIsNotReadAgainEvenInALaterRun) {
  const fs::path path = "/bin/sh";  // older than two seconds
  DigestCache first(cache_file());
  const std::string read = first.digest(path), marked(read.size(), 'f');
  first.save();
  std::string memory = read_file(cache_file());
  ASSERT_TRUE(memory.starts_with(read)) << memory;
  file("digests.json", memory.replace(0, read.size(), marked));
  DigestCache second(cache_file());
  EXPECT_EQ(second.digest(path), marked) << "as remembered, not as read";
}

TEST_F(Digests, AYoungFileIsNotTrusted) {
  const fs::path path = file("a", "one");
  DigestCache cache(cache_file());
  EXPECT_EQ(cache.digest(path), sha256("one"));
  cache.save();
  EXPECT_FALSE(fs::exists(cache_file())) << "nothing is remembered";
}

TEST_F(Digests, WhatIsSavedNowAndThenIsNotSavedAgainAtOnce) {
  DigestCache cache(cache_file());
  cache.digest("/bin/sh");
  cache.save();
  const std::string once = read_file(cache_file());
  cache.digest("/bin/ls");
  cache.save_now_and_then();
  EXPECT_EQ(read_file(cache_file()), once);
  cache.save();
  EXPECT_NE(read_file(cache_file()), once);
}

TEST_F(Digests, AChangeWhoseTimeWasPutBackIsNoticed) {
  const fs::path path = file("a", "one");
  DigestCache cache(cache_file());
  cache.remember(path, sha256("one"));
  change_in_secret(path, "two");
  EXPECT_EQ(cache.digest(path), sha256("two"));
}

TEST_F(Digests, ALinkOfOurOwnCostsNoReadingButHidesNoChange) {
  const fs::path path = file("a", "one"), link = folder_.path() / "link";
  const std::string marked(64, 'f');
  DigestCache cache(cache_file());
  cache.remember(path, marked);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  cache.keep_over(path, [&] { fs::create_hard_link(path, link); });
  EXPECT_EQ(cache.digest(path), marked) << "as remembered, not as read";
  change_in_secret(path, "two");
  cache.keep_over(path, [&] { fs::remove(link); });
  EXPECT_EQ(cache.digest(path), sha256("two"));
}

TEST_F(Digests, AChangedOrReplacedFileIsReadAgain) {
  const fs::path path = file("a", "one");
  DigestCache cache(cache_file());
  cache.digest(path);
  file("a", "two", false);
  EXPECT_EQ(cache.digest(path), sha256("two"));
  const fs::path other = file("b", "six");
  fs::rename(other, path);
  EXPECT_EQ(cache.digest(path), sha256("six"));
}

TEST_F(Digests, ADamagedMemoryIsIgnored) {
  for (const char* text : {"", "[1]", "{\"/a\": [1]}", "{\"/a\": 3", "\xff\xfe"}) {
    file("digests.json", text);
    DigestCache cache(cache_file());
    EXPECT_EQ(cache.digest(file("a", "one")), sha256("one"));
  }
}

TEST_F(Digests, AFolderIsAllItsFilesWithTheirNames) {
  file("d/1.dcm", "one");
  file("d/sub/2.dcm", "two");
  DigestCache cache(cache_file());
  const auto digest = [&] { return cache.input_digest(folder_.path() / "d"); };
  const std::string before = digest();
  fs::rename(folder_.path() / "d/1.dcm", folder_.path() / "d/3.dcm");
  EXPECT_NE(digest(), before);
  fs::rename(folder_.path() / "d/3.dcm", folder_.path() / "d/1.dcm");
  EXPECT_EQ(digest(), before);
  file("d/sub/2.dcm", "TWO", false);
  EXPECT_NE(digest(), before);
}

TEST_F(Digests, AHeaderBringsItsDataFileAndThePlaceDoesNotCount) {
  DigestCache cache(cache_file());
  const fs::path local = file("x/a.mhd", "ElementDataFile = LOCAL\n1");
  EXPECT_EQ(cache.input_digest(local),
            cache.input_digest(file("y/b.mhd", "ElementDataFile = LOCAL\n1")));
  const fs::path detached = file("z/c.nhdr", "NRRD0004\ndata file: c.raw\n");
  file("z/c.raw", "1");
  const std::string before = cache.input_digest(detached);
  file("z/c.raw", "2", false);
  EXPECT_NE(cache.input_digest(detached), before);
}

}  // namespace
}  // namespace viscera::engine
