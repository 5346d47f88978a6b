// Stages that do next to nothing, so that what the engine does around them can be tested in
// milliseconds. One program: its name says which stage it is (viscera-alpha, viscera-beta, ...).
// FAKE_LOG names a file to which every start is appended; FAKE_<stage> makes that stage misbehave.
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <thread>

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/error.hpp"
#include "pipeline/contract/log.hpp"
#include "stages/common/stage_main.hpp"

namespace {

using namespace viscera;

std::string environment(const std::string& name) {
  const char* value = std::getenv(name.c_str());
  return value ? value : "";
}

Param size_param() {
  return {.name = "size",
          .type = ParamType::real,
          .fallback = "4mm",
          .unit = "mm",
          .lo = 1.0,
          .hi = 10.0,
          .doc = "rounded down in the output"};
}

// volume -> alpha -> (role a) -> beta -> (role b) -> gamma -> page; gamma reads a and b's manifest
// as well. echo reads b alone. refit writes b and may read b from a file. delta writes role a too.
// loop_one and loop_two feed one another. many reads every e and names the cases.
StageInfo declare(const std::string& name) {
  StageInfo info{.name = name, .version = "1", .doc = "a fake stage"};
  info.params = {{.name = "text", .fallback = "hello", .doc = "copied to the output"},
                 {.name = "threads",
                  .type = ParamType::integer,
                  .fallback = 1,
                  .lo = 1.0,
                  .doc = "changes nothing",
                  .in_key = false}};
  const auto feed = [&info](const char* from, const char* to) {
    info.inputs.push_back({.role = from, .doc = "a text file"});
    info.outputs.push_back({.file = info.name + ".txt", .role = to, .doc = "text"});
  };
  if (name == "alpha" || name == "delta") feed("volume", "a");
  if (name == "echo") feed("b", "e");
  if (name == "refit") feed("b", "b");
  if (name == "many") {
    feed("e", "all");
    info.inputs.back().many = true;
    info.params.push_back({.name = "cases",
                           .type = ParamType::list,
                           .fallback = Json::array(),
                           .doc = "names of the cases"});
  }
  if (name == "loop_one") feed("c", "d");
  if (name == "loop_two") feed("d", "c");
  if (name == "beta") {
    feed("a", "b");
    info.probes = {"env:FAKE_DEVICE"};
    info.params.push_back(size_param());
    info.params.push_back(
        {.name = "limit", .type = ParamType::real, .fallback = 100.0, .doc = "gate: size at most"});
    info.params.push_back({.name = "diverge",
                           .type = ParamType::text,
                           .fallback = "no",
                           .choices = {"no", "keep", "lose"},
                           .doc = "end with 7, with or without output"});
  }
  if (name == "gamma") {
    info.inputs = {{.role = "a", .required = false, .doc = "text"},
                   {.role = "b", .required = false, .doc = "text", .manifest = true}};
    info.outputs = {{.file = "page.html", .role = "page", .doc = "page"},
                    {.file = "summary.json", .role = "", .doc = "summary"}};
  }
  return info;
}

void misbehave(const std::string& how, const StageRun& run) {
  if (how == "fail") throw Error(ExitCode::bad_input, {.where = "volume.txt", .found = "too odd"});
  if (how == "crash") std::raise(SIGABRT);
  if (how == "killed") std::raise(SIGKILL);
  if (how == "exit42") _exit(42);
  if (how == "no_manifest") _exit(0);
  if (how == "undeclared") std::ofstream(run.out("surprise.txt")) << "boo";
  if (how == "garbage") std::cerr << "\x1b[31mnot json\n{\"level\": 3}\n[1, 2]\n{\n";
  if (how == "garbage") std::cout << std::string(100000, 'x');
  if (how == "spoil") std::ofstream(run.input("volume"), std::ios::app) << "more\n";
  if (how == "slow") std::this_thread::sleep_for(std::chrono::milliseconds(300));
  while (how == "hang") {
    log::check_interrupt();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

void work(const std::string& name, StageRun& run) {
  misbehave(environment("FAKE_" + name), run);
  log::progress("working", 0.5);
  std::string text = run.param<std::string>("text") + "\n";
  if (name == "many") {
    text = run.param<std::string>("text") + " " + run.params().at("cases").dump() + "\n";
    for (const auto& file : run.inputs("e")) text += read_file(file);
  }
  for (const char* role : {"volume", "a", "b", "b", "c", "d"}) {
    if (run.has_input(role)) text += read_file(run.input(role));
  }
  if (name == "gamma") {
    std::ofstream(run.out("page.html")) << text;
    std::ofstream(run.out("summary.json")) << "{}";
    return;
  }
  if (name == "beta") {
    run.machine_metric("process", getpid());
    if (environment("FAKE_beta") == "fickle") run.set_uncacheable("the device failed");
    const auto size = run.param<double>("size");
    text += std::to_string(static_cast<int>(size));
    if (environment("FAKE_beta") == "moody") text += std::to_string(getpid());
    run.gate("size", size, "<=", run.param<double>("limit"), "mm");
    const auto diverge = run.param<std::string>("diverge");
    if (diverge != "no") run.set_diverged("speed passed all bounds in frame 3");
    if (diverge == "lose") return;
  }
  std::ofstream(run.out(name + ".txt")) << text;
  log::warn("{} is only a fake", name);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string program = std::filesystem::path(argv[0]).filename().string();
  const std::string name = program.substr(program.find('-') + 1);
  if (const auto file = environment("FAKE_LOG"); !file.empty()) {
    std::ofstream(file, std::ios::app) << name << " " << (argc > 1 ? argv[1] : "") << "\n";
  }
  if (environment("FAKE_" + name) == "no_describe" && std::string(argv[1]) == "describe") return 0;
  // Somebody writes to the input after the engine has made the key.
  if (environment("FAKE_" + name) == "late_input") std::ofstream("volume.txt") << "late\n";
  const Stage stage{
      .info = declare(name), .run = [&name](StageRun& run) { work(name, run); }, .check = {}};
  return stage_main(argc, argv, stage);
}
