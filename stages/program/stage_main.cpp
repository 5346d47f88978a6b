#include "stages/program/stage_main.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <iostream>
#include <new>
#include <sstream>
#include <thread>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "pipeline/contract/input_digest.hpp"

namespace viscera {
namespace fs = std::filesystem;

fs::path StageRun::input(const std::string& role) const {
  const auto found = inputs_.find(role);
  if (found == inputs_.end()) {
    throw Error(ExitCode::usage, {.where = "command line",
                                  .field = "--in " + role,
                                  .found = "not given",
                                  .remedy = fmt::format("add --in {}=FILE", role)});
  }
  return found->second;
}

std::vector<fs::path> StageRun::inputs(const std::string& role) const {
  std::vector<fs::path> paths;
  const auto [begin, end] = inputs_.equal_range(role);
  for (auto it = begin; it != end; ++it) paths.push_back(it->second);
  return paths;
}

void StageRun::metric(std::string name, Json value, std::string unit) {
  metrics_.push_back({std::move(name), std::move(value), std::move(unit)});
}

void StageRun::machine_metric(std::string name, Json value, std::string unit) {
  metrics_.push_back({std::move(name), std::move(value), std::move(unit), true});
}

void StageRun::gate(const GateInfo& info, double value, double limit, GateDetails details) {
  gates_.push_back(judged(info, value, limit, std::move(details)));
}

namespace {

struct CommandLine {
  std::string verb = "run";
  std::vector<std::string> in, set;
  std::string out, scratch, expect;
  std::string log_format = "text";
  bool quiet = false;
};

std::pair<std::string, std::string> split_assignment(const std::string& text, const char* option) {
  const auto equals = text.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw Error(ExitCode::usage, {.where = "command line",
                                  .field = option,
                                  .found = fmt::format("'{}'", text),
                                  .allowed = fmt::format("{} NAME=VALUE", option)});
  }
  return {text.substr(0, equals), text.substr(equals + 1)};
}

std::multimap<std::string, fs::path> read_inputs(const StageInfo& info,
                                                 const std::vector<std::string>& in, bool needed) {
  std::multimap<std::string, fs::path> inputs;
  std::vector<std::string> roles;
  for (const auto& input : info.inputs) roles.push_back(input.role);
  for (const auto& text : in) {
    const auto [role, path] = split_assignment(text, "--in");
    const auto declared = std::find(roles.begin(), roles.end(), role);
    if (declared == roles.end()) {
      throw Error(ExitCode::usage, {.where = "command line",
                                    .field = "--in " + role,
                                    .found = "unknown input role",
                                    .remedy = suggest(role, roles)});
    }
    if (inputs.count(role) && !info.inputs[declared - roles.begin()].many) {
      throw Error(ExitCode::usage, {.where = "command line",
                                    .field = "--in " + role,
                                    .found = "given twice",
                                    .allowed = "one file for this role"});
    }
    if (!fs::exists(path)) {
      throw Error(ExitCode::bad_input, {.where = path,
                                        .field = "--in " + role,
                                        .found = "no such file or folder",
                                        .allowed = info.inputs[declared - roles.begin()].doc,
                                        .remedy = "check the path"});
    }
    if (!fs::is_regular_file(path) && !fs::is_directory(path)) {
      throw Error(ExitCode::bad_input, {.where = path,
                                        .field = "--in " + role,
                                        .found = "neither a file nor a folder",
                                        .allowed = info.inputs[declared - roles.begin()].doc,
                                        .remedy = "write the data to a file first"});
    }
    inputs.emplace(role, path);
  }
  for (const auto& input : info.inputs) {
    if (!needed || !input.required || inputs.count(input.role)) continue;
    throw Error(ExitCode::usage, {.where = "command line",
                                  .field = "--in " + input.role,
                                  .found = "missing",
                                  .allowed = input.doc,
                                  .remedy = fmt::format("add --in {}=FILE", input.role)});
  }
  return inputs;
}

// Threads beyond the machine's cores only wait for one another: 1024 of them take minutes for what
// two do in a second. Results do not depend on their number.
void limit_threads(const StageInfo& info, Json& params) {
  const unsigned cores = std::max(1u, std::thread::hardware_concurrency());
  for (const auto& param : info.params) {
    if (!is_thread_count(param) || params[param.name] <= cores) continue;
    log::warn("{}: {} were asked for, {} are used: this machine has {} cores", param.name,
              params[param.name].dump(), cores, cores);
    params[param.name] = cores;
  }
}

Json given_params(const std::vector<std::string>& set) {
  Json given = Json::object();
  for (const auto& text : set) {
    const auto [name, value] = split_assignment(text, "--set");
    if (given.contains(name)) {
      throw Error(ExitCode::usage, {.where = "command line",
                                    .field = "--set " + name,
                                    .found = "given twice",
                                    .allowed = "one value for each parameter"});
    }
    given[name] = value_from_text(value);
  }
  return given;
}

double cpu_seconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

std::multimap<std::string, FileDigest> digests_of(
    const std::multimap<std::string, fs::path>& inputs) {
  std::multimap<std::string, FileDigest> digests;
  for (const auto& [role, path] : inputs) digests.emplace(role, input_digest(path));
  return digests;
}

// A result belongs to one content of its inputs: what changed while it was read belongs to none.
void check_unchanged(const std::multimap<std::string, fs::path>& inputs,
                     const std::multimap<std::string, FileDigest>& before) {
  const auto now = digests_of(inputs);
  const auto [old, changed] = std::mismatch(
      before.begin(), before.end(), now.begin(),
      [](const auto& a, const auto& b) { return a.second.sha256 == b.second.sha256; });
  if (old == before.end()) return;
  throw Error(ExitCode::try_again, {.where = old->second.path,
                                    .field = "--in " + old->first,
                                    .found = "changed while it was read",
                                    .allowed = "a file that nobody writes to",
                                    .remedy = "run again when it is complete"});
}

// Moves the finished files from `work` to `out`. The old manifest goes first and the new one comes
// last, so that a reader never sees a manifest beside files that are not its own.
void publish(const fs::path& work, const fs::path& out, const std::vector<FileDigest>& outputs,
             const std::string& manifest) {
  const fs::path manifest_path = out / "manifest.json";
  if (fs::exists(manifest_path)) {
    const auto stale = outputs_named_by(read_file(manifest_path));
    fs::remove(manifest_path);
    for (const auto& name : stale) fs::remove(out / name);
  }
  for (const auto& file : outputs) fs::rename(work / file.path, out / file.path);
  write_atomically(manifest_path, manifest);
}

}  // namespace

