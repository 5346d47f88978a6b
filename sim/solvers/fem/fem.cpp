// Time and load of the implicit finite elements. A step makes
//
//   1/2 (d - y)^T M (d - y) / g^2 + potential(u + d),   y = g v + g^2 a
//
// smallest. To first order (implicit Euler) u and v are those at its start and g is its length; to
// second order (BDF2) they are further on by a share of the last changes (time_rule.hpp), and a
// step whose error is too large is made in shorter ones (fem/step_length.hpp). An equilibrium is
// the same without inertia. try_step() and find_equilibrium() say how they get there; one step's
// Newton iterations are in fem/newton.hpp. Double precision and one thread, whatever the options
// say.
#include "sim/solvers/fem/fem.hpp"

#include <limits>

#include "sim/base/refusal.hpp"
#include "sim/solvers/fem/contact.hpp"
#include "sim/solvers/fem/diagnostics.hpp"
#include "sim/solvers/fem/effect.hpp"
#include "sim/solvers/fem/kept_nodes.hpp"
#include "sim/solvers/fem/law.hpp"
#include "sim/solvers/fem/mass.hpp"
#include "sim/solvers/fem/newton.hpp"
#include "sim/solvers/fem/nodes.hpp"
#include "sim/solvers/fem/step_length.hpp"

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
  if (!(options.step_error > 0.0 && options.step_error <= 1.0)) {
    refuse("fem.step_error", std::to_string(options.step_error), "above 0, at most 1");
  }
  return options;
}

template <class Effect>
constexpr bool loses_stiffness = [] {
  if constexpr (requires { Effect::loses_stiffness; }) return Effect::loses_stiffness;
  return false;
}();

// The finite elements have no limit of stability, and so no need of another form.
const Scene& checked(const Scene& scene) {
  const auto check = [](const auto& laws) {
    for (const auto& params : laws) {
      if (!params.taken.empty()) {
        refuse("stability", "form, with tets that another law has", "neo_hookean on every tet",
               "apply the policy for this solver");
      }
    }
  };
  check(scene.params<NeoHookean>()), check(scene.params<SmoothedNeoHookean>());
  return scene;
}

// Whether a tet is inside out at one of its points.
template <int nodes>
bool is_inverted(const FemElement<nodes>& tet, const NodeField& u) {
  return std::ranges::any_of(tet.points, [&](const auto& point) {
    return 1.0 + NeoHookean::volume_strain(gradient_at<nodes>(tet.nodes, point, u)) <= 0.0;
  });
}

std::vector<double> times(double factor, std::vector<double> numbers) {
  for (double& number : numbers) number *= factor;
  return numbers;
}

class FemSolver final : public Solver, public FemRest {
 public:
  FemSolver(const Model& model, const Scene& scene, const SolverOptions& options)
      : options_(checked(options.fem)),
        is_smooth_(order_of(scene, options) == 2),
        mesh_(model, options_.order),
        of_linear_tets_(model, mesh_),
        program_(mesh_.body(model), checked(scene)),
        system_(held_nodes(mesh_, program_), options_.linear),
        stiffness_(mesh_.node_count()),
        newton_(system_, terms_, options_, stiffness_, options.pause_point),
        u_(mesh_.node_count()),
        v_(mesh_.node_count()),
        size_(model.size()) {
    weight_ = free_masses(mesh_, system_);
    begin_anew();
    take_stiffness(model);
    take_domains(model, scene);
    auto mass = std::make_unique<MassTerm>(mesh_.mass);
    mass_ = mass.get();
    terms_.push_back(std::move(mass));
    for_each_slot<EffectKind::element>(program_.effects, [&]<class Effect>(const auto& effect) {
      add_term<Effect>(model, effect);
    });
    first_contact_ = terms_.size();
    for_each_slot<EffectKind::contact>(program_.effects, [&]<class Effect>(const auto& effect) {
      terms_.push_back(std::make_unique<ContactTerm<Effect>>(effect, mesh_, penalty_));
    });
    for (const auto& term : terms_) term->connect(system_);
    system_.analyse();
    for (const auto& term : terms_) term->take_places(system_);
  }

  void advance_frame() override {
    if (options_.is_static()) {
      find_equilibrium();
    } else {
      for (int substep = 0; substep < program_.substeps; ++substep) advance_step();
    }
  }

