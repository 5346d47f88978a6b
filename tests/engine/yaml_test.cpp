#include <fmt/format.h>
#include <gtest/gtest.h>

#include <fstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/yaml_file.hpp"

namespace viscera::engine {
namespace {

class Yaml : public testing::Test {
 protected:
  // The message of the refusal, or "accepted".
  std::string refusal(const std::string& text) const {
    const auto path = folder_.path() / "spec.yaml";
    std::ofstream(path) << text;
    try {
      load_yaml(path);
      return "accepted";
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::bad_config);
      return e.what();
    }
  }
  void expect_refused(const std::string& text, const std::string& part) const {
    EXPECT_NE(refusal(text).find(part), std::string::npos) << refusal(text);
  }

 private:
  TemporaryFolder folder_{std::filesystem::temp_directory_path()};
};

TEST_F(Yaml, AliasesCannotMultiplyADocument) {
  std::string bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n";
  for (int i = 1; i < 12; ++i) {
    bomb += fmt::format("a{0}: &a{0} [*a{1}, *a{1}, *a{1}, *a{1}, *a{1}, *a{1}]\n", i, i - 1);
  }
  expect_refused(bomb, "too many values");
}

TEST_F(Yaml, AnAliasThatHoldsItselfIsRefused) {
  EXPECT_NE(refusal("a: &a [*a]\n"), "accepted");
}

TEST_F(Yaml, DeepNestingIsRefusedHoweverDeep) {
  const auto nested = [](int levels) {
    return std::string(levels, '[') + "1" + std::string(levels, ']');
  };
  EXPECT_EQ(refusal(nested(max_yaml_depth)), "accepted");
  expect_refused(nested(max_yaml_depth + 1), "nested too deeply");
  expect_refused(std::string(40, '[') + std::string(40, ']'), "nested too deeply");
  EXPECT_NE(refusal(std::string(500000, '[')), "accepted");
  EXPECT_NE(refusal("a: " + std::string(100000, '{')), "accepted");
}

TEST_F(Yaml, ALargeFileIsRefusedBeforeItIsRead) {
  expect_refused("a: " + std::string(max_yaml_bytes, 'x'), "larger than 1 MiB");
  const std::string head = "a: ";
  EXPECT_EQ(refusal(head + std::string(max_yaml_bytes - head.size(), 'x')), "accepted");
}

TEST_F(Yaml, ABraceInAPlainTextHasItsRemedyOnTheLineThatHoldsIt) {
  const std::string quotes = "write \"${name}\" with quotes";
  expect_refused("a: 1\nb: {c: ${input}}\n", quotes);
  EXPECT_EQ(refusal("a: ${input}\nb: {c: }}\n").find(quotes), std::string::npos);
}

TEST_F(Yaml, DuplicateKeysAreRefusedAtTheSecond) {
  expect_refused("a: 1\nb: {c: 1, d: 2, c: 3}\n", "spec.yaml:2:17: c: given twice");
}

TEST_F(Yaml, OneDocumentIsAskedFor) {
  expect_refused("a: 1\n---\nb: 2\n", "more than one YAML document");
  expect_refused(", a\n", "more than one YAML document");
  expect_refused("", "no YAML document");
}

TEST_F(Yaml, BinaryGarbageIsRefused) {
  EXPECT_NE(refusal(std::string("\x1f\x8b\x08\x00\xff\xfe{\x00:", 10)), "accepted");
}

TEST_F(Yaml, TextThatIsNotUtf8IsRefused) {
  expect_refused("effects: {spring: {k: \"1\xa1\"}}\n", "not UTF-8");
  expect_refused(std::string("expect:\n  a!\0b: {max: 1}\n", 25), "control characters");
}

TEST_F(Yaml, AnOrdinaryDocumentIsAccepted) {
  EXPECT_EQ(refusal("viscera: 1\nstages: {a: {b: [1, 2]}}\n"), "accepted");
}

TEST(YamlFile, AFolderOrAbsentFileIsNamed) {
  for (const char* path : {"/tmp", "/nowhere/spec.yaml"}) {
    EXPECT_THROW(load_yaml(path), Error) << path;
  }
}

}  // namespace
}  // namespace viscera::engine