StageRun read_run(const StageInfo& info, const std::vector<std::string>& in,
                  const std::vector<std::string>& set, bool inputs_needed) {
  auto inputs = read_inputs(info, in, inputs_needed);
  return make_run(info, std::move(inputs), given_params(set), "command line");
}

StageRun make_run(const StageInfo& info, std::multimap<std::string, fs::path> inputs,
                  const Json& params, const std::string& where) {
  Json resolved = resolve(info.params, params, where);
  limit_threads(info, resolved);
  return {std::move(resolved), std::move(inputs), {}};
}

namespace {

// The names of the gates that failed, each of which is told.
std::vector<std::string> failed_gates(const StageInfo& info, const std::vector<Gate>& gates) {
  std::vector<std::string> failed;
  for (const auto& gate : gates) {
    if (!is_declared(gate, info.gates)) {
      throw Error(ExitCode::internal, {.where = "gate " + gate.name,
                                       .found = "judged by the stage but not declared by it"});
    }
    if (gate.passed()) continue;
    failed.push_back(gate.name);
    log::error("{}", failure_message(gate));
  }
  return failed;
}

// The declared outputs that the stage wrote, in declared order; anything else is a defect.
std::vector<FileDigest> written(const StageInfo& info, const fs::path& work) {
  std::vector<FileDigest> files;
  for (const auto& output : info.outputs) {
    if (fs::exists(work / output.file)) {
      const fs::path file = work / output.file;
      files.push_back({output.file, sha256_file(file), fs::file_size(file)});
    }
  }
  for (const auto& entry : fs::directory_iterator(work)) {
    const auto name = entry.path().filename().string();
    const bool known = std::any_of(files.begin(), files.end(),
                                   [&name](const FileDigest& f) { return f.path == name; });
    if (!known) {
      throw Error(ExitCode::internal,
                  {.where = name, .found = "written by the stage but not declared by it"});
    }
  }
  return files;
}

}  // namespace

