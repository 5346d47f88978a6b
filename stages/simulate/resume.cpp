#include "stages/simulate/resume.hpp"

#include <fmt/format.h>

#include <charconv>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/base/log.hpp"
#include "stages/simulate/files/checkpoint.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

constexpr auto between_saves = std::chrono::seconds(10);
constexpr const char* positions_name = "positions.f32";

Json to_json(const ComputedFrame& f) {
  const auto& d = f.now;
  Json forces = Json::array(), probes = Json::array();
  for (const auto& [force, moment] : f.forces) {
    forces.push_back({force.x, force.y, force.z, moment.x, moment.y, moment.z});
  }
  for (const auto& u : f.probes) probes.push_back({u.x, u.y, u.z});
  return {f.index,     f.time_s,           d.kinetic,  d.elastic,    d.gravity,
          d.volume,    d.volume_ratio,     d.min_j,    d.inverted,   d.max_speed,
          d.rms_speed, d.max_displacement, f.contacts, f.state_hash, f.step_ms,
          forces,      f.handed_on,        probes,     f.gaps};
}

ComputedFrame frame_from(const JsonValue& json) {
  ComputedFrame f;
  auto& d = f.now;
  std::size_t i = 0;
  const auto read = [&]<class Value>(Value& value) {
    const JsonValue one = json[i++];
    if constexpr (std::integral<Value>) {
      value = one.whole<Value>();
    } else {
      value = one.number();
    }
  };
  read(f.index), read(f.time_s), read(d.kinetic), read(d.elastic), read(d.gravity), read(d.volume);
  read(d.volume_ratio), read(d.min_j), read(d.inverted), read(d.max_speed), read(d.rms_speed);
  read(d.max_displacement), read(f.contacts), read(f.state_hash), read(f.step_ms);
  const auto vector = [](const JsonValue& of, std::size_t k) {
    return sim::Vec3<double>{of[k].number(), of[k + 1].number(), of[k + 2].number()};
  };
  for (const auto& of : json[i++].items()) f.forces.push_back({vector(of, 0), vector(of, 3)});
  read(f.handed_on);
  for (const auto& of : json[i++].items()) f.probes.push_back(vector(of, 0));
  for (const auto& of : json[i].items()) f.gaps.push_back(of.number());
  return f;
}

}  // namespace

Resume::Resume(const StageRun& run, std::size_t vertices, const sim::TimeGrid& time)
    : folder_(run.scratch()), params_(run.params().dump()), vertices_(vertices), time_(time) {
  if (!folder_.empty()) fs::create_directories(folder_);
}

fs::path Resume::file(const char* what, std::size_t frames, const char* kind) const {
  return folder_ / fmt::format("{}-{}.{}", what, frames, kind);
}

Outcome Resume::read(std::size_t frames) const {
  const JsonText json = read_json(file("course", frames, "json"));
  const JsonValue course = json.root();
  if (course["params"].text() != params_) {
    throw Error(ExitCode::bad_input, {.where = folder_.string(), .found = "another run's"});
  }
  Outcome outcome;
  outcome.contact_time_s = course["contact_time"].number();
  outcome.rested = course["rested"].flag();
  const JsonValue watched = course["watch"];
  std::size_t w = 0;
  auto& watch = outcome.watch;
  for (double* value : {&watch.least, &watch.motion, &watch.work, &watch.displacement})
    *value = watched[w++].number();
  watch.begun = watched[w].flag();
  for (std::size_t i = 0; i < outcome.rest.since_s.size(); ++i)
    outcome.rest.since_s[i] = course["rest_since"][i].number();
  if (const auto found = course.find("imbalance")) {
    const JsonValue& pair = *found;
    outcome.rest.imbalance = {.residual = pair[0].number(), .loads = pair[1].number()};
  }
  for (const auto& tet : course["most_inverted"].items()) {
    outcome.most_inverted.emplace_back(tet[0].number(), tet[1].whole<std::size_t>());
  }
  for (const auto& frame : course["frames"].items()) outcome.frames.push_back(frame_from(frame));
  outcome.last = read_checkpoint(file("last", frames, "h5"), vertices_, time_);
  if (fs::exists(file("before", frames, "h5"))) {
    outcome.before = read_checkpoint(file("before", frames, "h5"), vertices_, time_);
  }
  outcome.most_deformed = read_checkpoint(file("most", frames, "h5"), vertices_, time_);
  const auto bytes = frames * 3 * vertices_ * sizeof(float);
  if (outcome.frames.size() != frames || fs::file_size(folder_ / positions_name) < bytes) {
    throw Error(ExitCode::bad_input, {.where = folder_.string(), .found = "fewer frames"});
  }
  return outcome;
}

