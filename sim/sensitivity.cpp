#include "sim/sensitivity.hpp"

#include "sim/base/refusal.hpp"
#include "sim/equilibrium.hpp"
#include "sim/solvers/fem/fem.hpp"

namespace viscera::sim {
namespace {

// Of the sum of all forces. What it leaves is far below the truncation of a difference.
constexpr double tolerance = 1e-11;

void check(const Scene& scene) {
  const auto refuse = [](const char* effect, const char* why) {
    throw Refusal(Refusal::Cause::scene, std::string("effects.") + effect, why,
                  "effects whose tangent is exact and symmetric");
  };
  if (scene.has<Pressure>()) refuse(Pressure::name, "a load that follows the surface");
  if (scene.has<SelfContact>()) refuse(SelfContact::name, "forces that are not known");
}

}  // namespace

Sensitivity::Sensitivity(const Model& model, const Scene& scene, const State& near, Element element,
                         const std::vector<Vec3<double>>& by_displacement,
                         const std::function<void()>& pause_point)
    : element_(element),
      poisson_ratio_(model.largest_poisson_ratio()),
      options_(newton_options(element, tolerance, pause_point)),
      by_displacement_(by_displacement) {
  check(scene);
  // What another solver keeps is of no use to this one. It finds where a frame ends: here at the
  // time of `near`.
  const std::uint64_t frame = scene.time.substeps;
  const State still{near.u, std::vector<Vec3<double>>(near.u.size()),
                    near.step >= frame ? near.step - frame : near.step};
  equilibrium_ = equilibrium(model, scene, still, element, tolerance, pause_point);
  const auto rest = rest_of({model, scene});
  if (rest->touches_obstacles()) {
    throw Refusal(Refusal::Cause::scene, "effects", "an obstacle that the body touches at rest",
                  "a body that supports and springs alone hold");
  }
  by_displacement_.resize(rest->places().size());  // nodes within edges are no quantity's
  adjoint_ = rest->moved_by(by_displacement_);
}

std::unique_ptr<FemRest> Sensitivity::rest_of(const Variant& variant) const {
  return make_fem_rest(variant.model, with_element(element_, poisson_ratio_, variant.scene),
                       options_, equilibrium_);
}

double Sensitivity::between(const Variant& less, const Variant& more) const {
  const auto from = rest_of(less), to = rest_of(more);
  const auto forces_from = from->forces(), forces_to = to->forces();
  const auto places_from = from->places(), places_to = to->places();
  double change = 0.0;
  for (std::size_t i = 0; i < adjoint_.size(); ++i) {
    change += from->is_free(static_cast<int>(i))
                  ? dot(adjoint_[i], forces_to[i] - forces_from[i])
                  : dot(by_displacement_[i], places_to[i] - places_from[i]);
  }
  return change;
}

}  // namespace viscera::sim
