// Time and load of the implicit finite elements. A step of implicit Euler makes
//
//   1/2 (d - y)^T M (d - y) / dt^2 + potential(u + d),   y = dt v + dt^2 a
//
// smallest; an equilibrium is the same without inertia. advance_step() and find_equilibrium() say
// how they get there; one step's Newton iterations are in fem_newton.hpp. Double precision and one
// thread, whatever the options say.
#include "sim/solvers/fem.hpp"

#include <limits>

#include "sim/elasticity.hpp"
#include "sim/refusal.hpp"
#include "sim/solvers/fem_contact.hpp"
#include "sim/solvers/fem_effect.hpp"
#include "sim/solvers/fem_mass.hpp"
#include "sim/solvers/fem_newton.hpp"

namespace viscera::sim {
namespace {

void refuse(const char* field, const std::string& found, const char* allowed,
            const char* remedy = "") {
  throw Refusal(Refusal::Cause::scene, field, found, allowed, remedy);
}

const FemOptions& checked(const FemOptions& options) {
  if (options.order != 1 && options.order != 2) {
    refuse("fem.order", std::to_string(options.order), "1 (linear) or 2 (quadratic tets)");
  }
  if (!(options.tolerance >= 1e-13 && options.tolerance < 1.0)) {
    refuse("fem.tolerance", std::to_string(options.tolerance), "1e-13 to 1");
  }
  if (options.max_iterations < 1) {
    refuse("fem.max_iterations", std::to_string(options.max_iterations), "1 or more");
  }
  return options;
}

bool is_static(const FemOptions& options) {
  return options.time == FemOptions::Time::quasi_static;
}

template <class Effect>
constexpr bool loses_stiffness = [] {
  if constexpr (requires { Effect::loses_stiffness; }) return Effect::loses_stiffness;
  return false;
}();

// The finite elements have no limit of stability, and so no need of another form.
const Scene& checked(const Scene& scene) {
  for (const auto& params : scene.params<NeoHookean>()) {
    if (!params.taken.empty()) {
      refuse("stability", "form, with tets that another law has", "neo_hookean on every tet",
             "apply the policy for this solver");
    }
  }
  return scene;
}

// Whether a tet of order 1 is inside out.
bool is_inverted(const FemTet<4>& tet, const NodeField& u) {
  return 1.0 + NeoHookean::volume_strain(gradient_at<4>(tet.nodes, tet.points[0], u)) <= 0.0;
}

// Nodes that no force moves.
std::vector<char> held_nodes(const FemMesh& mesh, const Program<double>& program) {
  std::vector<char> held = mesh.fixed;
  for_each_slot<EffectKind::motion>(program.effects, [&held]<class Effect>(const auto& motion) {
    for (const int v : motion.vertices) held[v] = 1;
  });
  const std::size_t vertices = held.size() - mesh.parents.size();
  for (std::size_t m = 0; m < mesh.parents.size(); ++m) {
    if (held[mesh.parents[m][0]] && held[mesh.parents[m][1]]) held[vertices + m] = 1;
  }
  return held;
}

// About the diagonal of the stiffness matrix at rest, with inertia: N/m.
std::vector<double> node_stiffness(const Model& model, const FemMesh& mesh, double inertia) {
  std::vector<Vec3<double>> sum(model.vertex_count());
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Lame constants = lame(model.material(t));
    const auto& b = model.rest_inverse[t];
    const double k = (constants.lambda + 2.0 * constants.mu) * model.volume[t] * squared_norm(b);
    for (const int v : model.tets[t]) sum[v].x += k;
  }
  for (std::size_t i = 0; i < sum.size(); ++i) sum[i].x += inertia * model.mass[i];
  std::vector<double> stiffness;
  for (const auto& k : mesh.on_nodes(sum)) stiffness.push_back(k.x);
  return stiffness;
}

std::vector<double> times(double factor, std::vector<double> numbers) {
  for (double& number : numbers) number *= factor;
  return numbers;
}

class FemSolver final : public Solver {
 public:
  FemSolver(const Model& model, const Scene& scene, const SolverOptions& options)
      : options_(checked(options.fem)),
        mesh_(model, options_.order),
        program_(mesh_.body(model), checked(scene)),
        system_(held_nodes(mesh_, program_), options_.linear),
        stiffness_(mesh_.node_count()),
        newton_(system_, terms_, options_, stiffness_, options.pause_point),
        u_(mesh_.node_count()),
        v_(mesh_.node_count()) {
    take_stiffness(model);
    auto mass = std::make_unique<MassTerm>(mesh_.mass);
    mass_ = mass.get();
    terms_.push_back(std::move(mass));
    for_each_slot<EffectKind::element>(program_.effects, [&]<class Effect>(const auto& effect) {
      add_term<Effect>(model, effect);
    });
    for_each_slot<EffectKind::contact>(program_.effects, [&]<class Effect>(const auto& effect) {
      terms_.push_back(std::make_unique<ContactTerm<Effect>>(effect, mesh_, penalty_));
    });
    for (const auto& term : terms_) term->connect(system_);
    system_.analyse();
    for (const auto& term : terms_) term->take_places(system_);
  }

