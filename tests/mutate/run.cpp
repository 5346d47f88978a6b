#include "tests/mutate/run.hpp"

#include <fmt/format.h>
#include <sys/wait.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <set>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace viscera::mutate {
namespace {

namespace fs = std::filesystem;

constexpr double patience_at_least = 10.0;  // s: a machine that is busy is no hang

// Of a suite: what it leaves out here. The one case starts stages that need the heavy libraries.
std::string filter_of(const std::string& test) {
  return test == "test_cli" ? "--gtest_filter=-FullDisk.StagesNameTheFileThatDidNotFitAndLeaveNone"
                            : "";
}

struct Ended {
  int code;  // 124: out of time
  double seconds;
  std::string test;  // that failed, or ran when the process ended
  bool reached;
};

// The first case that failed; where none is named, the one that had begun.
std::string case_that_failed(const fs::path& log) {
  std::ifstream in(log);
  std::string begun;
  for (std::string line; std::getline(in, line);) {
    const std::string run = "[ RUN      ] ", failed = "[  FAILED  ] ";
    if (line.starts_with(run)) begun = line.substr(run.size());
    if (line.starts_with(failed)) {
      const std::string name = line.substr(failed.size());
      return name.substr(0, name.find_first_of(", "));
    }
  }
  return begun;
}

class Bench {
 public:
  explicit Bench(const RunOptions& options) : options_(options) {
    for (const auto& row : read_columns(options.out + "/baseline.tsv")) {
      if (row.size() == 2) baseline_[row[0]] = std::stod(row[1]);
    }
  }

  // Tests write beside what they read, so each worker has a folder of its own: links to the
  // sources, and copies of what tests rewrite.
  void prepare(int worker) const {
    const fs::path place = scratch(worker);
    fs::remove_all(place);
    fs::create_directories(place / "tmp");
    for (const auto& entry : fs::directory_iterator(options_.source)) {
      const std::string name = entry.path().filename().string();
      if (name == ".git" || name == "build" || name == "out") continue;
      if (name == "docs") {
        fs::copy(entry.path(), place / name, fs::copy_options::recursive);
      } else {
        fs::create_symlink(fs::absolute(entry.path()), place / name);
      }
    }
  }

  Ended run(int worker, int number, const std::string& test, double limit) const {
    const fs::path place = scratch(worker), reached = place / "reached", log = place / "log";
    fs::remove(reached);
    const std::string bin = fs::absolute(options_.bin).string();
    const std::string core =
        options_.jobs > 1 ? fmt::format("taskset -c {} ", worker % cores()) : "";
    const std::string command = fmt::format(
        "cd '{0}' && env TMPDIR='{0}/tmp' VISCERA_MUTANT={1} VISCERA_MUTANT_REACHED='{2}' "
        "VISCERA_MUTANT_BIN='{3}' "
        "RC_PARAMS='seed=1' {4}timeout -k 5 {5:.0f} '{3}/{6}' --gtest_fail_fast {8} >'{7}' 2>&1",
        place.string(), number, reached.string(), bin, core, limit, test, log.string(),
        filter_of(test));
    const auto begin = std::chrono::steady_clock::now();
    const int status = std::system(command.c_str());
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    const int code = WIFEXITED(status) ? WEXITSTATUS(status) : 1;
    return {code, took.count(), code ? case_that_failed(log) : "", fs::exists(reached)};
  }

  // What each suite takes on the unchanged code, measured as the mutants are: several at once.
  void measure(const std::set<std::string>& tests) {
    std::vector<std::string> unknown;
    for (const std::string& test : tests) {
      if (!baseline_.count(test)) unknown.push_back(test);
    }
    std::mutex telling;
    std::string failed;
    side_by_side(unknown.size(), [&](int worker, std::size_t i) {
      const Ended ended = run(worker, 0, unknown[i], 3600.0);
      const std::scoped_lock lock(telling);
      fmt::print("unchanged: {} takes {:.1f} s\n", unknown[i], ended.seconds);
      std::fflush(stdout);
      if (ended.code)
        failed += fmt::format(" {} ({}, code {})", unknown[i], ended.test, ended.code);
      if (ended.code) return;
      baseline_[unknown[i]] = ended.seconds;
      std::ofstream(options_.out + "/baseline.tsv", std::ios::app)
          << fmt::format("{}\t{}\n", unknown[i], ended.seconds);
    });
    if (!failed.empty()) throw std::runtime_error("mutate: fails on the unchanged code:" + failed);
  }

  double limit_of(const std::string& test) const {
    return patience_at_least + options_.patience * baseline_.at(test);
  }

