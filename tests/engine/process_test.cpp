#include "pipeline/engine/programs/process.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/engine/store/file_lock.hpp"

namespace viscera::engine {
namespace {

struct Heard {
  ProcessEnd end;
  std::vector<std::string> lines;
};

Heard run(const std::vector<std::string>& arguments) {
  Heard heard;
  heard.end =
      run_process(arguments, [&](std::string_view line) { heard.lines.emplace_back(line); });
  return heard;
}

TEST(Process, ArgumentsArriveAsTheyAreWithoutAShell) {
  const std::string awkward = "a b; $(rm -rf x) 'q' \"p\" *";
  const Heard heard = run({"/usr/bin/printf", "%s", awkward});
  EXPECT_EQ(heard.end.output, awkward);
  EXPECT_EQ(heard.end.exit_code, 0);
}

TEST(Process, ExitCodesSignalsAndLastLinesAreReported) {
  const Heard failed = run({"/bin/sh", "-c", "echo one >&2; printf two >&2; exit 5"});
  EXPECT_EQ(failed.end.exit_code, 5);
  EXPECT_EQ(failed.lines, (std::vector<std::string>{"one", "two"}));
  EXPECT_EQ(run({"/bin/sh", "-c", "kill -9 $$"}).end.signal, SIGKILL);
  EXPECT_EQ(run({"/nowhere/program"}).end.exit_code, 127);
}

TEST(Process, AFloodOnEitherStreamNeitherBlocksNorGrowsWithoutBound) {
  const Heard heard = run({"/bin/sh", "-c",
                           "head -c 9000000 /dev/zero | tr '\\0' x; "
                           "head -c 200000 /dev/zero | tr '\\0' y >&2"});
  EXPECT_EQ(heard.end.exit_code, 0);
  EXPECT_LT(heard.end.output.size(), 5u << 20);
  std::size_t total = 0;
  for (const auto& line : heard.lines) total += line.size();
  EXPECT_EQ(total, 200000u);
}

TEST(FileLock, OfAKilledHolderIsFree) {
  const TemporaryFolder folder(std::filesystem::temp_directory_path());
  const auto path = folder.path() / "lock";
  const pid_t holder = fork();
  if (holder == 0) {
    const FileLock lock(path, "test");
    raise(SIGKILL);
  }
  int status = 0;
  waitpid(holder, &status, 0);
  EXPECT_TRUE(WIFSIGNALED(status));
  EXPECT_EQ(read_file(path), "process " + std::to_string(holder) + " (test)");
  const FileLock lock(path, "heir");
  EXPECT_EQ(read_file(path), "process " + std::to_string(getpid()) + " (heir)");
}

}  // namespace
}  // namespace viscera::engine