  void advance_frame() override {
    if (is_static(options_)) {
      find_equilibrium();
    } else {
      for (int substep = 0; substep < program_.substeps; ++substep) advance_step();
    }
  }

  // Vertices only; what midside nodes and effects keep is in the memory.
  State state() const override {
    const auto n = static_cast<std::ptrdiff_t>(program_.rest.size());
    State state{{u_.begin(), u_.begin() + n}, {v_.begin(), v_.begin() + n}, step_};
    for (const NodeField* field : {&u_, &v_}) {
      for (auto a = field->begin() + n; a != field->end(); ++a) {
        state.memory.insert(state.memory.end(), {a->x, a->y, a->z});
      }
    }
    for (const auto& term : terms_) term->save_memory(state.memory);
    return state;
  }
  void set_state(const State& state) override {
    std::span<const double> memory = take_nodes(state, u_, v_);
    for (const auto& term : terms_) term->load_memory(memory);
    step_ = state.step;
  }
  void retune(const Model& model, const Scene& scene) override {
    check_scene(scene);
    program_.retune({mesh_.body(model), scene});
    take_stiffness(model);
    for (const auto& term : terms_) term->retune(model);
  }
  void steer(const Scene& scene) override {
    check_scene(scene);
    program_.steer(scene);
  }
  Diagnostics diagnose(const Model& model, const Scene& scene, const State& state) const override {
    NodeField u, v;
    take_nodes(state, u, v);
    NodeField momentum(v.size());
    std::vector<double> weight(v.size());
    for (int j = 0; j < mesh_.mass.outerSize(); ++j) {
      for (Eigen::SparseMatrix<double>::InnerIterator it(mesh_.mass, j); it; ++it) {
        momentum[it.row()] += it.value() * v[j];
        weight[it.row()] += it.value();
      }
    }
    const auto sums = [&]<int n>(const std::vector<FemTet<n>>& tets) {
      return sum_over_elements(tets.size(), [&](std::size_t t, ElementSums& sum) {
        add_element(model, scene, tets[t], t, u, sum);
      });
    };
    return diagnostics_of(scene, mesh_.order == 1 ? sums(mesh_.linear) : sums(mesh_.quadratic),
                          {u, v, momentum, weight});
  }
  std::size_t contact_count() const override {
    std::size_t count = 0;
    for (const auto& term : terms_) count += term->contact_count();
    return count;
  }
  std::string device() const override { return "cpu, 1 thread"; }

 private:
  // Large enough for few rounds of multipliers, small enough for the condition of the system.
  static constexpr double penalty_factor = 1e3;

