// Stages whose executables cannot be asked what they declare.
#include "pipeline/engine/programs/catalog.hpp"

#include <gtest/gtest.h>

#include <chrono>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"

namespace viscera::engine {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

class StageExecutable : public testing::Test {
 protected:
  // A stage `sleepy` that is this shell script.
  void write(const std::string& script) const {
    write_atomically(executable_, "#!/bin/sh\n" + script + "\n");
    fs::permissions(executable_, fs::perms::owner_all);
  }
  Error refused() const {
    Store store(folder_.path() / "cache", false);
    Catalog catalog(folder_.path(), store, std::chrono::milliseconds(200));
    try {
      catalog.find("sleepy", "spec.yaml:3:3");
    } catch (const Error& error) {
      return error;
    }
    return Error(ExitCode::ok, {.found = "found"});
  }

  TemporaryFolder folder_{fs::temp_directory_path()};
  fs::path executable_ = folder_.path() / "viscera-sleepy";
};

TEST_F(StageExecutable, ThatNeverDeclaresItselfIsStoppedAndNamed) {
  write("exec sleep 600");
  const auto begin = Clock::now();
  const Error error = refused();
  EXPECT_LT(Clock::now() - begin, std::chrono::seconds(10));
  EXPECT_EQ(error.code(), ExitCode::internal) << error.what();
  EXPECT_EQ(error.problem().where, executable_.string() + " describe");
  EXPECT_EQ(error.problem().found, "did not end within 0.2 s");
  EXPECT_FALSE(error.problem().remedy.empty());
}

TEST_F(StageExecutable, ThatMayNotBeExecutedIsNoUnknownStage) {
  write("exit 0");
  fs::permissions(executable_, fs::perms::owner_read);
  const Error error = refused();
  EXPECT_EQ(error.code(), ExitCode::usage) << error.what();
  EXPECT_EQ(error.problem().where, executable_.string());
  EXPECT_EQ(error.problem().remedy, "chmod +x " + executable_.string());
}

}  // namespace
}  // namespace viscera::engine
