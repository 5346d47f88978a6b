// What the implicit finite elements sum up: every effect that a scene names gives one term of the
// forces, of their tangent and, where it has one, of the potential that a step makes smallest. SI.
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>

#include "sim/effects/effect.hpp"
#include "sim/solvers/fem/system.hpp"

namespace viscera::sim {

using NodeField = std::vector<Vec3<double>>;

// Displacements, [nodes] m: u from where the step counts d, which is where it starts, or for a step
// of second order further on (time_rule.hpp).
struct FemFields {
  const NodeField& u;
  const NodeField& d;
  Step<double> step;  // its dt is the time over which forces act
  double load = 1.0;  // share of the loads that are on: less than 1 on the way to an equilibrium
  const NodeField& start;  // of the step
  double whole_s;          // of the step

  FemFields(const NodeField& u_start, const NodeField& d_now, const Step<double>& own,
            double load_now = 1.0)
      : u(u_start), d(d_now), step(own), load(load_now), start(u_start), whole_s(own.dt) {}
  FemFields(const NodeField& u_further_on, const NodeField& d_now, const Step<double>& own,
            const NodeField& u_start, double whole)
      : u(u_further_on), d(d_now), step(own), start(u_start), whole_s(whole) {}
};

struct FemForces {
  NodeField sum;        // [nodes] N
  NodeField loose;      // [nodes] N, those of `sum` that have no potential
  double energy = 0.0;  // J, the potential of the others
  double scale = 0.0;   // N, sum of the magnitudes of all forces of all elements on their nodes
  double size = 0.0;    // J, sum of the magnitudes of the energies
  // What of the forces, N, and of the energy, J, may be rounding of large coordinates.
  double rounding = 0.0, energy_rounding = 0.0;

  explicit FemForces(std::size_t nodes) : sum(nodes), loose(nodes) {}
  void clear() {
    std::ranges::fill(sum, Vec3<double>{});
    std::ranges::fill(loose, Vec3<double>{});
    energy = scale = size = rounding = energy_rounding = 0.0;
  }
  void add(int node, const Vec3<double>& force) {
    sum[node] += force;
    scale += norm(force);
  }
  void add_loose(int node, const Vec3<double>& force) {
    add(node, force);
    loose[node] += force;
  }
  void add_energy(double joule) {
    energy += joule;
    size += std::abs(joule);
  }
};

// The tangent as it is, or the nearest that is positive semi-definite element by element.
enum class Tangent { exact, definite };

// What contact multipliers were off by at a solved step.
struct Correction {
  double change = 0.0;  // N, by how much the contact forces change with the multipliers
  double lag = 0.0;     // N of normal force by which the bounds of friction were off
  double normal = 0.0;  // N, sum of the normal forces
  Correction& operator+=(const Correction& more) {
    change += more.change, lag += more.lag, normal += more.normal;
    return *this;
  }
};

class FemTerm {
 public:
  virtual ~FemTerm() = default;
  virtual void connect(FemSystem& system) = 0;            // names its elements' nodes
  virtual void take_places(const FemSystem& system) = 0;  // after the system was analysed
  virtual void begin_step(const FemFields&) {}
  virtual void undo_step() {}  // as it was before begin_step()
  // How much of `step` from d on may be made, 0 to 1: no tet that has a barrier is turned over.
  virtual double longest_step(const FemFields&, const NodeField& /*step*/) const { return 1.0; }
  virtual void add_forces(const FemFields& fields, FemForces& forces) const = 0;
  virtual void add_tangent(const FemFields& fields, Tangent kind, FemSystem& system) const = 0;
  // Contact only: brings the multipliers up to date with a solved step, and the bounds of friction
  // by the share `follow` of the way to what the normal forces now allow (0: they stay).
  virtual Correction correct(const FemFields&, double /*follow*/) { return {}; }
  // Contact only, of a state whose multipliers are not known: where a node is no farther than
  // `reach` (m) from an obstacle, they are what the other forces there lack of balance, N.
  virtual void assume_contact(const FemFields&, const NodeField& /*lacking*/, double /*reach*/) {}
  // Adds the ways along which obstacles have stopped nodes in a solved step.
  virtual void add_stops(NodeField&) const {}
  // May change the velocity that a step ends with; `before` is that at its start.
  virtual void end_step(const FemFields&, const NodeField& /*before*/, NodeField& /*velocity*/) {}
  virtual std::size_t contact_count() const { return 0; }
  // Takes over the model's materials; what a term refers to has changed already.
  virtual void retune(const Model&) {}
  // What an effect keeps from step to step.
  virtual void save_history(std::vector<double>&) const {}
  virtual void load_history(std::span<const double>&) {}
};

// Sets the negative eigenvalues of a symmetric matrix [n x n] to zero.
void clip_negative(double* symmetric, int n);

// Negative eigenvalues are set to zero; where there is none but for rounding, as Cholesky tells at
// a tenth of the cost, nothing is changed.
template <int n>
void make_definite(Eigen::Matrix<double, n, n>& symmetric) {
  const double rounding = 1e-12 * symmetric.trace();
  Eigen::Matrix<double, n, n> lifted = symmetric;
  lifted.diagonal().array() += rounding;
  if (lifted.llt().info() != Eigen::Success) clip_negative(symmetric.data(), n);
}

}  // namespace viscera::sim
