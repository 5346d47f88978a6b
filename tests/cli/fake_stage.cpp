// Stages that do next to nothing, so that what the engine does around them can be tested in
// milliseconds. One program: its name says which stage it is (viscera-alpha, viscera-beta, ...).
// FAKE_LOG names a file to which every start is appended; FAKE_<stage> makes that stage misbehave.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <thread>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "pipeline/contract/input_digest.hpp"
#include "stages/program/stage_main.hpp"

namespace {

using namespace viscera;

std::string environment(const std::string& name) {
  const char* value = std::getenv(name.c_str());
  return value ? value : "";
}

const GateInfo size_gate("size", "<=", "mm", "The result is too large.", "lower beta.size");

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
// loop_one and loop_two feed one another. many reads every e and names the cases; compare reads
// two b; census reads what the engine says of them. device may use a GPU. grow writes a text longer
// than the size_field that it reads, and weigh passes it on, with a failed gate, while it has fewer
// lines than its `adapt` wants.
StageInfo declare(const std::string& name) {
  StageInfo info{.name = name, .version = "1", .doc = "a fake stage"};
  info.params = {{.name = "text", .fallback = "hello", .doc = "copied to the output"},
                 {.name = "threads",
                  .type = ParamType::integer,
                  .fallback = 1,
                  .lo = 0.0,
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
  if (name == "compare") {
    feed("b", "comparison");
    info.inputs.back().many = true;
    info.outputs.push_back({.file = "overlay.png", .role = "", .doc = "a picture"});
    info.params = {
        {.name = "title", .doc = "heading"},
        {.name = "cases", .type = ParamType::list, .fallback = Json::array(), .doc = "names"},
        {.name = "methods", .type = ParamType::list, .fallback = Json::array(), .doc = "names"}};
  }
  if (name == "grow") {
    feed("volume", "grown");
    info.inputs.push_back({.role = "size_field", .required = false, .doc = "text"});
  }
  if (name == "weigh") {
    feed("grown", "size_field");
    info.params.push_back(
        {.name = "adapt", .type = ParamType::map, .fallback = nullptr, .doc = "lines"});
    info.gates = {size_gate};
  }
  if (name == "census") feed("runs", "census");
  if (name == "device") {
    feed("volume", "device");
    info.params.push_back(
        {.name = "device", .fallback = "auto", .choices = {"auto", "cpu", "cuda"}, .doc = "a GPU"});
  }
  if (name == "loop_one") feed("c", "d");
  if (name == "loop_two") feed("d", "c");
  if (name == "beta") {
    feed("a", "b");
    info.probes = {"env:FAKE_DEVICE"};
    info.params.push_back(size_param());
    info.params.push_back(
        {.name = "limit", .type = ParamType::real, .fallback = 100.0, .doc = "gate: size at most"});
    info.gates = {size_gate};
    info.params.push_back({.name = "diverge",
                           .type = ParamType::text,
                           .fallback = "no",
                           .choices = {"no", "keep", "lose"},
                           .doc = "end with 7, with or without output"});
  }
  if (name.size() == 2 && name[0] == 's') {  // s1 reads volume, s2 what s1 wrote, …
    const int number = name[1] - '0';
    feed(number == 1 ? "volume" : fmt::format("r{}", number - 1).c_str(),
         fmt::format("r{}", number).c_str());
  }
  if (name == "gamma") {
    info.inputs = {{.role = "a", .required = false, .doc = "text"},
                   {.role = "b", .required = false, .doc = "text", .manifest = true}};
    info.outputs = {{.file = "page.html", .role = "page", .doc = "page"},
                    {.file = "summary.json", .role = "", .doc = "summary"}};
  }
  return info;
}

// Says that all went well, with a manifest of its own making, and ends.
[[noreturn]] void lie(const StageInfo& info, const StageRun& run, const std::string& how) {
  const std::filesystem::path out = run.out("").parent_path().parent_path();
  Manifest manifest{.stage = info.name, .version = info.version, .params = run.params()};
  for (const auto& input : info.inputs) {
    if (run.has_input(input.role))
      manifest.inputs.emplace(input.role, input_digest(run.input(input.role)));
  }
  const std::string name = info.name + ".txt", text = "lies\n";
  if (how == "lie_link") {
    std::filesystem::create_symlink(run.input(info.inputs[0].role), out / name);
  } else {
    std::ofstream(out / name) << text;
  }
  manifest.outputs = {{name, sha256(text), text.size()}};
  if (how == "lie_outside") manifest.outputs[0].path = "../../../volume.txt";
  if (how == "lie_digest") manifest.outputs[0].sha256 = sha256("truth");
  if (how == "lie_size") manifest.outputs[0].bytes = 1;
  if (how == "lie_missing") manifest.outputs[0].path = "never.txt";
  if (how == "lie_name") manifest.stage = "alpha";
  if (how == "lie_exit") manifest.exit = ExitCode::gate_failed;
  if (how == "lie_inputs") manifest.inputs.clear();
  write_atomically(out / "manifest.json",
                   how == "lie_garbage" ? "\x7f{[ no json" : to_json(manifest).dump());
  _exit(0);
}

// Leaves a process behind that keeps the pipes to the engine open.
void leave_behind() {
  if (fork() != 0) return;
  std::this_thread::sleep_for(std::chrono::seconds(30));
  _exit(0);
}

// Ends when another stage is at work at the same time, or fails after a while.
void meet() {
  std::ofstream("met.log", std::ios::app) << getpid() << "\n";
  for (int turn = 0; turn < 600; ++turn) {
    if (read_file("met.log").find('\n') + 1 < read_file("met.log").size()) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  throw Error(ExitCode::internal, {.found = "nobody else was at work"});
}

// Leaves the first half of its work for an equal run, and fails; with it, goes on.
void work_by_halves(const std::filesystem::path& scratch) {
  if (std::filesystem::exists(scratch / "half")) return log::info("goes on from its half");
  std::filesystem::create_directories(scratch);
  std::ofstream(scratch / "half") << "half\n";
  throw Error(ExitCode::try_again, {.found = "half done"});
}

void misbehave(const StageInfo& info, const std::string& how, const StageRun& run) {
  if (how.starts_with("lie_")) lie(info, run, how);
  if (how == "orphan") leave_behind();
  if (how == "flood") {
    for (int line = 0; line < 300; ++line) std::cerr << std::string(100000, '\xff') << "\n";
    std::cout << std::string(20'000'000, 'x');
  }
  if (how == "tamper") std::ofstream("out/spec/alpha/alpha.txt", std::ios::app) << "tampered\n";
  if (how == "half") work_by_halves(run.scratch());
  if (how == "gpu_log")
    std::ofstream("gpu.log", std::ios::app) << environment("CUDA_VISIBLE_DEVICES") << "\n";
  if (how == "fail_first" && run.param<std::string>("text") == "a")
    throw Error(ExitCode::bad_input, {.where = "volume.txt", .found = "too odd"});
  if (how == "fail") throw Error(ExitCode::bad_input, {.where = "volume.txt", .found = "too odd"});
  if (how == "crash") std::raise(SIGABRT);
  if (how == "killed") std::raise(SIGKILL);
  if (how == "exit42") _exit(42);
  if (how == "no_manifest") _exit(0);
  if (how == "undeclared") std::ofstream(run.out("surprise.txt")) << "boo";
  if (how == "garbage") std::cerr << "\x1b[31mnot json\n{\"level\": 3}\n[1, 2]\n{\n";
  if (how == "garbage") std::cout << std::string(100000, 'x');
  if (how == "spoil") std::ofstream(run.input("volume"), std::ios::app) << "more\n";
  if (how == "together") meet();
  if (how == "slow") std::this_thread::sleep_for(std::chrono::milliseconds(300));
  while (how == "hang") {
    log::check_interrupt();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

void work(const std::string& name, StageRun& run) {
  misbehave(declare(name), environment("FAKE_" + name), run);
  if (name == "compare") {
    std::ofstream(run.out("overlay.png")) << "picture";
    std::string text = run.params().dump() + "\n";
    for (const auto& file : run.inputs("b")) text += read_file(file) + "\n";
    write_atomically(run.out("compare.txt"), text);
    return;
  }
  log::progress("working", 0.5);
  if (run.param<std::string>("text") == "fail")
    throw Error(ExitCode::bad_input, {.where = "volume.txt", .found = "text fail"});
  std::string text = run.param<std::string>("text") + "\n";
  if (name == "many") {
    text = run.param<std::string>("text") + " " + run.params().at("cases").dump() + "\n";
    for (const auto& file : run.inputs("e")) text += read_file(file);
  }
  for (const auto& input : declare(name).inputs) {
    if (!input.many && run.has_input(input.role)) text += read_file(run.input(input.role));
  }
  if (name == "gamma") {
    std::ofstream(run.out("page.html")) << text;
    std::ofstream(run.out("summary.json")) << "{}";
    return;
  }
  if (name == "weigh") {
    const Json adapt = run.params().at("adapt");
    const auto lines = std::ranges::count(text, '\n');
    const bool is_enough = lines >= adapt.at("lines").get<int>();
    run.gate(size_gate, is_enough ? 0.0 : 1.0, 0.0);
    if (is_enough || adapt.value("last", false)) return;
  }
  if (name == "beta") {
    run.machine_metric("process", getpid());
    if (environment("FAKE_beta") == "fickle") run.set_uncacheable("the device failed");
    const auto size = run.param<double>("size");
    text += std::to_string(static_cast<int>(size));
    if (environment("FAKE_beta") == "moody") text += std::to_string(getpid());
    const auto unknown = GateInfo("unknown", "<=", "mm", "It is unknown.", "declare it");
    const bool undeclared = environment("FAKE_beta") == "undeclared_gate";
    run.gate(undeclared ? unknown : size_gate, size, run.param<double>("limit"));
    const auto diverge = run.param<std::string>("diverge");
    if (diverge != "no") run.set_diverged("speed passed all bounds in frame 3");
    if (diverge == "lose") return;
  }
  write_atomically(run.out(name + ".txt"), text);
  log::warn("{} is only a fake", name);
}

// Seconds as numbers that sums show: alpha 1 to 2 and 3 tets; beta as many as there are tets, to
// twice that; grow and weigh 1, grow with the tets that weigh asks for, which are 3 more until they
// are enough. The others say nothing.
Estimate estimate(const std::string& name, const StageRun& run, const Expected& before) {
  if (environment("FAKE_" + name) == "fail")
    throw Error(ExitCode::bad_input, {.where = "volume.txt", .found = "too odd"});
  Estimate found{.wall_low_s = 1.0, .wall_high_s = 1.0, .memory_mb = 10.0, .expected = before};
  if (name == "alpha") {
    found.wall_high_s = 2.0;
    found.expected.tets = 3.0;
  }
  if (name == "beta") {
    found.wall_low_s = before.tets;
    found.wall_high_s = 2.0 * before.tets;
    found.memory_mb = 20.0;
    found.words = {run.has_input("a") ? "a is there" : "a is not there yet"};
  }
  if (name == "grow") found.expected.tets = std::max(1.0, before.next_tets);
  if (name == "weigh") {
    const bool is_enough = before.tets >= run.params().at("adapt").at("lines").get<double>();
    found.expected.next_tets = is_enough ? 0.0 : before.tets + 3.0;
  }
  return found;
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
  Stage stage{.info = declare(name), .run = [&name](StageRun& run) { work(name, run); }};
  if (name == "alpha" || name == "beta" || name == "grow" || name == "weigh")
    stage.estimate = [&name](StageRun& run, const Expected& before) {
      return estimate(name, run, before);
    };
  return stage_main(argc, argv, stage);
}
