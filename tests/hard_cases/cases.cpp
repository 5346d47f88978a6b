#include "tests/hard_cases/cases.hpp"

#include <algorithm>

namespace viscera::sim {

std::vector<Entrant> entrants() {
  std::vector<Entrant> all;
  for (const Precision precision : {Precision::fp32, Precision::fp64}) {
    const auto with = [precision](Method method, Scheme scheme) {
      return SolverOptions{.method = method,
                           .scheme = scheme,
                           .precision = precision,
                           .block_tets = 40,
                           .threads = 1};
    };
    all.push_back({"xpbd gauss_seidel", with(Method::xpbd, Scheme::gauss_seidel)});
    all.push_back({"xpbd block_gauss_seidel", with(Method::xpbd, Scheme::block_gauss_seidel)});
    all.push_back({"xpbd jacobi, split 4", with(Method::xpbd, Scheme::jacobi)});
    all.push_back({"pbd", with(Method::pbd, Scheme::gauss_seidel)});
    all.push_back({"tled", with(Method::tled, Scheme::jacobi)});
  }
  if (runs_on_cuda()) return all;
  all.push_back({"fem", {.method = Method::fem, .precision = Precision::fp64, .threads = 1}});
  return all;
}

void add_case(std::vector<Row>& rows, const char* section, const std::string& name,
              const CaseRun& run, bool may_refuse) {
  for (const auto& [solver, options] : entrants()) {
    rows.push_back({section, name, solver, options.precision == Precision::fp32 ? "fp32" : "fp64",
                    [run, options] { return run(options); }, may_refuse});
  }
}

void add_case(std::vector<Row>& rows, const char* section, const std::string& name,
              const std::function<Outcome()>& run) {
  rows.push_back({section, name, "any", "–", run});
}

void add_material_case(std::vector<Row>& rows, const char* section, const std::string& name,
                       const CaseRun& run, bool may_refuse) {
  const std::size_t before = rows.size();
  add_case(rows, section, name, run, may_refuse);
  const auto begin = rows.begin() + static_cast<std::ptrdiff_t>(before);
  rows.erase(std::remove_if(begin, rows.end(), [](const Row& row) { return row.solver == "pbd"; }),
             rows.end());
}

Scene damped_scene(const SolverOptions& options) {
  Scene scene;
  if (options.method == Method::pbd) {
    scene.params<Distance>().emplace_back();
    scene.params<Volume>().emplace_back();
  } else {
    scene.params<NeoHookean>().emplace_back();
  }
  scene.params<Viscosity>().emplace_back();
  return scene;
}

Scene weighty_scene(const SolverOptions& options) {
  Scene scene = damped_scene(options);
  scene.params<Gravity>().emplace_back();
  return scene;
}

Scene falling_scene(const SolverOptions& options) {
  Scene scene = weighty_scene(options);
  scene.params<Ground>().emplace_back();
  return scene;
}

void clamp_left(Model& model) {
  double left = 0.0;
  for (const auto& x : model.rest) left = std::min(left, x.x);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = model.rest[i].x < left + 1e-9 * model.size();
  }
}

}  // namespace viscera::sim
