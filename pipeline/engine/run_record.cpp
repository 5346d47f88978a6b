#include "pipeline/engine/run_record.hpp"

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/digest.hpp"
#include "pipeline/contract/param.hpp"

namespace viscera {

RunRecord::RunRecord(std::filesystem::path file) : file_(std::move(file)) {
  if (!std::filesystem::is_regular_file(file_)) return;
  saved_ = read_file(file_);
  const Json json = Json::parse(saved_, nullptr, false);
  try {
    for (const auto& [stage, record] : json.at("stages").items()) {
      transcripts_[stage] = record.at("transcript");
    }
  } catch (const Json::exception&) {
    transcripts_.clear();
  }
}

const std::string* RunRecord::transcript(const std::string& stage) const {
  const auto found = transcripts_.find(stage);
  return found == transcripts_.end() ? nullptr : &found->second;
}

void RunRecord::set(const std::string& stage, const std::string& transcript) {
  transcripts_[stage] = transcript;
}

std::string RunRecord::text() const {
  Json json{{"schema", 1}, {"stages", Json::object()}};
  for (const auto& [stage, transcript] : transcripts_) {
    json["stages"][stage] = {{"key", sha256(transcript)}, {"transcript", transcript}};
  }
  return json.dump(1) + "\n";
}

void RunRecord::save() const {
  const std::string now = text();
  if (now != saved_) write_atomically(file_, now);
}

}  // namespace viscera
