// What is left of a body's error when the solver has none: equilibria of the elements that XPBD
// takes against those of quadratic tets on the same mesh, which CalculiX's confirm
// (judge_problems.cpp).
#include <fmt/format.h>

#include <optional>

#include "sim/element_choice.hpp"
#include "tests/verification/problems.hpp"

namespace viscera::sim {
namespace {

struct Bound {
  double poisson_ratio, smoothed;
};

Outcome off_quadratic_tets(double poisson_ratio, Element element, std::optional<double> bound) {
  const Model model = judged_bar({20, 6, 6}, 5e4, poisson_ratio);
  const State exact = equilibrium_from(at_rest(model), model, own_weight(), 2);
  Scene scene = own_weight();
  set_element(scene.effects, element);
  const State found = equilibrium(model, scene);
  const double error = relative_error(model, found, exact);
  const std::string note = fmt::format("tip {:.2f} mm, of quadratic tets {:.2f} mm",
                                       tip_mm(model, found), tip_mm(model, exact));
  if (!bound) return {{}, fmt::format("error {}, {}", number(error), note)};
  return {{{"error", error, *bound}}, note, ""};
}

}  // namespace

void add_element_problems(std::vector<Row>& rows) {
  for (const auto& [nu, bound] : {Bound{0.3, 0.01}, {0.45, 0.01}, {0.49, 0.02}, {0.499, 0.03}}) {
    const auto add = [&rows, nu = nu](const char* solver, Element element,
                                      std::optional<double> most) {
      rows.push_back({"element", fmt::format("bar of 3,600 tets, ν {}, against quadratic tets", nu),
                      solver, "fp64", [=] { return off_quadratic_tets(nu, element, most); }});
    };
    add("any, smoothed elements", Element::smoothed, bound);
    add("any, linear tets", Element::linear, {});
  }
}

}  // namespace viscera::sim
