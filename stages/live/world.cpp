#include "stages/live/world.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <numbers>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "sim/base/best_rotation.hpp"
#include "sim/model/start.hpp"
#include "sim/solvers/time_rule.hpp"
#include "stages/simulate/body.hpp"
#include "stages/simulate/files/checkpoint.hpp"
#include "stages/simulate/solver_choice.hpp"

namespace viscera::live {
namespace {

using Ball = sim::Collider<sim::Sphere>;
using Clock = std::chrono::steady_clock;

constexpr double hold_frequency = 40.0;  // Hz
constexpr double weights_to_lift = 2.0;  // of the body: the most that a hand pulls with
constexpr double gravity = 9.80665;      // m/s2
constexpr int min_held = 8;              // vertices: fewer would be torn out
constexpr double hold_of_size = 0.1, tool_of_size = 0.08;  // radii by the body's size

Error refused(std::string field, std::string found, std::string allowed, std::string remedy = "") {
  return Error(ExitCode::bad_config, {.where = "input",
                                      .field = std::move(field),
                                      .found = std::move(found),
                                      .allowed = std::move(allowed),
                                      .remedy = std::move(remedy)});
}

// A hand that holds nothing, as a further effect of the scene, and its ball, still out of reach. A
// ball that nobody uses would cost a tenth of a frame.
void add_hand(sim::Scene& scene, const sim::Model& model, bool has_tool) {
  auto& grip = scene.params<sim::Grip>().emplace_back();
  grip.point = model.origin;
  grip.radius = hold_of_size * model.size();
  grip.frequency = 0.0;
  if (!has_tool) return;
  auto& ball = scene.params<Ball>().emplace_back();
  ball.center = model.origin + Point{0.0, 0.0, 1e3 * model.size()};
  ball.radius = tool_of_size * model.size();
}

struct Flesh {  // around a point of the body at rest
  double radius;
  int vertices;
  double mass;  // weighted as the grip holds it, kg
};

// The smallest radius from the usual one on that holds enough vertices.
Flesh flesh_around(const sim::Model& model, const Point& point) {
  Flesh flesh{hold_of_size * model.size(), 0, 0.0};
  for (;; flesh.radius *= 1.25) {
    flesh.vertices = 0, flesh.mass = 0.0;
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      const Point from = model.rest[i] - point;
      const double left = 1.0 - dot(from, from) / (flesh.radius * flesh.radius);
      if (left <= 0.0) continue;
      ++flesh.vertices;
      flesh.mass += model.mass[i] * left * left;
    }
    if (flesh.vertices >= min_held || flesh.radius > model.size()) return flesh;
  }
}

// The point is on the inner side of all four faces.
bool is_within(const Point& p, const std::array<Point, 4>& x) {
  const auto volume = [](const Point& a, const Point& b, const Point& c, const Point& d) {
    return dot(cross(b - a, c - a), d - a);
  };
  return volume(p, x[1], x[2], x[3]) > 0.0 && volume(x[0], p, x[2], x[3]) > 0.0 &&
         volume(x[0], x[1], p, x[3]) > 0.0 && volume(x[0], x[1], x[2], p) > 0.0;
}

// How the flesh has turned: axis times angle.
Point turn_of(const sim::Model& model, const sim::State& state, int vertex, double radius) {
  sim::Mat3<double> moment{};
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const Point from = model.rest[i] - model.rest[vertex];
    if (dot(from, from) > radius * radius) continue;
    const Point now = from + state.u[i] - state.u[vertex];
    moment.col[0] += (model.mass[i] * from.x) * now;
    moment.col[1] += (model.mass[i] * from.y) * now;
    moment.col[2] += (model.mass[i] * from.z) * now;
  }
  const auto q = sim::best_rotation(moment);
  const double sine = norm(q.v);
  if (sine == 0.0) return {};
  const double angle = 2.0 * std::atan2(sine, q.w);
  return (angle / sine) * q.v;
}

}  // namespace

World::World(StageRun run) : run_(std::move(run)) {
  translated(run_, [this] {
    setup_ = set_up(run_);
    if (!setup_.file.schedule.empty()) {
      log::warn("the scene's schedule is not followed: the values change by hand");
    }
    hand_.tool_radius = tool_of_size * setup_.model.size();
    take(Json::object(), false);
    start_ = solver_->state();
    if (run_.has_input("checkpoint")) {
      start_ = read_checkpoint(run_.input("checkpoint"), setup_.model.vertex_count(),
                               setting_->scene.time, fingerprint_of(setup_.model));
      check_start(setup_.model, start_);
    }
    start_.step /= setting_->scene.time.substeps;
    start_again();
  });
}