  // What a state knows of all nodes; returns what is left of its memory.
  std::span<const double> take_nodes(const State& state, NodeField& u, NodeField& v) const {
    std::span<const double> memory = state.memory;
    u = mesh_.on_nodes(state.u), v = mesh_.on_nodes(state.v);
    for (NodeField* field : {&u, &v}) {
      for (std::size_t i = program_.rest.size(); i < field->size() && !memory.empty(); ++i) {
        (*field)[i] = {memory[0], memory[1], memory[2]};
        memory = memory.subspan(3);
      }
    }
    return memory;
  }

  // At the quadrature points, which are where the solver sees an element.
  template <int n>
  static void add_element(const Model& model, const Scene& scene, const FemTet<n>& tet,
                          std::size_t t, const NodeField& u, ElementSums& sum) {
    const auto& laws = scene.params<NeoHookean>();
    const double lambda = lame(model.material(t)).neo_hookean_lambda();
    bool inverted = false;
    for (const auto& point : tet.points) {
      const Mat3<double> h = gradient_at<n>(tet.nodes, point, u);
      const double j = 1.0 + NeoHookean::volume_strain(h);
      inverted |= j <= 0.0;
      sum.min_j = std::min(sum.min_j, j);
      sum.volume += j * point.volume;
      sum.rest_volume += point.volume;
      sum.elastic += point.volume / model.volume[t] * elastic_energy(model, scene, t, h);
      if (is_open(j)) {
        sum.elastic +=
            static_cast<double>(laws.size()) * point.volume * VolumeBarrier::at(lambda, j).energy;
      }
    }
    if (inverted) ++sum.inverted;
  }

  void take_stiffness(const Model& model) {
    const double inertia = is_static(options_) ? 0.0 : 1.0 / (program_.dt * program_.dt);
    stiffness_ = node_stiffness(model, mesh_, inertia);
    penalty_ = times(penalty_factor, stiffness_);
  }

  template <class Effect>
  void add_term(const Model& model, const Prepared<Effect, double>& effect) {
    if (needs_rate<Effect> && is_static(options_)) return;
    if constexpr (std::is_same_v<Effect, NeoHookean>) {
      if (mesh_.order == 1) {
        terms_.push_back(std::make_unique<NeoHookeanTerm<4>>(model, mesh_));
      } else {
        terms_.push_back(std::make_unique<NeoHookeanTerm<10>>(model, mesh_));
      }
    } else {
      if (mesh_.order != 1 && Effect::arity > 1) {
        refuse((std::string("effects.") + Effect::name).c_str(), "quadratic tets",
               "neo_hookean and effects of single nodes", "use fem.order 1");
      }
      terms_.push_back(std::make_unique<EffectTerm<Effect>>(effect));
    }
  }

  void advance_step() {
    const Step<double> step = program_.step(step_);
    const NodeField acceleration = accelerations();
    mass_->set_motion(v_, acceleration, step.dt);
    NodeField d(u_.size());
    const FemFields fields{u_, d, step};
    for (const auto& term : terms_) term->begin_step(fields);
    d = best_start(fields, d, step.dt, acceleration);
    const std::string problem = newton_.solve(fields, d, moves(step.time, 1.0));
    if (!problem.empty()) {
      for (const auto& term : terms_) term->undo_step();
      throw Diverged(problem);
    }
    NodeField velocity(u_.size());
    for (std::size_t i = 0; i < d.size(); ++i) velocity[i] = (1.0 / step.dt) * d[i];
    for (const auto& term : terms_) term->end_step(fields, v_, velocity);
    for (std::size_t i = 0; i < d.size(); ++i) u_[i] += d[i];
    v_ = velocity;
    ++step_;
  }

  // Of standing still, going on and falling on: where the forces are nearest to balance.
  NodeField best_start(const FemFields& fields, NodeField& d, double dt,
                       const NodeField& acceleration) {
    NodeField best(d.size());
    double least = std::numeric_limits<double>::infinity();
    for (const double fall : {-1.0, 0.0, 1.0}) {
      for (std::size_t i = 0; i < d.size(); ++i) {
        const bool moves = fall >= 0.0 && system_.is_free(static_cast<int>(i));
        d[i] = moves ? dt * v_[i] + (fall * dt * dt) * acceleration[i] : Vec3<double>{};
      }
      const double residual = newton_.residual(fields);
      if (residual < least) least = residual, best = d;
    }
    return best;
  }

