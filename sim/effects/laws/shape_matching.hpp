// Shape matching: the vertices of a region are drawn towards its rest shape, moved and turned as a
// whole so that it lies as near to them as possible.
//
//   C_i = x_i - g_i,   g_i = c + R r_i,   potential sum_i m_i omega^2 / 2 |C_i|^2
//   c = sum m_i x_i / M,   R the rotation nearest to sum m_i (x_i - c) r_i^T,   r_i = X_i - C
//
// Müller et al., "Meshless Deformations Based on Shape Matching" (SIGGRAPH 2005), equations 3 to 8;
// R as in best_rotation.hpp. With the displacement w from rest, sum m x r^T = sum m r r^T + sum m w
// r^T and C_i = (w_i - c_w) - (R - I) r_i: no small strain cancels. Sums are taken in double.
//
// One frequency for all of a region makes it the exact solution of an implicit step and keeps
// linear and angular momentum: sum m_i C_i = 0 and sum m_i R r_i x C_i = 0. The frequency gives it
// the material's shear stiffness. A homogeneous strain e stores omega^2/2 e^2 : sum m r r^T,
// in an isotropic region omega^2/6 (sum m r^2) e : e, where the material stores mu V e : e:
//
//   omega^2 = 6 sum mu V / sum m r^2         compliance of a vertex: 1 / (m_i omega^2)
//
// (derived for this project). So E and nu set the answer of a whole region to stretch and shear;
// its bulk modulus is that of Poisson's ratio 0. Every finer deformation has the same frequency,
// where the material's rises with the wave number: smaller regions follow it further.
//
// Where regions overlap, a vertex is split into replicas that have the masses of its tets in each,
// and their displacements are averaged (partition.hpp).
#pragma once

#include "sim/effects/effect.hpp"
#include "sim/model/partition.hpp"

namespace viscera::sim {

struct ShapeMatching {
  static constexpr const char* name = "shape_matching";
  static constexpr const char* doc = "regions that pull back to their rest shape, freely moved";
  static constexpr EffectKind kind = EffectKind::region;

  struct Params {
    std::string regions = "body";
    double tets = 200.0;  // of a block
  };
  static constexpr auto fields() {
    return std::tuple{Field{"regions", "body|label|blocks", &Params::regions,
                            "one region, one for each label, or blocks of neighbouring tets; what "
                            "does not hang together are several"},
                      Field{"tets", "1", &Params::tets, 1.0, 1e9, "of a block"}};
  }
  static void check(const Params& params) {
    if (params.regions == "body" || params.regions == "label" || params.regions == "blocks") return;
    throw Refusal(Refusal::Cause::scene, "effects.shape_matching.regions",
                  "'" + params.regions + "'", "body, label or blocks");
  }

  static std::vector<int> regions(const Model& model, const Params& params) {
    if (params.regions == "label") return connected_parts(model, model.material_of);
    std::vector<int> region(model.tet_count(), 0);
    if (params.regions == "body") return connected_parts(model, region);
    const Blocks blocks(model, static_cast<int>(std::min(params.tets, 1e9)));
    for (std::size_t t = 0; t < region.size(); ++t) region[t] = blocks.block_of(model.tets[t]);
    return connected_parts(model, region);
  }

  // From sum mu V and sum m r^2 of a region, 1/s2.
  static double squared_frequency(double shear, double inertia) { return 6.0 * shear / inertia; }
};

}  // namespace viscera::sim