  State state() const override {
    const auto n = vertex_count();
    State state{{u_.begin(), u_.begin() + n}, {v_.begin(), v_.begin() + n}, step_};
    for (const NodeField* field : {&u_, &v_})
      append_vectors(field->begin() + n, field->end(), state.nodes);
    if (is_smooth_) {
      Program<double>::save_added({last_.begin(), last_.begin() + n}, state);
      for (auto last = last_.begin() + n; last != last_.end(); ++last) {
        append_vectors(&last->u, &last->u + 1, state.nodes);
        append_vectors(&last->v, &last->v + 1, state.nodes);
      }
      state.nodes.insert(state.nodes.end(), {last_s_, static_cast<double>(length_.longest())});
    }
    for (std::size_t i = 0; i < terms_.size(); ++i)
      terms_[i]->save_history(i < first_contact_ ? state.history : state.nodes);
    return state;
  }
  void set_state(const State& state) override {
    const bool has_past = knows_past(state);
    std::span<const double> history = state.history, contacts = take_nodes(state, u_, v_);
    begin_anew();
    if (has_past) take_past(state, contacts);
    std::vector<double> shared_out;
    if (is_of_linear_tets(state)) contacts = shared_out = of_linear_tets_.on_nodes(state.nodes);
    knows_contact_ = !contacts.empty();
    for (std::size_t i = 0; i < terms_.size(); ++i)
      terms_[i]->load_history(i < first_contact_ ? history : contacts);
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
    return fem_diagnostics(mesh_, model, scene, u, v);
  }
  std::size_t contact_count() const override {
    std::size_t count = 0;
    for (const auto& term : terms_) count += term->contact_count();
    return count;
  }
  std::string device() const override { return "cpu, 1 thread"; }

  std::vector<Vec3<double>> places() const override {
    NodeField at = u_;
    const NodeField way = moves(end_of_frame(), 1.0);
    for (std::size_t i = 0; i < at.size(); ++i) at[i] += way[i];
    return at;
  }
  bool is_free(int node) const override { return system_.is_free(node); }
  bool touches_obstacles() const override { return contact_count() > 0; }
  std::vector<Vec3<double>> forces() override {
    FemForces all(u_.size());
    at_rest([&](const FemFields& fields) {
      for (const auto& term : terms_) term->add_forces(fields, all);
    });
    return all.sum;
  }
  std::vector<Vec3<double>> moved_by(const std::vector<Vec3<double>>& forces) override {
    NodeField step;
    bool solved = false;
    at_rest([&](const FemFields& fields) {
      system_.begin(forces, NodeField(u_.size()));
      for (const auto& term : terms_) term->add_tangent(fields, Tangent::exact, system_);
      solved = system_.solve(options_.tolerance, step);
    });
    if (!solved) throw Diverged("no stable equilibrium: the body would give way");
    return step;
  }

 private:
  // Large enough for few rounds of multipliers, small enough for the condition of the system.
  static constexpr double penalty_factor = 1e3;
  // Equilibria start farther from where they end, and with a stiff penalty Newton's steps halve
  // again and again where nodes come and go: a liver of 10,000 quadratic tets on a plane took more
  // than 46 iterations at 1,000 and 100, and 33 at 10.
  static constexpr double static_penalty_factor = 10.0;
  // Of the body's size: a node that rests on an obstacle by another solver is no farther from it.
  static constexpr double contact_reach = 1e-4;

  std::ptrdiff_t vertex_count() const { return static_cast<std::ptrdiff_t>(program_.rest.size()); }

  bool is_of_linear_tets(const State& state) const {
    return of_linear_tets_.is(state.nodes, terms_.size() - first_contact_);
  }
  // What a state knows of all nodes; returns what else it knows of them.
  std::span<const double> take_nodes(const State& state, NodeField& u, NodeField& v) const {
    std::span<const double> known = state.nodes;
    if (is_of_linear_tets(state)) known = {};
    return sim::take_nodes(mesh_, state, known, u, v);
  }

  // What the last step has added to midside nodes, its length and that of the next.
  std::size_t past_size() const {
    return 6 * (u_.size() - static_cast<std::size_t>(vertex_count())) + 2;
  }
  // Whether a state is of these elements and of steps of second order.
  bool knows_past(const State& state) const {
    const std::size_t own = this->state().nodes.size() - (is_smooth_ ? past_size() : 0);
    return state.nodes.size() == own + past_size() && state.added_u.size() == state.u.size();
  }
  // From the front of what is left. Steps of first order, and equilibria, do not need it.
  void take_past(const State& state, std::span<const double>& known) {
    std::span<const double> past = known.first(past_size());
    known = known.subspan(past_size());
    if (!is_smooth_) return;
    const auto n = static_cast<std::size_t>(vertex_count());
    for (std::size_t i = 0; i < n; ++i) last_[i] = {state.added_u[i], state.added_v[i]};
    for (std::size_t i = n; i < last_.size(); ++i) {
      last_[i].u = take_vector(past);
      last_[i].v = take_vector(past);
    }
    last_s_ = past[0];
    length_ = StepLength(static_cast<int>(std::clamp(past[1], 1.0, double{StepLength::parts})));
  }

