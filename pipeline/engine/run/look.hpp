// A spec with its plan and what a run of it would do: what commands that look at a run start from.
#pragma once

#include "pipeline/engine/plan/survey.hpp"
#include "pipeline/engine/run/inspect.hpp"

namespace viscera::engine {

struct Look {
  explicit Look(const InspectOptions& options);

  Spec spec;
  Store store;
  Catalog catalog;
  Plan plan;
  Survey found;
};

}  // namespace viscera::engine
