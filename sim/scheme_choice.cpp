#include "sim/scheme_choice.hpp"

#include "sim/backend/cuda/cuda.hpp"
#include "sim/measures/stability.hpp"
#include "sim/solvers/xpbd/damping_choice.hpp"

namespace viscera::sim {
namespace {

// About the tets of the largest bodies that were run in blocks; a block that is too large for a
// device's shared memory is refused, and that depends on the device. Smoothed elements are more in
// a block than tets, and a vertex that many of them share has more replicas.
constexpr std::size_t max_in_blocks = 1'000'000, max_smoothed_in_blocks = 250'000;

// Why blocks on a device would not do what the scene asks for; "": they would.
std::string what_blocks_lack(const Model& model, const Scene& scene, SolverOptions options) {
  options.scheme = Scheme::gauss_seidel;
  const bool solves_damping = static_cast<bool>(damping_for(model, scene, options));
  options.scheme = Scheme::block_gauss_seidel;
  if (const std::string lacks = what_cuda_lacks(scene, options); !lacks.empty()) {
    return "a device does not run " + lacks;
  }
  if (scene.accuracy_limit > 0.0) return "blocks on a device do not hold forces (accuracy_limit)";
  if (solves_damping) return "blocks on a device do not solve for the damping of tissue this stiff";
  const bool loses_order = order_of(scene, options) == 2 && is_of_first_order_in_blocks(model);
  if (loses_order && !scene.has<Viscosity>()) {
    return "without viscosity the rebound is that of the time step, which is of first order in "
           "blocks of tissue this nearly incompressible";
  }
  std::size_t most = has_smoothed(scene) ? max_smoothed_in_blocks : max_in_blocks;
  if (options.precision == Precision::fp64) most /= 2;
  if (model.tet_count() > most) return "so many tets were not run in blocks";
  return "";
}

}  // namespace

SchemeChoice choose_scheme(const Model& model, const Scene& scene, SolverOptions options,
                           bool on_device) {
  if (!on_device) return {Scheme::gauss_seidel, "its time step is of second order"};
  if (std::string lack = what_blocks_lack(model, scene, options); !lack.empty()) {
    return {Scheme::gauss_seidel, std::move(lack)};
  }
  return {Scheme::block_gauss_seidel, "a frame of it is one launch"};
}

}  // namespace viscera::sim