void World::apply(const Command& command) {
  struct Apply {
    World& world;
    void operator()(const Grab& c) const { world.grab(c.vertex); }
    void operator()(const Drag& c) const {
      if (!world.hand_.holds) return;
      world.lead_to(world.grabbed_at_ + mm_to_m * c.by_mm);
    }
    void operator()(const Release&) const { world.release(); }
    void operator()(const MoveTool& c) const { world.move_tool(mm_to_m * c.to_mm); }
    void operator()(const LiftTool&) const { world.lift_tool(); }
    void operator()(const Change& c) const {
      Json changes = world.setting_->changes;
      changes.update(c.values);
      world.take(std::move(changes), world.hand_.has_tool);
    }
    void operator()(const Drop&) const { world.start_again(); }
    void operator()(const Reset&) const {
      world.take(Json::object(), false);
      world.hand_.has_tool = false;
      world.start_again();
    }
  };
  const auto begin = Clock::now();
  // What was refused leaves the hand and the scene as they were.
  const sim::Scene before = scene_;
  const Hand hand = hand_;
  try {
    translated(run_, [&] {
      std::visit(Apply{*this}, command);
      sim::check_scene(scene_);
    });
  } catch (const Error&) {
    scene_ = before, hand_ = hand;
    throw;
  }
  spent_["input"] += std::chrono::duration<double>(Clock::now() - begin).count();
}

void World::advance() {
  if (is_steered_) {
    if (hand_.has_tool) {
      auto& tool = scene_.params<Ball>().back();
      tool.center = hand_.tool;
      tool.velocity = (1.0 / frame_s()) * (sent_to_ - hand_.tool);
      tool.start = time_s();
      tool.stop = tool.start + frame_s();
    }
    solver_->steer(scene_);
    hand_.tool = sent_to_;
    is_steered_ = false;
  }
  solver_->advance_frame();
  ++frame_;
}

void World::go_back_to(sim::State state, std::uint64_t frame) {
  state.step = frame * setting_->scene.time.substeps;
  solver_->set_state(state);
  frame_ = frame;
  take_hand_off();
}

Point World::pull(const sim::State& state) const {
  Point sum;
  if (!hand_.holds) return sum;
  const sim::Model& model = setup_.model;
  const double acts_s = sim::acting_time_of(setting_->scene, setting_->options);
  const auto hold = sim::Grip::device<double>(model, scene_.params<sim::Grip>().back(), acts_s);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    sum += model.mass[i] * sim::Grip::acceleration(hold, model.rest[i], state.u[i], state.v[i]);
  }
  return sum;
}

Seconds World::seconds() const {
  Seconds all = spent_;
  for (const auto& [part, s] : solver_->seconds()) all[part] += s;
  return all;
}

void World::grab(int vertex) {
  const sim::Model& model = setup_.model;
  const int count = static_cast<int>(model.vertex_count());
  if (vertex < 0 || vertex >= count) {
    throw refused("grab", fmt::format("vertex {}", vertex), fmt::format("0 to {}", count - 1),
                  "take input that was recorded on this mesh");
  }
  const sim::State now = solver_->state();
  const Flesh flesh = flesh_around(model, model.rest[vertex]);
  const double omega = 2.0 * std::numbers::pi * hold_frequency;
  auto& hold = grip();
  hold.point = model.origin + model.rest[vertex];
  hold.radius = flesh.radius;
  grabbed_at_ = now.u[vertex];
  hold.rotation = turn_of(model, now, vertex, flesh.radius);
  hold.frequency = hold_frequency;
  double mass = 0.0;
  for (const double m : model.mass) mass += m;
  hold.reach = weights_to_lift * gravity * mass / (omega * omega * flesh.mass);
  hand_.holds = true;
  lead_to(grabbed_at_);
}

void World::lead_to(const Point& offset) {
  grip().offset = offset;
  steer();
}

void World::take_hand_off() {
  lift_tool();
  scene_ = setting_->scene;
  hand_ = {.tool_radius = hand_.tool_radius};
  steer();
}

void World::release() {
  grip().frequency = 0.0;
  hand_.holds = false;
  steer();
}

