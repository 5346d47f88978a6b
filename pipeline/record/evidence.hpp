// What tests of this version found out about its solvers, as far as it concerns one run: rows of
// the tables that the tests write (docs/results), which the build embeds. Which effects and
// settings a row concerns is one table, in evidence.cpp.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "pipeline/base/param.hpp"

namespace viscera::engine {

// A table of the tests, whole.
struct ResultTable {
  std::string file;                            // its name in docs/results
  std::string program;                         // that wrote it
  std::string dated;                           // the day since when its figures are what they are
  std::vector<std::vector<std::string>> rows;  // section, case, solver, precision, outcome, figures
};

// Of the CPU, or of CUDA devices: verification and hard cases.
std::vector<ResultTable> result_tables(bool on_device);
// "" for a section of a table that nothing is known about.
std::string subject_of(const std::string& section);

// What a run was made with.
struct Setting {
  std::string method, scheme, precision, element;  // as metrics and params name them; "": none
  bool on_device = false;
  std::vector<std::string> effects;
  bool several_materials = false, several_densities = false, accuracy_limit = false;
};

// The rows that concern the setting's method and effects, as objects with table, program, dated,
// section, subject, case, solver, precision, outcome, figures, and `differs`: a list of what the
// row was made with in place of what the run has.
Json verification_rows(const Setting& setting);
// The same of the rows that compare with a measured body, and those of measured.csv: body, state,
// quantity, solver, error, allowed, uncertainty, unit, seconds.
Json measured_rows(const Setting& setting);
// Bodies of known truth on which the error bar (certify) was tried with these elements: body, tets,
// nu, total_percent, true_percent, effectivity.
Json error_bar_rows(const std::string& element);

}  // namespace viscera::engine
