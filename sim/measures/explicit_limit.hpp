// The limit of explicit dynamics (TLED) of a body as it is, where stability.hpp has it at rest: a
// body that is stretched or pressed grows stiffer, and steps that were short enough at rest may not
// stay so.
//
// Two steps, since the first is cheap and the second exact. With s_1 >= s_2 >= s_3 the singular
// values of F, the tangent of a law obeys dF : A : dF <= a |dF|^2 + b (cof F : dF)^2, and a tet's
// stiffness over its lumped mass has no eigenvalue above 4 (a + b (s_1 s_2)^2) sum |g_i|^2 / rho
// (|dF|^2 <= sum |g|^2 |u|^2, and Cauchy's inequality for cof F : dF = sum u_i . cof F g_i). No
// mode of the mesh is faster than that of its fastest tet (Irons and Treharne 1971). With H_J the
// second derivative of J, whose eigenvalues are s_k, -s_k and the roots of x^3 - |F|^2 x - 2 J:
//
//   neo_hookean   a = mu + max eig(c H_J), c = lambda (J - gamma)      b = lambda, that of the law
//   mooney_rivlin, ogden   a = k/2 max eig(d2D/dF2) + max eig(c H_J), likewise
//   volume        a = max eig(c H_J), c = lambda (J - 1)               b = lambda
//   stvk          a = (lambda + 2 mu) s_1^2 + max eig S                b = 0
//   corotational  a = lambda + 2 mu + max(0, lambda (s_1 + s_2 + s_3 - 3) - 2 mu) 2 / (s_2 + s_3)
//   others        a = their explicit_modulus, which does not grow      b = 0
//
// Where the bound is not kept, the fastest mode of the mesh is found by power iteration on the
// tangent, from differences of the effects' own forces. A Rayleigh quotient is never above the
// largest eigenvalue, so steps that it calls too long are.
#pragma once

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"

namespace viscera::sim {

// Of steps of the scene's length over the longest stable one, as in Stability::courant_max.
struct ExplicitLimit {
  double courant = 0.0;  // at most this where `exact` is false, else the fastest mode's
  bool exact = false;
  double substeps_needed = 1.0;  // per frame, for courant_limit in this state; a whole number
};

ExplicitLimit explicit_limit(const Model& model, const Scene& scene, const State& state);

}  // namespace viscera::sim