void World::move_tool(const Point& to) {
  // What is out of range is refused here and not in the frame to come.
  const double fastest = 1e3;  // m/s, as the effect's params have it
  if (!std::isfinite(dot(to, to)) || norm(to) > 1e6) {
    throw refused("tool", fmt::format("[{}, {}, {}] m", to.x, to.y, to.z), "a place in the scene");
  }
  if (!hand_.has_tool) {
    check_room_for_tool(to);
    take(setting_->changes, true);
    hand_.has_tool = true;
    hand_.tool = to;
  }
  const double speed = norm(to - hand_.tool) / frame_s();
  if (speed > fastest) {
    throw refused("tool", fmt::format("{:.4g} m/s", speed), fmt::format("{} m/s at most", fastest),
                  "move it in several frames");
  }
  sent_to_ = to;
  steer();
}

void World::lift_tool() {
  if (!hand_.has_tool) return;
  take(setting_->changes, false);
  hand_.has_tool = false;
}

// A ball that appears within the body would be thrown out at its depth over the substep.
void World::check_room_for_tool(const Point& center) const {
  const sim::State now = solver_->state();
  const sim::Model& model = setup_.model;
  const auto at = [&](int v) { return model.origin + model.rest[v] + now.u[v]; };
  int inside = 0;
  for (std::size_t i = 0; i < now.u.size(); ++i) {
    inside += norm(at(static_cast<int>(i)) - center) < hand_.tool_radius;
  }
  const bool within = std::ranges::any_of(model.tets, [&](const sim::Tet& tet) {
    return is_within(center, {at(tet[0]), at(tet[1]), at(tet[2]), at(tet[3])});
  });
  if (inside == 0 && !within) return;
  throw refused("tool",
                fmt::format("{} vertices of the body within the ball, its centre {} the body",
                            inside, within ? "in" : "outside"),
                "a place beside the body", "let it appear outside, then press it in");
}

// By retuning the solver, or by another one where the values need more substeps or another form, or
// the tool comes or goes.
void World::take(Json changes, bool has_tool) {
  sim::Model& model = setup_.model;
  Json all = run_.params().at("change");
  all.update(changes);
  SceneFile file = scene_of(run_, all);
  const bool begins_anew = changes.empty();
  if (setting_ && !begins_anew) {
    const double time_s =
        frame_s() * static_cast<double>(solver_->state().step) / setting_->scene.time.substeps;
    sim::go_on_from(setting_->scene.effects, file.scene.effects, time_s);
  }
  add_hand(file.scene, model, has_tool);
  const auto materials = model.materials;
  try {
    for (std::size_t i = 0; i < materials.size(); ++i) {
      const std::string& name = model.label_names[i];
      model.materials[i] = file.materials.at(name);
      if (model.materials[i].density == materials[i].density) continue;
      throw refused("materials." + name + ".density", "another density than at the start",
                    "E, nu and damping: masses stay", "begin another session");
    }
    auto next = std::make_shared<Setting>();
    next->changes = std::move(changes);
    next->materials = model.materials;
    next->scene = std::move(file.scene);
    if (setting_ && !begins_anew) {
      next->scene.time.substeps =
          std::max(next->scene.time.substeps, setting_->scene.time.substeps);
      sim::keep_forms(setting_->scene, next->scene);
    }
    next->options = solver_choice(run_, model, next->scene).options;
    next->stability = sim::apply_policy(model, next->scene, next->options);
    const bool same =
        setting_ && has_tool == hand_.has_tool &&
        next->options.scheme == setting_->options.scheme &&
        next->stability.switched == setting_->stability.switched &&
        next->scene.has<sim::GroupedVolume>() == setting_->scene.has<sim::GroupedVolume>() &&
        next->scene.time.substeps == setting_->scene.time.substeps;
    if (same) {
      solver_->retune(model, next->scene);
    } else {
      replace_solver(*next);
    }
    const auto hold = setting_ ? grip() : next->scene.params<sim::Grip>().back();
    setting_ = std::move(next);
    scene_ = setting_->scene;
    grip() = hold;
  } catch (...) {
    model.materials = materials;
    throw;
  }
  steer();
}

void World::replace_solver(const Setting& next) {
  auto other = choose_solver(run_, setup_.model, next.scene, next.options);
  if (solver_) {
    const int before = setting_->scene.time.substeps, now = next.scene.time.substeps;
    sim::State state = solver_->state();
    state.step = state.step / before * now;
    if (now != before) state.forget_added();
    other->set_state(state);
    spent_ = seconds();
    if (now != before) log::warn("substeps a frame: {} in place of {}", now, before);
  }
  solver_ = std::move(other);
}

void World::start_again() {
  go_back_to(start_, start_.step);
}

}  // namespace viscera::live
