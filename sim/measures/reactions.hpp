// The forces that act on a body from outside, by what exerts them: supports, obstacles, springs,
// loads, pressure, grips, gravity.
//
// Newton's second law of a vertex, m a = f_elastic + f_rate + f_outside, is solved for what
// supports and obstacles exert,
//
//   r = m a - f_elastic - f_rate - f_known
//
// with f_known the forces from outside that are functions of where the body is (gravity, springs,
// loads, pressure, grips). Everything is evaluated in double at the displacements of a frame and
// with the elements of the scene, so that it is the same sum whatever solver, device or precision
// made the frame. As elastic forces have no resultant, the sum of all forces from outside is the
// rate of change of the body's momentum to rounding, in motion too; at rest it is 0.
//
// a and the velocity that rates take are differences over frames. In motion r of a single vertex is
// therefore that of a mean over two frames, with elastic forces of the moment between: vibrations
// faster than a frame are in it.
//
// r of a vertex that is held or led belongs to its support. Of a free one it belongs to the
// obstacle that it touches: the vertex would be inside, were it moved a little against r. If there
// is none, and it or a triangle of its own is as near to another part of the surface as
// self-contact keeps them apart, it is what the body exerts on itself, by the pieces that are on
// either side; all of these together have no resultant but for the solver's error. Of the
// others it is what the frame lacks of the equations, the solver's own error (and in motion, what
// vibrates faster than frames): the impulses that moved the body were other ones than the forces
// of its displacements. That is handed on to supports and obstacles, as a body hands a load on to
// what holds it: the share of each is harmonic (a Laplace problem on the mesh's edges, as stiff as
// the springs of effects/distance.hpp), 1 on its own vertices and 0 on those of others. With one
// alone its resultant is then exact. Nothing is handed on where nothing holds the body.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "sim/model/state.hpp"
#include "sim/model/surface_pairs.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

struct Resultant {
  Vec3<double> force;   // N, on the body
  Vec3<double> moment;  // N m, about Reactions::about()
};

// A frame and how it moves: velocity [n] m/s, acceleration [n] m/s2.
struct FrameMotion {
  const State* state;
  std::vector<Vec3<double>> velocity, acceleration;

  // Of the second of three states that are `frame_s` apart, by central differences.
  static FrameMotion between(const State& before, const State& now, const State& after,
                             double frame_s);
  // Of an equilibrium, whatever equilibria come before and after.
  static FrameMotion none(const State& now);
  // Of the last of three: its acceleration is that of the moment a frame before.
  static FrameMotion at_end(const State& first, const State& before, const State& now,
                            double frame_s);
};

class Reactions {
 public:
  using ForcesOfTissue =
      std::function<std::vector<Vec3<double>>(const Model&, const State&)>;  // [n] N

  // Refers to the model. `acts_s` is over how long forces act in a substep (acting_time of
  // solvers/time_rule.hpp), on which the hold of a grip depends; 0: all of it. `tissue` stands for
  // neo_hookean where tets are not linear (solvers/fem/quadratic_forces.hpp). Throws Refusal for
  // effects that have no law of force: shape matching.
  Reactions(const Model& model, const Scene& scene, double acts_s = 0.0,
            ForcesOfTissue tissue = {});

  // What exerts forces, by its key in the scene, with .1, .2, ... where it is named several times;
  // `model_held` are vertices that the model itself holds (Model::fixed); `self_contact` is what
  // acts on the body from itself, of a body of several pieces self_contact_LABEL on each, by the
  // label that most of it has; `remainder` comes last.
  const std::vector<std::string>& names() const { return names_; }
  static constexpr const char *model_held = "held", *self_contact = "self_contact",
                              *remainder = "remainder";
  // m, in the model's frame: the centre of mass of the body at rest.
  const Vec3<double>& about() const { return about_; }

  struct Found {
    std::vector<Resultant> of;          // [names]
    double handed_on = 0.0;             // N, the size of the resultant of what the solver lacks
    std::vector<Vec3<double>> contact;  // [n] N: r of every vertex
  };
  Found at(const FrameMotion& motion) const;

 private:
  void name_self_contact(const Scene& scene);
  // Those of the vertices that nothing holds yet to which self-contact is near.
  void find_self_contact(const State& state, std::vector<int>& by) const;
  // [n] the share of `name` in what acts on each vertex; by[v] is whose vertex v is, -1 of nobody.
  std::vector<double> shares(int name, const std::vector<int>& by) const;

  template <class Effect>
  using Slot = Prepared<Effect, double>;

  const Model& model_;
  double dt_, acts_;  // s
  Effects::Slots<Slot> on_;
  std::vector<std::string> names_;
  SpringNetwork edges_;                // as the springs of `distance`, whose stiffness hands on
  std::vector<int> piece_;             // [n] the first vertex that each is connected with
  std::optional<SurfacePairs> pairs_;  // of self-contact
  double near_ = 0.0;                  // m, how far apart surfaces are that touch, and a little
  std::vector<int> own_row_;           // [n] of names: of self-contact on the vertex's piece
  std::vector<int> holder_;  // [n] of names: the support that holds a vertex; -1: it is free
  Vec3<double> about_;
  ForcesOfTissue tissue_;
  double reach_;  // m, how far off an obstacle a vertex still touches it
};

}  // namespace viscera::sim
