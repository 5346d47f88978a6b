// The verification problems of the solvers, by subject. Every row is one problem under one solver.
#pragma once

#include "sim/element_choice.hpp"
#include "tests/results/outcome.hpp"
#include "tests/results/run.hpp"

namespace viscera::sim {

// The bar that the project is judged by: 10 x 3 x 3 cm, five tets a cell, clamped at its left end,
// rho 1060. `cells` {10, 3, 3} makes 450 tets, {20, 6, 6} 3,600, {40, 12, 12} 28,800.
Model judged_bar(std::array<int, 3> cells, double youngs_modulus = 5e4,
                 double poisson_ratio = 0.45);
// Mean z displacement of the vertices at the right end, mm.
double tip_mm(const Model& model, const State& state);
// rms of the difference over rms of the reference.
double relative_error(const Model& model, const State& found, const State& reference);
// Elastic with these elements, viscous, under gravity.
Scene own_weight();
Scene own_weight(const Model& model, Element element);

const char* name_of(Precision precision);
// Single and double precision of a scheme, one thread.
SolverOptions xpbd(Scheme scheme, Precision precision, int iterations = 1);

void add_static_problems(std::vector<Row>& rows);
void add_motion_problems(std::vector<Row>& rows);
void add_contact_problems(std::vector<Row>& rows);
void add_measured_problems(std::vector<Row>& rows);
void add_judge_problems(std::vector<Row>& rows);  // CalculiX, where it is installed

}  // namespace viscera::sim
