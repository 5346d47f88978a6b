#include "stages/live/input.hpp"

#include <fmt/format.h>

#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "stages/simulate/body.hpp"

namespace viscera::live {
namespace {

constexpr int schema = 1;

Json header_of(const World& world) {
  return {{"viscera_live_input", schema},
          {"tets", world.body().tet_count()},
          {"vertices", world.body().vertex_count()}};
}

void check_header(const std::string& line, const World& world, const std::string& where) {
  const JsonText found(line, where);
  const Json needed = header_of(world);
  if (found.root().object() == needed) return;
  throw Error(ExitCode::bad_input, {.where = where,
                                    .field = "header",
                                    .found = found.root().raw().dump(),
                                    .allowed = needed.dump() + ", as the mesh has it",
                                    .remedy = "replay it on the mesh that it was recorded on"});
}

}  // namespace

InputLog::InputLog(const std::filesystem::path& path, const World& world)
    : path_(path), file_(path) {
  file_ << header_of(world) << std::endl;
  if (file_) return;
  throw Error(ExitCode::usage, {.where = path_.string(),
                                .field = "--log-input",
                                .found = "cannot be written",
                                .remedy = "check the folder and the free space"});
}

void InputLog::add(std::uint64_t frame, const Command& command) {
  Json line = {{"frame", frame}};
  line.update(to_json(command));
  file_ << line << std::endl;
}

Replay::Replay(const std::filesystem::path& path, const World& world) {
  std::ifstream file;
  if (std::filesystem::is_regular_file(path)) file.open(path);  // a device may never end
  const auto where = [&path](int number) { return fmt::format("{}:{}", path.string(), number); };
  std::string line;
  if (!std::getline(file, line)) {
    throw Error(ExitCode::bad_input, {.where = path.string(),
                                      .field = "--replay",
                                      .found = "missing, empty or no file",
                                      .allowed = "input that viscera-live recorded (--log-input)"});
  }
  check_header(line, world, where(1));
  std::uint64_t last = 0;
  for (int number = 2; std::getline(file, line); ++number) {
    const JsonText json(line, where(number));
    const JsonValue root = json.root(), frame = root["frame"];
    if (frame.whole<std::uint64_t>() < last) {
      throw frame.refused(fmt::format("a number from {} on", last));
    }
    last = frame.whole<std::uint64_t>();
    left_.emplace_back(last, command_from_json(root));
  }
}

std::vector<Command> Replay::before(std::uint64_t frames) {
  std::vector<Command> commands;
  for (; !left_.empty() && left_.front().first <= frames; left_.pop_front()) {
    commands.push_back(left_.front().second);
  }
  return commands;
}

RandomInput::RandomInput(unsigned seed, const World& world)
    : generator_(seed),
      vertices_(static_cast<int>(world.body().vertex_count())),
      center_mm_(m_to_mm * world.body().origin),
      size_mm_(m_to_mm * world.body().size()),
      materials_(world.body().label_names) {}

std::vector<Command> RandomInput::before(std::uint64_t) {
  std::vector<Command> commands;
  const double chance = in(0.0, 1.0);
  if (holds_ && chance < 0.5) {
    commands.push_back(Drag{within(0.3 * size_mm_)});
  } else if (chance < 0.52) {
    commands.push_back(Grab{static_cast<int>(in(0.0, 0.999) * vertices_)});
    holds_ = true;
  } else if (chance < 0.53) {
    commands.push_back(Release{});
    holds_ = false;
  } else if (has_tool_ && chance < 0.7) {
    tool_ = center_mm_ + within(0.8 * size_mm_);
    commands.push_back(MoveTool{tool_});
  } else if (chance < 0.71) {
    commands.push_back(has_tool_ ? Command(LiftTool{})
                                 : Command(MoveTool{center_mm_ + Point{0, 0, size_mm_}}));
    has_tool_ = !has_tool_;
  } else if (chance < 0.75) {
    commands.push_back(change());
  } else if (chance < 0.753) {
    commands.push_back(Drop{});
  } else if (chance < 0.755) {
    commands.push_back(Reset{});
  }
  if (!commands.empty() && commands.back().index() >= Command(Drop{}).index()) {
    holds_ = has_tool_ = false;
  }
  return commands;
}

double RandomInput::in(double lo, double hi) {
  // Not std::uniform_real_distribution, whose numbers are a library's own.
  return lo + (hi - lo) * static_cast<double>(generator_()) * 0x1p-32;
}

Point RandomInput::within(double mm) {
  const double x = in(-mm, mm), y = in(-mm, mm);
  return {x, y, in(-mm, mm)};
}

Command RandomInput::change() {
  const std::string material =
      "materials." +
      materials_[static_cast<std::size_t>(in(0.0, 0.999) * static_cast<double>(materials_.size()))];
  const double chance = in(0.0, 1.0);
  if (chance < 0.6) return Change{{{material + ".E", fmt::format("{} kPa", in(0.5, 20.0))}}};
  if (chance < 0.9) return Change{{{material + ".nu", in(0.2, 0.48)}}};
  return Change{{{material + ".nu", in(0.5, 5.0)}}};  // refused
}

}  // namespace viscera::live