std::optional<Outcome> Resume::find() {
  if (folder_.empty()) return std::nullopt;
  std::optional<Outcome> found;
  try {
    if (fs::exists(folder_ / "current")) {
      std::size_t frames = 0;
      const std::string text = read_file(folder_ / "current");
      std::from_chars(text.data(), text.data() + text.size(), frames);
      found = read(frames);
      saved_frames_ = frames;
      fs::resize_file(folder_ / positions_name, frames * 3 * vertices_ * sizeof(float));
    }
  } catch (const std::exception& e) {  // of ours, of JSON, of the file system
    log::warn("starts anew: what an earlier run left cannot be used ({})", e.what());
    found.reset();
    saved_frames_ = 0;
  }
  const auto mode = found ? std::ios::app : std::ios::trunc;
  positions_.open(folder_ / positions_name, std::ios::binary | std::ios::out | mode);
  return found;
}

std::vector<float> Resume::positions(std::size_t frame) const {
  std::vector<float> values(3 * vertices_);
  const auto bytes = static_cast<std::streamsize>(values.size() * sizeof(float));
  std::ifstream input(folder_ / positions_name, std::ios::binary);
  input.seekg(static_cast<std::streamoff>(frame) * bytes);
  input.read(reinterpret_cast<char*>(values.data()), bytes);
  return values;
}

void Resume::add(std::span<const float> positions_mm) {
  if (folder_.empty()) return;
  positions_.write(reinterpret_cast<const char*>(positions_mm.data()),
                   static_cast<std::streamsize>(positions_mm.size_bytes()));
}

void Resume::note(const Outcome& outcome) {
  if (folder_.empty()) return;
  const auto now = std::chrono::steady_clock::now();
  if (now - saved_ < between_saves && !log::interrupted()) return;
  save(outcome);
  saved_ = now;
}

void Resume::save(const Outcome& outcome) {
  const std::size_t frames = outcome.frames.size();
  positions_.flush();
  if (!positions_) {
    throw Error(ExitCode::usage, {.where = (folder_ / positions_name).string(),
                                  .found = "cannot be written",
                                  .remedy = "check the free space"});
  }
  write_checkpoint(file("last", frames, "h5"), outcome.last, time_.substep_s());
  if (!outcome.before.u.empty()) {
    write_checkpoint(file("before", frames, "h5"), outcome.before, time_.substep_s());
  }
  write_checkpoint(file("most", frames, "h5"), outcome.most_deformed, time_.substep_s());
  Json course{{"params", params_},        {"contact_time", outcome.contact_time_s},
              {"rested", outcome.rested}, {"rest_since", outcome.rest.since_s},
              {"imbalance", nullptr},     {"most_inverted", outcome.most_inverted},
              {"frames", Json::array()}};
  const auto& watch = outcome.watch;
  course["watch"] = {watch.least, watch.motion, watch.work, watch.displacement, watch.begun};
  if (const auto& found = outcome.rest.imbalance) {
    course["imbalance"] = {found->residual, found->loads};
  }
  for (const auto& frame : outcome.frames) course["frames"].push_back(to_json(frame));
  write_atomically(file("course", frames, "json"), course.dump());
  write_atomically(folder_ / "current", std::to_string(frames));
  if (saved_frames_ != 0 && saved_frames_ != frames) {
    std::error_code ignored;
    for (const auto& [what, kind] :
         {std::pair("last", "h5"), {"before", "h5"}, {"most", "h5"}, {"course", "json"}})
      fs::remove(file(what, saved_frames_, kind), ignored);
  }
  saved_frames_ = frames;
}

}  // namespace viscera
