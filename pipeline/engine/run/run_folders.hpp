// The folders that a run lays its results out in. One run at a time writes to a folder: two may
// work on two cases of a spec side by side.
#pragma once

#include <map>
#include <memory>

#include "pipeline/engine/plan/feed.hpp"
#include "pipeline/engine/store/run_record.hpp"

namespace viscera::engine {

class RunFolders {
 public:
  RunFolders(const Plan& plan, std::filesystem::path out);

  std::filesystem::path of(std::size_t stage) const;
  // The last stage of its folder: its outputs also lie in the folder itself.
  bool is_last(std::size_t stage) const;

  bool may_open(std::size_t stage) const;  // not more at once than files may be open
  // False while another run holds it, which `held_by` then names.
  bool open(std::size_t stage, std::string& held_by);
  bool is_open(std::size_t stage) const { return open_.count(of(stage)) > 0; }
  void leave(std::size_t stage);  // the stage is settled; after its folder's last one it is closed

  // What is known of the folder's earlier runs, open or not.
  const RunRecord& record(std::size_t stage);

  // Open folders only:
  void lay_out(std::size_t stage, const Entry& entry, Store& store, const std::string& transcript);
  void note_failure(std::size_t stage, RunRecord::Failure failure);

  // Of the stages that are not settled, as long as each took when it was last made there.
  double seconds_left(const std::vector<bool>& settled) const;

 private:
  std::vector<std::string> stages_beside(std::size_t stage) const;  // of its folder, in order

  struct Open {
    std::unique_ptr<FileLock> lock;
    RunRecord record;
  };

  const Plan& plan_;
  std::filesystem::path out_;
  std::map<std::filesystem::path, std::size_t> unsettled_;
  std::map<std::filesystem::path, Open> open_;
  std::map<std::string, std::pair<double, int>> timed_;  // by stage: seconds in all, how often
  std::filesystem::path read_;                           // of the record that was read last
  std::optional<RunRecord> read_record_;
};

}  // namespace viscera::engine
