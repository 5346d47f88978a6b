// Explicit dynamics of a body that has grown stiffer than it was at rest: how many substeps it
// needs now. The time grid is fixed, so a run whose steps are too long ends.
#pragma once

#include <string>

#include "sim/measures/explicit_limit.hpp"
#include "sim/measures/stability.hpp"

namespace viscera {

class ExplicitWatch {
 public:
  // Refers to both.
  ExplicitWatch(const sim::Model& model, const sim::Scene& scene) : model_(model), scene_(scene) {}

  // Why the run may not go on from this state; empty: it may.
  std::string operator()(const sim::State& state);
  bool objected() const { return objected_; }
  // What a run that ended otherwise had been short of in its last good state.
  std::string explain(const sim::State& last) const;

 private:
  std::string explain(const sim::ExplicitLimit& limit) const;

  // As at rest: some of the steps to the next frame are taken further deformed.
  static constexpr double allowed = sim::courant_limit;
  const sim::Model& model_;
  const sim::Scene& scene_;
  bool objected_ = false;
};

}  // namespace viscera