  // Goes the whole way at once, or in steps that are halved until each has a solution. Only the
  // first frame's loads are new; later ones only move vertices.
  void find_equilibrium() {
    const Step<double> step{program_.dt * program_.substeps,
                            static_cast<double>(step_ + program_.substeps) * program_.dt};
    constexpr double smallest = 1.0 / 1024.0;
    const bool loading = step_ == 0;
    const NodeField acceleration = accelerations();
    const auto at_start = state();
    for (double done = 0.0, share = 1.0; done < 1.0;) {
      const double goal = done + share, load = loading ? goal : 1.0;
      mass_->set_load(acceleration, load);
      NodeField d(u_.size());
      const FemFields fields{u_, d, step, load};
      for (const auto& term : terms_) term->begin_step(fields);
      std::string problem = newton_.solve(fields, d, moves(step.time, share / (1.0 - done)));
      if (problem.empty() && gave_way(d)) problem = "tets that gave way and turned inside out";
      if (problem.empty()) {
        for (std::size_t i = 0; i < d.size(); ++i) u_[i] += d[i];
        done = goal;
        share = std::min(2.0 * share, 1.0 - done);
        continue;
      }
      for (const auto& term : terms_) term->undo_step();
      share *= 0.5;
      if (share < smallest) {
        set_state(at_start);
        throw Diverged("no equilibrium beyond " + std::to_string(100.0 * done) +
                       " % of the load: " + problem);
      }
    }
    step_ += program_.substeps;
  }

  // A law that loses its stiffness has equilibria that no path from here leads to.
  bool gave_way(const NodeField& d) const {
    bool may = false;
    for_each_slot<EffectKind::element>(
        program_.effects, [&may]<class Effect>(const auto&) { may |= loses_stiffness<Effect>; });
    if (!may) return false;
    NodeField after = u_;
    for (std::size_t i = 0; i < d.size(); ++i) after[i] += d[i];
    return std::ranges::any_of(mesh_.linear, [&](const auto& tet) {
      return is_inverted(tet, after) && !is_inverted(tet, u_);
    });
  }

  NodeField accelerations() const {
    NodeField sum(program_.rest.size());
    for_each_slot<EffectKind::force>(program_.effects, [&]<class Effect>(const auto& force) {
      for (std::size_t i = 0; i < sum.size(); ++i) {
        sum[i] += Effect::acceleration(force.device, program_.rest[i], u_[i], v_[i]);
      }
    });
    return mesh_.on_nodes(std::move(sum));
  }

  // What leads the vertices that are told where to be a share of their way there.
  NodeField moves(double time, double share) const {
    NodeField way(program_.rest.size());
    for_each_slot<EffectKind::motion>(program_.effects, [&]<class Effect>(const auto& motion) {
      for (const int v : motion.vertices) {
        way[v] = share * (Effect::target(motion.device, program_.rest[v], time) - u_[v]);
      }
    });
    way = mesh_.on_nodes(std::move(way));
    for (std::size_t i = program_.rest.size(); i < way.size(); ++i) {
      if (system_.is_free(static_cast<int>(i))) way[i] = {};
    }
    return way;
  }

  const FemOptions options_;
  FemMesh mesh_;
  Program<double> program_;
  FemSystem system_;
  std::vector<double> stiffness_, penalty_;
  FemNewton::Terms terms_;
  MassTerm* mass_ = nullptr;
  FemNewton newton_;
  NodeField u_, v_;  // [nodes] m, m/s
  std::uint64_t step_ = 0;
};

}  // namespace

std::unique_ptr<Solver> make_fem(const Model& model, const Scene& scene,
                                 const SolverOptions& options) {
  return std::make_unique<FemSolver>(model, scene, options);
}

}  // namespace viscera::sim
