// out/NAME/run.json: the key and transcript of every stage as it was last finished there, with
// which the next run says what has changed.
#pragma once

#include <filesystem>
#include <map>
#include <string>

namespace viscera {

class RunRecord {
 public:
  explicit RunRecord(std::filesystem::path file);  // a missing or damaged file: no stage known

  const std::string* transcript(const std::string& stage) const;  // null: not finished before
  void set(const std::string& stage, const std::string& transcript);
  void save() const;  // leaves a file alone that says the same

 private:
  std::string text() const;

  std::filesystem::path file_;
  std::map<std::string, std::string> transcripts_;
  std::string saved_;
};

}  // namespace viscera
