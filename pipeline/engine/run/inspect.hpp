// Commands that look at a run and change nothing: why, status and graph.
#pragma once

#include "pipeline/engine/run/runner.hpp"

namespace viscera::engine {

struct InspectOptions {
  SpecRequest spec;
  Places places;
  std::string stage;            // why: this one; empty: all
  std::string format = "text";  // status, estimate: text, json; graph: mermaid, dot, json
};

// Each prints to stdout. `why`: what each stage would do, with old and new values. `status`: the
// same, how stages last failed, and gates. `graph`: the stages, coloured by state.
void print_why(const InspectOptions& options);
void print_status(const InspectOptions& options);
void print_graph(const InspectOptions& options);

// Where a file below OUT comes from: its stage with version, params and inputs, and so on back to
// the files that no stage made. Throws Error(usage) for a file of no run.
void print_origin(const std::filesystem::path& file);

}  // namespace viscera::engine