  // Without a past: the first step is short, and what went before is assumed.
  void begin_anew() {
    last_.assign(u_.size(), {});
    last_s_ = 0.0;
    length_ = StepLength(1);
  }

  void take_stiffness(const Model& model) {
    elastic_ = node_stiffness(model, mesh_);
    take_inertia(program_.dt);
  }
  // That of a step over whose time forces act for so long, s, and contact's penalty with it, so
  // that a round of multipliers gains as much in a short step (fem/newton.cpp has the factor).
  void take_inertia(double acts) {
    const double share = options_.is_static() ? 0.0 : 1.0 / (acts * acts);
    for (std::size_t i = 0; i < stiffness_.size(); ++i) {
      stiffness_[i] =
          elastic_[i] + share * mesh_.mass.coeff(static_cast<int>(i), static_cast<int>(i));
    }
    penalty_ = times(options_.is_static() ? static_penalty_factor : penalty_factor, stiffness_);
  }

  // Those of a law on smoothed elements; several terms of one law are on the same.
  void take_domains(const Model& model, const Scene& scene) {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (is_smoothed<Effect>) {
        const auto& laws = std::get<i>(scene.effects);
        if (laws.empty()) return;
        domains_ = Effect::domains(model, laws.front());
        beside_groups_ = laws.front().beside_groups;
        mesh_.take(*domains_);
      }
    });
  }

  template <class Effect>
  void add_term(const Model& model, const Prepared<Effect, double>& effect) {
    if (needs_rate<Effect> && options_.is_static()) return;
    if constexpr (std::is_same_v<Effect, NeoHookean>) {
      if (mesh_.order == 1) {
        terms_.push_back(std::make_unique<NeoHookeanTerm<4>>(model, mesh_));
      } else {
        terms_.push_back(std::make_unique<NeoHookeanTerm<10>>(model, mesh_));
      }
      return;
    }
    if constexpr (states_stress<Effect> && !is_smoothed<Effect>) {
      if (mesh_.order == 2) {
        terms_.push_back(std::make_unique<LawTerm<Effect, 10>>(mesh_, effect.rest));
        return;
      }
    }
    if (mesh_.order != 1 && Effect::arity > 1) {
      refuse((std::string("effects.") + Effect::name).c_str(), "quadratic tets",
             "laws of elasticity and effects of single nodes", "use fem.order 1");
    }
    if constexpr (std::is_same_v<Effect, SmoothedNeoHookean>) {
      terms_.push_back(std::make_unique<NeoHookeanTerm<Effect::arity>>(
          model, mesh_,
          [law = SmoothedNeoHookean::Params{{}, domains_, beside_groups_}](const Model& now,
                                                                           std::size_t e) {
            return SmoothedNeoHookean::lame_of(now, *law.made, e, law);
          }));
    } else if constexpr (is_smoothed<Effect>) {
      terms_.push_back(std::make_unique<LawTerm<Effect, Effect::arity>>(mesh_, effect.rest));
    } else if constexpr (!std::is_same_v<Effect, NeoHookean>) {
      terms_.push_back(std::make_unique<EffectTerm<Effect>>(effect, program_.dt));
    }
  }

  // A step of the grid.
  void advance_step() {
    const double begin_s = static_cast<double>(step_) * program_.dt;
    const double part_s = program_.dt / StepLength::parts;
    for (int part = 0; part < StepLength::parts;) {
      const int length = is_smooth_ ? length_.from(part) : StepLength::parts;
      const double end_s = begin_s + (part + length) * part_s;
      const bool may_fail = is_smooth_ && length > 1;
      const Attempt attempt = try_step(length * part_s, end_s, may_fail);
      if (attempt.problem.empty() && (attempt.error <= 1.0 || !may_fail)) {
        length_.made(length, attempt.error);
        part += length;
      } else if (may_fail) {
        length_.failed(length);
      } else {
        throw Diverged(attempt.problem);
      }
    }
    ++step_;
  }

  struct Attempt {
    std::string problem;  // why there is no solution; empty where there is one
    double error = 0.0;   // over what a step may be off by
  };

  // A step of h seconds that ends at `time`. Where it has no solution, or where it `may_fail` and
  // its error is too large, all is as before.
  Attempt try_step(double h, double time, bool may_fail) {
    if (is_smooth_ && last_s_ == 0.0) assume_past(h);
    const auto rule = is_smooth_ ? TimeRule<double>::after(h, last_s_) : TimeRule<double>::of(h, 1);
    take_inertia(rule.acts);
    const NodeField acceleration = accelerations();
    NodeField u(u_.size()), v(u_.size()), d(u_.size());
    for (std::size_t i = 0; i < u.size(); ++i) {
      u[i] = rule.place(u_[i], last_[i]), v[i] = rule.velocity(v_[i], last_[i]);
    }
    mass_->set_motion(v, acceleration, rule.acts);
    const FemFields fields{u, d, {rule.acts, time}, u_, h};
    for (const auto& term : terms_) term->begin_step(fields);
    d = best_start(fields, d, v, acceleration);
    Attempt attempt{newton_.solve(fields, d, moves(time, 1.0))};
    if (attempt.problem.empty() && is_smooth_) attempt.error = step_error(fields, rule);
    if (!attempt.problem.empty() || (may_fail && attempt.error > 1.0)) {
      for (const auto& term : terms_) term->undo_step();
      return attempt;
    }
    end_step(fields, rule);
    last_s_ = h;
    return attempt;
  }

  // What a step of h seconds has added that the forces from outside alone explain.
  void assume_past(double h) {
    const auto n = vertex_count();
    const auto added =
        program_.added_before({{u_.begin(), u_.begin() + n}, {v_.begin(), v_.begin() + n}});
    NodeField acceleration(program_.rest.size());
    for (std::size_t i = 0; i < acceleration.size(); ++i) {
      acceleration[i] = (1.0 / program_.dt) * added[i].v;
    }
    acceleration = mesh_.on_nodes(std::move(acceleration));
    for (std::size_t i = 0; i < u_.size(); ++i) {
      if (!system_.is_free(static_cast<int>(i))) continue;
      last_[i] = {h * v_[i] - (0.5 * h * h) * acceleration[i], h * acceleration[i]};
    }
    last_s_ = h;
  }

  void end_step(const FemFields& fields, const TimeRule<double>& rule) {
    const NodeField before = v_;
    for (std::size_t i = 0; i < u_.size(); ++i) {
      const Vec3<double> way = fields.u[i] - u_[i] + fields.d[i];
      rule.end(system_.is_free(static_cast<int>(i)), way, u_[i], v_[i], last_[i]);
    }
    for (const auto& term : terms_) {
      if (rule.share == 0.0) {
        term->end_step(fields, before, v_);
        continue;
      }
      NodeField stops(u_.size());
      term->add_stops(stops);
      for (std::size_t i = 0; i < stops.size(); ++i) {
        if (touches(stops[i])) rule.after_stop(stops[i], last_[i].u, v_[i], last_[i]);
      }
    }
  }

  // Of a solved step, over what it may be (fem/step_length.hpp).
  double step_error(const FemFields& fields, const TimeRule<double>& rule) const {
    NodeField stops(u_.size());
    for (const auto& term : terms_) term->add_stops(stops);
    double off = 0.0, moved = 0.0, mass = 0.0;
    for (std::size_t i = 0; i < u_.size(); ++i) {
      const Vec3<double> way = fields.u[i] - u_[i] + fields.d[i];
      moved += weight_[i] * dot(way, way);
      mass += weight_[i];
      if (touches(stops[i])) continue;
      const Vec3<double> miss = way - rule.dt * (v_[i] + (0.5 * rule.dt / last_s_) * last_[i].v);
      off += weight_[i] * dot(miss, miss);
    }
    if (mass == 0.0) return 0.0;
    const double floor = StepLength::slow * size_ * rule.dt;
    return share_of_prediction(rule.dt, last_s_) * std::sqrt(off / mass) /
           (options_.step_error * (std::sqrt(moved / mass) + floor));
  }

  // Of standing still, going on and falling on: where the forces are nearest to balance.
  NodeField best_start(const FemFields& fields, NodeField& d, const NodeField& v,
                       const NodeField& acceleration) {
    NodeField best(d.size());
    double least = std::numeric_limits<double>::infinity();
    const double dt = fields.step.dt;
    for (const double fall : {-1.0, 0.0, 1.0}) {
      for (std::size_t i = 0; i < d.size(); ++i) {
        const bool moves = fall >= 0.0 && system_.is_free(static_cast<int>(i));
        d[i] =
            moves ? dt * v[i] + (fall * dt * dt) * acceleration[i] : fields.start[i] - fields.u[i];
      }
      const double residual = newton_.residual(fields);
      if (residual < least) least = residual, best = d;
    }
    return best;
  }

  // Goes the whole way at once, or in steps that are halved until each has a solution. Only the
  // first frame's loads are new; later ones only move vertices.
  void find_equilibrium() {
    const Step<double> step{program_.dt * program_.substeps, end_of_frame()};
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
      if (!knows_contact_ && !loading) assume_contact(fields);
      std::string problem = newton_.solve(fields, d, moves(step.time, share / (1.0 - done)));
      if (problem.empty() && gave_way(d)) problem = "tets that gave way and turned inside out";
      if (problem.empty()) {
        for (std::size_t i = 0; i < d.size(); ++i) u_[i] += d[i];
        done = goal;
        share = std::min(2.0 * share, 1.0 - done);
        knows_contact_ = true;
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

  double end_of_frame() const {
    return static_cast<double>(step_ + program_.substeps) * program_.dt;
  }
  // work(fields) at places(), with all loads on.
  template <class Work>
  void at_rest(const Work& work) {
    const Step<double> step{program_.dt * program_.substeps, end_of_frame()};
    const NodeField d = moves(step.time, 1.0);
    const FemFields fields{u_, d, step};
    mass_->set_load(accelerations(), 1.0);
    for (const auto& term : terms_) term->begin_step(fields);
    work(fields);
    for (const auto& term : terms_) term->undo_step();
  }

  // A body that another solver has brought to rest is held by its contacts: without them it would
  // slide before friction is known.
  void assume_contact(const FemFields& fields) {
    FemForces others(u_.size());
    for (std::size_t t = 0; t < first_contact_; ++t) terms_[t]->add_forces(fields, others);
    for (auto& force : others.sum) force = -force;
    for (std::size_t t = first_contact_; t < terms_.size(); ++t) {
      terms_[t]->assume_contact(fields, others.sum, contact_reach * size_);
    }
  }

  // A law that loses its stiffness has equilibria that no path from here leads to.
  bool gave_way(const NodeField& d) const {
    bool may = false;
    for_each_slot<EffectKind::element>(program_.effects, [&may]<class Effect>(const auto&) {
      may |= loses_stiffness<law_of<Effect>>;
    });
    if (!may) return false;
    NodeField after = u_;
    for (std::size_t i = 0; i < d.size(); ++i) after[i] += d[i];
    const auto turned = [&](const auto& tet) {
      return is_inverted(tet, after) && !is_inverted(tet, u_);
    };
    return std::ranges::any_of(mesh_.linear, turned) ||
           std::ranges::any_of(mesh_.quadratic, turned);
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
  const bool is_smooth_;  // steps are of second order
  FemMesh mesh_;
  ContactOfLinearTets of_linear_tets_;
  std::shared_ptr<const EdgeDomains> domains_;  // of smoothed elements
  bool beside_groups_ = false;                  // of tets, which have a part of the volume
  Program<double> program_;
  FemSystem system_;
  std::vector<double> elastic_, stiffness_, penalty_;  // [nodes] N/m; the second with inertia
  FemNewton::Terms terms_;
  std::size_t first_contact_ = 0;  // of the terms, which are the last
  bool knows_contact_ = true;      // whether their multipliers are of the state at hand
  MassTerm* mass_ = nullptr;
  FemNewton newton_;
  NodeField u_, v_;                  // [nodes] m, m/s
  std::vector<Added<double>> last_;  // [nodes] what the last step has added
  double last_s_ = 0.0;              // s, of that step
  StepLength length_;
  std::vector<double> weight_;  // [nodes] kg, 0 where a node is led or held
  double size_;                 // m, of the body
  std::uint64_t step_ = 0;
};

}  // namespace

std::unique_ptr<Solver> make_fem(const Model& model, const Scene& scene,
                                 const SolverOptions& options) {
  return std::make_unique<FemSolver>(model, scene, options);
}

std::unique_ptr<FemRest> make_fem_rest(const Model& model, const Scene& scene,
                                       const SolverOptions& options, const State& state) {
  auto rest = std::make_unique<FemSolver>(model, scene, options);
  rest->set_state(state);
  return rest;
}

}  // namespace viscera::sim
