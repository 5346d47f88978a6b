// The runs that a comparison is made of: each trajectory with what its stage wrote beside it.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "pipeline/base/param.hpp"
#include "stages/trajectory/trajectory_io.hpp"

namespace viscera {

struct ComparedRun {
  std::string name;
  Json manifest, scene;
  Json series;  // {column: [numbers]} of metrics.csv
  std::shared_ptr<const TrajectoryReader> trajectory;

  // Of the manifest; none where it is absent, or not a number, or not a text.
  std::optional<double> metric(const std::string& name) const;
  std::optional<std::string> text_metric(const std::string& name) const;
  std::string param(const std::string& name) const;       // as text; empty when unset
  std::string input(const std::string& role) const;       // digest; empty when there was none
  std::string input_name(const std::string& role) const;  // of its file, without the extension
  bool diverged() const;
  std::size_t tets() const { return trajectory->mesh().tets.size(); }
};

// In the order given. Without names (one each, or none) they are called by number. Throws
// Error(bad_input) for a trajectory without its manifest, Error(bad_config) for a wrong number of
// names.
std::vector<ComparedRun> read_runs(const std::vector<std::filesystem::path>& trajectories,
                                   const Json& names);

// The run called so. Throws Error(bad_config) naming `field` and the nearest name.
const ComparedRun& run_called(const std::vector<ComparedRun>& runs, const std::string& name,
                              const std::string& field);

}  // namespace viscera
