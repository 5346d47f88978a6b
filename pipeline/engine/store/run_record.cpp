#include "pipeline/engine/store/run_record.hpp"

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/json_value.hpp"

namespace viscera::engine {
namespace {

template <class Map>
auto value_or_null(const Map& map, const std::string& key) {
  const auto found = map.find(key);
  return found == map.end() ? nullptr : &found->second;
}

}  // namespace

RunRecord::RunRecord(std::filesystem::path file) : file_(std::move(file)) {
  if (!std::filesystem::is_regular_file(file_)) return;
  const JsonText json = read_json(file_);
  try {
    if (const auto planned = json.root().find("planned")) planned_ = planned->texts();
    for (const auto& [stage, record] : json.root()["stages"].members()) {
      Finished& finished = finished_[stage];
      finished = {record["key"].text(), record["transcript"].text(), record["wall_s"].number(), {}};
      if (const auto origins = record.find("origins")) finished.origins = origins->texts_by_name();
    }
    if (const auto failures = json.root().find("failures")) {
      for (const auto& [stage, record] : failures->members()) {
        failures_[stage] = {static_cast<ExitCode>(record["exit"].whole<int>()),
                            record["message"].text()};
      }
    }
  } catch (const Error&) {  // a damaged record is as good as none
    planned_.clear();
    finished_.clear();
    failures_.clear();
  }
}

const RunRecord::Finished* RunRecord::finished(const std::string& stage) const {
  return value_or_null(finished_, stage);
}

const RunRecord::Failure* RunRecord::failure(const std::string& stage) const {
  return value_or_null(failures_, stage);
}

void RunRecord::set_planned(std::vector<std::string> stages) {
  changed_ = changed_ || planned_ != stages;
  planned_ = std::move(stages);
}

void RunRecord::set(const std::string& stage, Finished finished) {
  Finished& known = finished_[stage];
  const bool same = known == finished;
  if (failures_.erase(stage) == 0 && same) return;
  known = std::move(finished);
  changed_ = true;
}

void RunRecord::set_failure(const std::string& stage, Failure failure) {
  failures_[stage] = std::move(failure);
  changed_ = true;
}

std::string RunRecord::text() const {
  Json json{{"schema", 1}, {"planned", planned_}, {"stages", Json::object()}};
  for (const auto& [stage, record] : finished_) {
    json["stages"][stage] = {{"key", record.key},
                             {"transcript", record.transcript},
                             {"wall_s", record.wall_s},
                             {"origins", record.origins}};
  }
  for (const auto& [stage, failure] : failures_) {
    json["failures"][stage] = {{"exit", static_cast<int>(failure.exit)},
                               {"message", failure.message}};
  }
  return document_of(json);
}

void RunRecord::save() {
  if (changed_) write_atomically(file_, text());
  changed_ = false;
}

}  // namespace viscera::engine
