// viscera-live SCENE --in mesh=FILE [--set PARAM=VALUE] [--headless FRAMES]: a body to take in the
// hand. Inputs and params are those of viscera-simulate; the window shows and says the rest.
#include <dlfcn.h>
#include <malloc.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "stages/live/readout.hpp"
#include "stages/live/window_library.hpp"
#include "stages/simulate/stage.hpp"

namespace viscera::live {
namespace {

struct CommandLine {
  std::string scene, trajectory, input_log, force_log, replay, second;
  std::vector<std::string> in, set;
  std::uint64_t headless = 0;
  std::optional<unsigned> random;
  bool quiet = false;
};

StageRun run_of(const CommandLine& line) {
  auto in = line.in;
  in.push_back("scene=" + line.scene);
  return read_run(simulate_stage().info, in, line.set);
}

// What is allocated now, by all threads. The pages that are resident would also tell what the
// system takes away of those that were not touched for a while.
double memory_mb() {
  const struct mallinfo2 heap = mallinfo2();
  return static_cast<double>(heap.uordblks + heap.hblkhd) / (1 << 20);
}

SessionOptions options_of(const CommandLine& line, const World& world) {
  SessionOptions options{.frames = line.headless,
                         .trajectory = line.trajectory,
                         .input_log = line.input_log,
                         .force_log = line.force_log};
  if (!line.replay.empty()) options.input = std::make_unique<Replay>(line.replay, world);
  if (line.random) options.input = std::make_unique<RandomInput>(*line.random, world);
  return options;
}

ExitCode run_headless(const CommandLine& line) {
  auto world = std::make_unique<World>(run_of(line));
  SessionOptions options = options_of(line, *world);
  options.stops_when_diverged = true;
  Session session(std::move(world), std::move(options));
  Reader reader(session);
  double early_peak = 0.0, last_peak = 0.0;  // of the memory in the second and last tenth, MB
  for (int glance = 1; !session.wait_for(0.05); ++glance) {
    log::check_interrupt();
    const std::uint64_t frames = session.frames(), tenth = 10 * frames / line.headless;
    if (tenth == 1) early_peak = std::max(early_peak, memory_mb());
    if (tenth == 9) last_peak = std::max(last_peak, memory_mb());
    log::progress("live", static_cast<double>(frames) / static_cast<double>(line.headless));
    // As often as a window's readout: on a device the state is looked at and checked at this only.
    if (glance % 10 == 0) session.look();
  }
  session.close();
  const Snapshot& last = session.look();
  Json json = to_json(reader.read(last));
  json["state_hash"] = fmt::format("{:016x}", last.state.hash());
  json["memory_MB"] = {{"peak_in_second_tenth", early_peak}, {"peak_in_last_tenth", last_peak}};
  log::clear_progress();
  std::cout << json.dump(1) << std::endl;
  return last.diverged ? ExitCode::diverged : ExitCode::ok;
}

// The run of the second session: the same inputs and params but for the method. What the source
// paper's PBD solves are springs and volumes, and its finite elements take a step a frame, as
// configs/paper.yaml has them.
StageRun second_run_of(CommandLine line, const std::string& method) {
  line.set.push_back("solver=" + method);
  if (method == "fem") {
    line.set.insert(line.set.end(),
                    {"substeps=1", "fem_tolerance=1e-3", "fem_time=implicit_euler"});
  }
  StageRun run = run_of(line);
  if (method == "pbd") {
    Json change = run.params().at("change");
    change.update({{"effects.neo_hookean", "off"},
                   {"effects.distance", Json::object()},
                   {"effects.volume", Json::object()}});
    run.set_param("change", change);
  }
  return run;
}

// The window's library lies beside the program's folder.
const WindowLibrary& load_window() {
  const auto path = std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path() /
                    "lib" / "libviscera_live_window.so";
  void* const library = dlopen(path.c_str(), RTLD_NOW | RTLD_GLOBAL);
  void* const window = library ? dlsym(library, "viscera_live_window") : nullptr;
  if (window) return *static_cast<const WindowLibrary*>(window);
  throw Error(ExitCode::device_unavailable, {.where = path.string(),
                                             .found = dlerror(),
                                             .allowed = "the window's library and VTK's",
                                             .remedy = "run without a window: --headless 600"});
}

ExitCode run_window(const CommandLine& line) {
  const WindowLibrary& window = load_window();
  window.require_display();
  StageRun run = run_of(line);
  const auto method = run.param<std::string>("solver");
  auto world = std::make_unique<World>(std::move(run));
  SessionOptions options = options_of(line, *world);
  options.paced = true;
  Session session(std::move(world), std::move(options));
  std::vector<Shown> shown = {{session, method}};
  std::optional<Session> second;
  if (!line.second.empty()) {
    second.emplace(std::make_unique<World>(second_run_of(line, line.second)),
                   SessionOptions{.paced = true});
    shown.push_back({*second, line.second});
  }
  window.show(shown);
  if (second) second->close();
  session.close();
  log::check_interrupt();
  return ExitCode::ok;
}

int main(int argc, char** argv) {
  log::set_name("live");
  log::catch_interrupts();
  CommandLine line;
  CLI::App app("A soft body to take in the hand: pull, press, change its stiffness, drop it again",
               "viscera-live");
  app.add_option("SCENE", line.scene, "scene.yaml")->required();
  app.add_option("--in", line.in, "ROLE=FILE, repeatable: mesh, perhaps stiffness, checkpoint")
      ->allow_extra_args(false);
  app.add_option("--set", line.set, "PARAM=VALUE of viscera-simulate, repeatable")
      ->allow_extra_args(false);
  app.add_option("--headless", line.headless,
                 "simulate so many frames without a window and print the readout as JSON")
      ->check(CLI::PositiveNumber);
  app.add_option("--record", line.trajectory, "folder for a trajectory that viscera-report reads");
  app.add_option("--log-input", line.input_log, "file to record what the hand does into");
  app.add_option(
      "--log-force", line.force_log,
      "table to write what the hand pulls with, and how late that is, after every frame");
  auto* replay = app.add_option("--replay", line.replay, "do what such a file says");
  app.add_option("--random", line.random, "do what chance says, from this seed")->excludes(replay);
  app.add_option("--second", line.second, "another method, drawn over the first")
      ->check(CLI::IsMember({"xpbd", "pbd", "fem", "tled"}));
  app.add_flag("--quiet", line.quiet, "warnings and errors only");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : static_cast<int>(ExitCode::usage);
  }
  if (line.quiet) log::set_level(log::Level::warn);
  return guarded([&] { return line.headless > 0 ? run_headless(line) : run_window(line); });
}

}  // namespace
}  // namespace viscera::live

int main(int argc, char** argv) {
  return viscera::live::main(argc, argv);
}
