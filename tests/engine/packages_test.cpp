// .ci/packages with an apt of our own: what it asks for, and when it stays silent.
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/engine/programs/process.hpp"

namespace viscera::engine {
namespace {

namespace fs = std::filesystem;

// A folder with the script, a package list, and programs that log how they are called.
class Packages : public testing::Test {
 protected:
  Packages() {
    fs::create_directories(folder_.path() / ".ci");
    fs::create_directories(folder_.path() / "bin");
    fs::copy_file(".ci/packages", folder_.path() / ".ci/packages");
    std::ofstream(folder_.path() / ".packages")
        << "# all\n[run]\ng++\ncmake  # builds\n\n[test]\nninja-build\n";
    program("id", "echo 0");
    program("dpkg-query",
            "for p; do :; done; case \" $HAVE \" in *\" $p \"*) printf installed;; "
            "*) exit 1;; esac");
    program("apt-cache", "test -n \"$LISTS\" || test -e lists");
    program("apt-get",
            "echo \"$@\" >> log; case $1 in update) touch lists;; "
            "*) test -z \"$STALE\" || test -e lists;; esac");
  }

  void program(const std::string& name, const std::string& body) const {
    const fs::path path = folder_.path() / "bin" / name;
    std::ofstream(path) << "#!/bin/sh\n" << body << "\n";
    fs::permissions(path, fs::perms::owner_all);
  }

  // What apt-get was told; the script's own words are in `said_`.
  std::string run(const std::string& have, const std::vector<std::string>& environment = {},
                  const std::vector<std::string>& purposes = {}) {
    const std::string folder = folder_.path().string();
    std::vector<std::string> command = {"/usr/bin/env", "PATH=" + folder + "/bin:/usr/bin:/bin",
                                        "HAVE=" + have};
    command.insert(command.end(), environment.begin(), environment.end());
    command.insert(command.end(), {"/bin/sh", folder + "/.ci/packages"});
    command.insert(command.end(), purposes.begin(), purposes.end());
    const auto end = run_process(command, [](std::string_view) {});
    EXPECT_EQ(end.exit_code, 0);
    said_ = end.output;
    return fs::exists(folder_.path() / "log") ? read_file(folder_.path() / "log") : "";
  }

  TemporaryFolder folder_{fs::temp_directory_path()};
  std::string said_;
  const std::string install_ = "install -y -q --no-install-recommends cmake ninja-build\n";
};

TEST_F(Packages, NothingIsSaidOrDoneWhenAllAreInstalled) {
  EXPECT_EQ(run("g++ cmake ninja-build"), "");
  EXPECT_EQ(said_, "");
}

TEST_F(Packages, OnlyTheMissingOnesAreInstalledWithoutAnUpdate) {
  EXPECT_EQ(run("g++", {"LISTS=1"}), install_);
}

TEST_F(Packages, OnlyThoseOfThePurposesAskedForAreInstalled) {
  EXPECT_EQ(run("g++", {"LISTS=1"}, {"run"}), "install -y -q --no-install-recommends cmake\n");
  EXPECT_EQ(run("g++ cmake", {}, {"run"}), "install -y -q --no-install-recommends cmake\n");
}

TEST_F(Packages, SeveralPurposesAreInstalledAtOnce) {
  EXPECT_EQ(run("g++", {"LISTS=1"}, {"test", "run"}), install_);
}

TEST_F(Packages, ListsThatAreAbsentAreFetchedFirst) {
  EXPECT_EQ(run("g++"), "update -q\n" + install_);
}

TEST_F(Packages, ListsThatAreOutOfDateAreFetchedAndTheInstallTriedAgain) {
  EXPECT_EQ(run("g++", {"LISTS=1", "STALE=1"}), install_ + "update -q\n" + install_);
}

}  // namespace
}  // namespace viscera::engine