Manifest manifest_of(const StageInfo& info, const StageRun& run) {
  Manifest manifest{.stage = info.name, .version = info.version};
  for (const auto& param : info.params) {
    if (param.type == ParamType::real) manifest.param_units[param.name] = param.unit;
  }
  manifest.exit = run.exit_;
  manifest.message = run.message_;
  manifest.metrics = run.metrics_;
  manifest.gates = run.gates_;
  manifest.caveats = run.caveats_;
  manifest.libraries = info.libraries;
  manifest.device = run.device_;
  manifest.uncacheable = run.uncacheable_;
  return manifest;
}

Finished run_stage(const Stage& stage, StageRun run, const fs::path& out, const fs::path& scratch) {
  const auto wall_begin = std::chrono::steady_clock::now();
  const std::string started =
      fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::chrono::system_clock::now()));
  if (stage.check) stage.check(run);
  const TemporaryFolder work(out);  // a refused input or param makes no folder
  run.out_ = work.path();
  run.scratch_ = scratch;
  const Json params = run.params();  // a stage may find values of its own
  const auto inputs = digests_of(run.inputs_);
  stage.run(run);
  check_unchanged(run.inputs_, inputs);
  log::check_interrupt();

  Manifest manifest = manifest_of(stage.info, run);
  manifest.params = params;
  manifest.inputs = inputs;
  const std::vector<std::string> failed = failed_gates(stage.info, manifest.gates);
  for (const auto& caveat : manifest.caveats) log::warn("{}", caveat);
  if (manifest.exit == ExitCode::ok && !failed.empty()) {
    manifest.exit = ExitCode::gate_failed;
    manifest.message = fmt::format("gates failed: {}", fmt::join(failed, ", "));
  }
  if (manifest.exit == ExitCode::diverged) log::error("{}", manifest.message);
  manifest.outputs = written(stage.info, work.path());
  manifest.started = started;
  manifest.wall_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - wall_begin).count();
  manifest.cpu_s = cpu_seconds();
  manifest.max_rss_mb = used_mb();
  publish(work.path(), out, manifest.outputs, to_json(manifest).dump(1) + "\n");
  return {manifest.exit, failed, manifest.wall_s};
}

class StageProgram {
 public:
  explicit StageProgram(const Stage& stage) : stage_(stage) {}

  ExitCode run(const CommandLine& line) {
    if (line.out.empty()) {
      throw Error(ExitCode::usage, {.where = "command line",
                                    .field = "--out",
                                    .found = "missing",
                                    .remedy = "add --out DIR"});
    }
    const Finished finished =
        run_stage(stage_, read_run(stage_.info, line.in, line.set), line.out, line.scratch);
    std::cout << Json{{"stage", stage_.info.name},
                      {"exit", static_cast<int>(finished.exit)},
                      {"out", line.out},
                      {"gates_failed", finished.gates_failed},
                      {"wall_s", finished.wall_s}}
              << std::endl;
    return finished.exit;
  }

  ExitCode check(const CommandLine& line) {
    const StageRun run = read_run(stage_.info, line.in, line.set);
    if (stage_.check) stage_.check(run);
    std::cout << Json{{"stage", stage_.info.name}, {"exit", 0}, {"params", run.params()}}
              << std::endl;
    return ExitCode::ok;
  }

  ExitCode estimate(const CommandLine& line) {
    Json said{{"stage", stage_.info.name}};
    if (stage_.estimate) {
      log::set_level(log::Level::warn);  // what it tries is nobody's progress
      StageRun run = read_run(stage_.info, line.in, line.set, false);
      Estimate found = stage_.estimate(run, expected_from(line.expect));
      if (found.memory_mb <= 0.0) found.memory_mb = used_mb();
      said.update(to_json(found));
    }
    std::cout << said << std::endl;
    return ExitCode::ok;
  }

