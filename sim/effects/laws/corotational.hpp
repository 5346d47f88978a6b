// Corotational linear elasticity: Hooke's law of the strain e = sym(R^T F) - I, with R the rotation
// nearest to F (Müller and Gross, "Interactive Virtual Materials", GI 2004; with this energy
// Chao et al., "A simple geometric model for elastic deformation", SIGGRAPH 2010). Keeps its
// stiffness when turned, flattened or inverted; under uniaxial stress P = E (s - 1).
//
// e is formed from H = F - I without cancellation, with R = I + 2 w [v] + 2 (v v^T - |v|^2 I):
//   sym(R^T F) - I = sym(R^T H) + 2 (v v^T - |v|^2 I)
// to which an error of R contributes in second order only: single precision is enough for R.
//
// Gradients are those of frozen R, dC_r/dF = R B_r. What turning adds to one row cancels in the sum
// over all, so the force of the six, sum k C dC/dF, is exact (R^T dR is skew, and the stress
// commutes with the strain); only the solver's metric A is an approximation, by terms of the order
// of the strain.
#pragma once

#include "sim/base/rotation.hpp"
#include "sim/effects/laws/hookean.hpp"

namespace viscera::sim {

struct Corotational : Hookean<Corotational> {
  static constexpr const char* name = "corotational";
  static constexpr const char* doc = "linear elasticity in each tet's own rotated frame";

  struct Params : Hookean<Corotational>::Params {
    // Not the scene's to give: the tets that it has from `neo_hookean` (stability.hpp). [tets] 1:
    // this one; empty: all.
    std::vector<char> only;
  };
  static bool acts_on(const Params& params, std::size_t tet) {
    return params.only.empty() || params.only[tet];
  }
  static TetSubset elements(const Model& model, const Params& params) {
    return tets_where(model, params.only, true);
  }
  template <class T>
  static Rest<T> rest(const Model& model, const TetSubset& tets, std::size_t e,
                      const Params& params, double dt) {
    return Hookean::rest<T>(model, tets, tets.index[e], params, dt);
  }
  static double energy(const Model& model, std::size_t tet, const Params& params,
                       const Mat3<double>& h) {
    return acts_on(params, tet) ? Hookean::energy(model, tet, params, h) : 0.0;
  }

  template <class T>
  SIM_HD static Strain<T> strain(const Mat3<T>& h) {
    const Quaternion<T> q = nearest_rotation(plus_identity(T(1), h));
    const Mat3<T> r = rotation_matrix(q);
    Symmetric<T> e = symmetric_part(transpose(r) * h);
    const Vec3<T>& v = q.v;
    e.xx -= T(2) * (v.y * v.y + v.z * v.z);
    e.yy -= T(2) * (v.x * v.x + v.z * v.z);
    e.zz -= T(2) * (v.x * v.x + v.y * v.y);
    e.yz += T(2) * v.y * v.z;
    e.xz += T(2) * v.x * v.z;
    e.xy += T(2) * v.x * v.y;
    return {e, r};
  }
};

}  // namespace viscera::sim
