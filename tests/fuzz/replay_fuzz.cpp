// A log of what a hand has done (viscera-live --replay) under libFuzzer: the log is read or
// refused, each of its commands is taken or refused, and the body goes on being simulated. The
// bytes are read twice: as they are, and as the lines below the header that belongs to the body.
#include "pipeline/base/log.hpp"
#include "sim/solvers/solver.hpp"
#include "stages/live/input.hpp"
#include "stages/simulate/stage.hpp"
#include "tests/fuzz/fuzz_file.hpp"
#include "tests/simulate/cube.hpp"

namespace {

using namespace viscera;
using namespace viscera::live;

constexpr std::uint64_t frames = 8;  // that are simulated; what is asked later comes at once
constexpr int max_substeps = 64;     // a frame; a log may ask for a million

constexpr const char* scene = R"(scene: 1
materials:
  liver: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3, damping: 20 ms}
effects:
  neo_hookean:
  gravity:
  ground: {clearance: 5 mm, friction: 0.3}
  viscosity:
time: {frame_rate: 60 Hz, substeps: 8}
)";

// A cube of 48 tets.
World& world() {
  static World world = [] {
    log::set_level(log::Level::error);
    const auto mesh = fuzz::folder() / "mesh.vtu", file = fuzz::folder() / "scene.yaml";
    write_cube(mesh, 2);
    write_atomically(file, scene);
    return World(read_run(simulate_stage().info,
                          {"mesh=" + mesh.string(), "scene=" + file.string()},
                          {"device=cpu", "threads=1"}));
  }();
  return world;
}

void take(const std::vector<Command>& commands) {
  for (const Command& command : commands) fuzz::may_refuse([&] { world().apply(command); });
}

void follow(Replay& replay) {
  for (std::uint64_t frame = 0; frame < frames; ++frame) {
    take(replay.before(frame));
    if (world().setting()->scene.time.substeps > max_substeps) break;
    try {
      world().advance();
    } catch (const sim::Diverged&) {
      take({Drop{}});
    }
  }
  take(replay.before(~std::uint64_t{0}));
  take({Reset{}});
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  fuzz::may_refuse([&] { Replay(fuzz::as_file("input.jsonl", bytes, size), world()); });
  static const std::string header = [] {
    const auto path = fuzz::folder() / "header.jsonl";
    InputLog(path, world());
    return read_file(path);
  }();
  const std::string log = header + std::string(reinterpret_cast<const char*>(bytes), size);
  fuzz::may_refuse([&log] {
    const auto* begin = reinterpret_cast<const std::uint8_t*>(log.data());
    Replay replay(fuzz::as_file("input.jsonl", begin, log.size()), world());
    follow(replay);
  });
  return 0;
}