 private:
  const Stage& stage_;
};

namespace {

// The command line, in CLI11's order (the last first), with what `--arguments FILE` stands for.
std::vector<std::string> arguments_of(int argc, char** argv) {
  std::vector<std::string> all;
  for (int i = 1; i < argc; ++i) {
    if (std::string_view(argv[i]) != "--arguments" || i + 1 == argc) {
      all.push_back(argv[i]);
      continue;
    }
    std::istringstream bytes(read_file(argv[++i]));
    for (std::string one; std::getline(bytes, one, '\0');) all.push_back(one);
  }
  std::ranges::reverse(all);
  return all;
}

}  // namespace

int stage_main(int argc, char** argv, const Stage& stage) {
  const auto& info = stage.info;
  log::set_name(info.name);
  log::catch_interrupts();
  CommandLine line;
  CLI::App app(info.doc, "viscera-" + info.name);
  app.add_option("verb", line.verb, "run (default), check, estimate or describe")
      ->check(CLI::IsMember({"run", "check", "estimate", "describe"}));
  app.add_option("--in", line.in, "ROLE=FILE, repeatable")->allow_extra_args(false);
  app.add_option("--set", line.set, "PARAM=VALUE, repeatable")->allow_extra_args(false);
  app.add_option("--out", line.out, "folder for the outputs");
  app.add_option("--scratch", line.scratch,
                 "folder that an interrupted run leaves for an equal one to go on from");
  app.add_option("--expect", line.expect,
                 "estimate: what earlier stages are expected to make, as their estimates say it");
  app.add_option("--log", line.log_format, "text or json lines on stderr")
      ->check(CLI::IsMember({"text", "json"}));
  app.add_flag("--quiet", line.quiet, "warnings and errors only");
  std::string more;
  app.add_option("--arguments", more,
                 "file of more arguments, each ended by a zero byte: any number of any length");
  std::string footer = "Inputs:\n";
  for (const auto& input : info.inputs) {
    footer +=
        fmt::format("  {}{}  {}\n", input.role, input.required ? "" : " (optional)", input.doc);
  }
  footer += "Params:\n";
  for (const auto& param : info.params) {
    const std::string shown = param.fallback.is_null() ? "unset" : param.fallback.dump();
    footer += fmt::format("  {} = {}  {}\n", param.name, shown, param.doc);
  }
  if (!info.gates.empty()) footer += "Gates:\n";
  for (const auto& gate : info.gates) footer += fmt::format("  {}  {}\n", gate.name, gate.meaning);
  app.footer(footer);
  std::vector<std::string> arguments;
  const int unread = guarded([&] {
    arguments = arguments_of(argc, argv);
    return ExitCode::ok;
  });
  if (unread != 0) return unread;
  try {
    app.parse(std::move(arguments));
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : static_cast<int>(ExitCode::usage);
  }
  if (line.log_format == "json") log::set_format(log::Format::json);
  if (line.quiet) log::set_level(log::Level::warn);
  return guarded([&] {
    StageProgram program(stage);
    if (line.verb == "describe") {
      std::cout << to_json(info) << std::endl;
      return ExitCode::ok;
    }
    if (line.verb == "estimate") return program.estimate(line);
    return line.verb == "check" ? program.check(line) : program.run(line);
  });
}

double used_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

int guarded(const std::function<ExitCode()>& work) {
  try {
    return static_cast<int>(work());
  } catch (const Error& e) {
    log::error("{}", e.what());
    return static_cast<int>(e.code());
  } catch (const std::bad_alloc&) {
    log::error("out of memory\n  remedy:  a coarser setting, or a machine with more memory");
    return static_cast<int>(ExitCode::try_again);
  } catch (const fs::filesystem_error& e) {
    log::error("{}\n  remedy:  check the folder's permissions and free space", e.what());
    return static_cast<int>(ExitCode::usage);
  } catch (const std::exception& e) {
    log::error("internal error: {}", e.what());
    return static_cast<int>(ExitCode::internal);
  }
}

}  // namespace viscera
