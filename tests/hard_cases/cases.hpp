// The hard cases by subject, and the solvers that claim them.
#pragma once

#include "tests/results/outcome.hpp"
#include "tests/results/run.hpp"

namespace viscera::sim {

struct Entrant {
  const char* name;
  SolverOptions options;
};
// Every solver and precision that simulates tissue on the device under test.
std::vector<Entrant> entrants();

// One row for every entrant.
using CaseRun = std::function<Outcome(const SolverOptions&)>;
void add_case(std::vector<Row>& rows, const char* section, const std::string& name,
              const CaseRun& run, bool may_refuse = false);
// The same for a case whose answer the materials decide: not PBD, which knows none.
void add_material_case(std::vector<Row>& rows, const char* section, const std::string& name,
                       const CaseRun& run, bool may_refuse = false);
// One row for what no solver sees.
void add_case(std::vector<Row>& rows, const char* section, const std::string& name,
              const std::function<Outcome()>& run);

void add_shape_cases(std::vector<Row>& rows);
void add_material_cases(std::vector<Row>& rows);
void add_scale_cases(std::vector<Row>& rows);
void add_contact_cases(std::vector<Row>& rows);
void add_input_cases(std::vector<Row>& rows);

// Tissue as the solver takes it: PBD has springs along the edges and the tets' volume for it.
Scene damped_scene(const SolverOptions& options);   // elastic and viscous
Scene weighty_scene(const SolverOptions& options);  // and gravity
Scene falling_scene(const SolverOptions& options);  // and the ground
// Fixes the vertices of smallest x.
void clamp_left(Model& model);

}  // namespace viscera::sim