  template <class Work>
  void side_by_side(std::size_t count, Work work) const {
    std::atomic<std::size_t> next{0};
    std::vector<std::jthread> crew;
    for (int worker = 0; worker < options_.jobs; ++worker) {
      crew.emplace_back([&, worker] {
        prepare(worker);
        for (std::size_t i = next++; i < count; i = next++) work(worker, i);
      });
    }
  }

 private:
  static int cores() { return static_cast<int>(std::max(1U, std::thread::hardware_concurrency())); }
  fs::path scratch(int worker) const {
    return fs::absolute(options_.out) / fmt::format("scratch{}", worker);
  }

  const RunOptions& options_;
  std::map<std::string, double> baseline_;  // s
};

const char* const words[] = {"survived", "noticed", "hung"};

std::string joined(const std::vector<std::string>& list) {
  std::string text;
  for (const std::string& one : list) text += (text.empty() ? "" : " ") + one;
  return text.empty() ? "-" : text;
}

bool contains(const std::vector<std::string>& list, const std::string& one) {
  return std::find(list.begin(), list.end(), one) != list.end();
}

}  // namespace

std::vector<std::string> tests_of(const std::string& group, bool quick) {
  if (group == "stages/tetmesh/improve") return {"test_improve", "test_tetmesh"};
  if (group == "pipeline/base" || group == "pipeline/contract")
    return {"test_contract", "test_engine", "test_cli"};
  if (group == "pipeline/engine") return {"test_engine", "test_cli"};
  std::vector<std::string> tests = {"test_properties", "test_sim", "test_blocks",
                                    "test_verification"};
  if (!quick) tests.insert(tests.end(), {"test_solvers", "test_hard_cases"});
  return tests;
}

std::map<std::string, Result> read_results(const std::string& out) {
  std::map<std::string, Result> results;
  for (const auto& row : read_columns(out + "/results.tsv")) {
    if (row.size() < 6) continue;
    Result result;
    for (const End end : {End::survived, End::noticed, End::hung}) {
      if (row[1] == words[static_cast<int>(end)]) result.end = end;
    }
    result.reached = row[2] == "reached";
    result.executable = row[3], result.test = row[4];
    std::istringstream passed(row[5]);
    for (std::string one; passed >> one;) {
      if (one != "-") result.passed.push_back(one);
    }
    results[row[0]] = result;
  }
  return results;
}

void run_all(const std::vector<Mutant>& mutants, const RunOptions& options) {
  fs::create_directories(options.out);
  auto results = read_results(options.out);
  struct Job {
    Mutant mutant;
    std::vector<std::string> tests;
  };
  std::vector<Job> jobs;
  std::set<std::string> needed;
  for (const Mutant& mutant : mutants) {
    if (mutant.number < options.from || mutant.number > options.to) continue;
    const Result& before = results[key_of(mutant)];
    if (before.end != End::survived) continue;
    auto tests = tests_of(mutant.group, options.quick);
    std::erase_if(tests, [&](const std::string& test) { return contains(before.passed, test); });
    if (tests.empty()) continue;
    needed.insert(tests.begin(), tests.end());
    jobs.push_back({mutant, tests});
  }
  Bench bench(options);
  bench.measure(needed);
  std::mutex telling;
  std::size_t done = 0;
  bench.side_by_side(jobs.size(), [&](int worker, std::size_t i) {
    const Job& job = jobs[i];
    const std::string key = key_of(job.mutant);
    Result result;
    {
      const std::scoped_lock lock(telling);
      result = results[key];
    }
    for (const std::string& test : job.tests) {
      const Ended ended = bench.run(worker, job.mutant.number, test, bench.limit_of(test));
      result.reached = result.reached || ended.reached;
      if (ended.code == 0) {
        result.passed.push_back(test);
        continue;
      }
      result.end = ended.code == 124 || ended.code == 137 ? End::hung : End::noticed;
      result.executable = test, result.test = ended.test.empty() ? "-" : ended.test;
      break;
    }
    const std::scoped_lock lock(telling);
    results[key] = result;
    const char* reached = result.reached ? "reached" : "never reached";
    std::ofstream(options.out + "/results.tsv", std::ios::app)
        << fmt::format("{}\t{}\t{}\t{}\t{}\t{}\n", key, words[static_cast<int>(result.end)],
                       reached, result.executable.empty() ? "-" : result.executable,
                       result.test.empty() ? "-" : result.test, joined(result.passed));
    fmt::print("{}/{} mutant {}: {}, {} {} {}\n", ++done, jobs.size(), job.mutant.number,
               words[static_cast<int>(result.end)], reached, result.executable, result.test);
    std::fflush(stdout);
  });
}

}  // namespace viscera::mutate
