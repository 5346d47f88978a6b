// A simulation that is interrupted goes on from where it was, to the same bits.
#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <chrono>
#include <ctime>
#include <thread>

#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

class Resumed : public Simulate {
 protected:
  // Runs viscera-simulate and interrupts it when it has worked half as long as the run that took
  // `whole_s`, by the processor's time, which it goes on for when interrupted, s, it returns. (A
  // fork without exec would lack the libraries' threads.)
  double interrupt(const std::vector<std::string>& extra, double whole_s) {
    std::vector<std::string> words = command_line(with_scratch(extra), "broken");
    words[0] = VISCERA_SIMULATE;
    std::vector<char*> arguments;
    for (auto& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    const pid_t process = fork();
    if (process == 0) {
      dup2(open(path("said").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666), STDERR_FILENO);
      execv(arguments[0], arguments.data());
      _exit(127);
    }
    clockid_t clock = 0;
    clock_getcpuclockid(process, &clock);
    const auto enough_ns = static_cast<std::int64_t>(0.5e9 * whole_s);
    timespec worked{};
    siginfo_t ended{};
    while (waitid(P_PID, static_cast<id_t>(process), &ended, WEXITED | WNOHANG | WNOWAIT) == 0 &&
           ended.si_pid == 0 && clock_gettime(clock, &worked) == 0 &&
           worked.tv_nsec + worked.tv_sec * 1'000'000'000 < enough_ns)
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    kill(process, SIGTERM);
    int status = 0;
    rusage used{};
    wait4(process, &status, 0, &used);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 130) << read_file(path("said"));
    EXPECT_FALSE(fs::exists(path("broken/manifest.json")));
    EXPECT_TRUE(fs::exists(path("scratch/current")));
    const auto seconds = [](std::int64_t whole, std::int64_t parts, double part) {
      return static_cast<double>(whole) + part * static_cast<double>(parts);
    };
    return seconds(used.ru_utime.tv_sec, used.ru_utime.tv_usec, 1e-6) +
           seconds(used.ru_stime.tv_sec, used.ru_stime.tv_usec, 1e-6) -
           seconds(worked.tv_sec, worked.tv_nsec, 1e-9);
  }
  double timed(const std::string& scene, const std::vector<std::string>& extra) {
    const std::clock_t begin = std::clock();
    EXPECT_EQ(run(scene, extra, "whole"), 0) << errors;
    return static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  }
  std::vector<std::string> with_scratch(std::vector<std::string> extra) const {
    extra.insert(extra.end(), {"--scratch", path("scratch").string()});
    return extra;
  }
  void expect_same(const std::string& one, const std::string& other) const {
    for (const char* file : {"trajectory.h5", "checkpoint.h5", "metrics.csv", "scene.json"}) {
      EXPECT_TRUE(read_file(path(one) / file) == read_file(path(other) / file)) << file;
    }
    EXPECT_EQ(metrics_of(one), metrics_of(other));
  }
  // Those that are not figures of the machine, and the gates.
  Json metrics_of(const std::string& out) const {
    Json kept = Json::array();
    const Json manifest = Json::parse(read_file(path(out) / "manifest.json"));
    for (const auto& metric : manifest["metrics"]) {
      if (!metric.value("machine", false)) kept.push_back(metric);
    }
    kept.push_back(manifest["gates"]);
    return kept;
  }
};

// Many substeps and a material that changes on the way.
const std::string slow_scene =
    with(with(drop_scene, "substeps: 32, end: 4 s", "substeps: 2000, end: 1.2 s"),
         "rest: {speed: 5 mm/s, hold: 0.1 s}\nexpect:\n  inverted_max: {max: 0}\n",
         "schedule:\n  - at: 0.1 s\n    materials: {liver: {E: 8 kPa}}\n");

TEST_F(Resumed, ARunGoesOnToTheSameBitsAsOneThatNobodyStopped) {
  for (const std::string solver : {"xpbd", "tled", "fem"}) {
    const bool implicit = solver == "fem";
    const std::vector<std::string> extra = {"--set", "solver=" + solver,
                                            "--set", implicit ? "substeps=4" : "substeps=2000",
                                            "--set", "forces=true"};
    interrupt(extra, timed(slow_scene, extra));
    ASSERT_EQ(run(slow_scene, with_scratch(extra), solver), 0) << errors;
    EXPECT_NE(errors.find("goes on at t"), std::string::npos) << errors;
    expect_same("whole", solver);
    fs::remove_all(path("scratch"));
    fs::remove_all(path("whole"));
  }
}

// A frame of a million substeps takes half a minute.
TEST_F(Resumed, AnInterruptWithinAFrameEndsTheRunAtOnceAndKeepsTheFramesBefore) {
  write_atomically(path("scene.yaml"), drop_scene);
  for (const std::string scheme : {"gauss_seidel", "block_gauss_seidel", "jacobi"}) {
    const double worked_on_s =
        interrupt({"--set", "substeps=1000000", "--set", "scheme=" + scheme}, 1.0);
    EXPECT_LT(worked_on_s, 0.5) << scheme;
    EXPECT_EQ(read_file(path("scratch/current")), "1") << scheme;
  }
}

TEST_F(Resumed, WhatCannotBeUsedIsLeftAside) {
  const double whole_s = timed(slow_scene, {});
  interrupt({}, whole_s);
  const std::string frames = read_file(path("scratch/current"));
  const fs::path last = path("scratch") / fmt::format("last-{}.h5", frames);
  fs::resize_file(last, fs::file_size(last) / 2);
  ASSERT_EQ(run(slow_scene, with_scratch({}), "again"), 0) << errors;
  EXPECT_NE(errors.find("starts anew"), std::string::npos) << errors;
  expect_same("whole", "again");
  interrupt({}, whole_s);  // of other params than those of the next
  ASSERT_EQ(run(slow_scene, with_scratch({"--set", "end=0.1s"}), "other"), 0) << errors;
  EXPECT_NE(errors.find("another run's"), std::string::npos) << errors;
}

}  // namespace
}  // namespace viscera
