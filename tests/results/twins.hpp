// A solver on a device and the same on the CPU, step by step: how far apart do they come? And how
// far does rounding alone take the CPU, in fp32 from the same in fp64, in fp64 from a run that
// begins a rounding error away: where that is far, a distance says nothing of a device. Setting a
// state begins anew: where a run sets one after every frame, as Run::settle() does, these are
// distances after one frame.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "sim/solvers/solver.hpp"

namespace viscera::sim {

// Of all twins that have ended.
struct Agreement {
  static constexpr double allowed = 1e-4;  // at any vertex and frame, over L
  int runs = 0;
  double largest = 0.0;                           // of the runs within that
  std::vector<std::string> farther, by_rounding;  // what is beyond it, alone and as the CPU itself
};
inline Agreement& agreement() {
  static Agreement all;
  return all;
}

class Twins final : public Solver {
 public:
  // `disturbed` is `cpu` in fp64, which begins up to `disturbance` away, over the body's `size`, m;
  // `name` says what it is that runs.
  Twins(std::unique_ptr<Solver> device, std::unique_ptr<Solver> cpu,
        std::unique_ptr<Solver> disturbed, double size, double disturbance, std::string name)
      : device_(std::move(device)),
        cpu_(std::move(cpu)),
        disturbed_(std::move(disturbed)),
        size_(size),
        disturbance_(disturbance),
        name_(std::move(name)) {
    disturb(disturbed_->state());
  }
  ~Twins() override {
    Agreement& all = agreement();
    ++all.runs;
    const std::string found = fmt::format("{}: {:.2g} L in {} frames, {:.2g} by rounding alone",
                                          name_, apart_, frames_, by_rounding_);
    if (apart_ <= Agreement::allowed) {
      all.largest = std::max(all.largest, apart_);
    } else if (by_rounding_ <= Agreement::allowed) {
      all.farther.push_back(found);
    } else {
      all.by_rounding.push_back(found);
    }
  }
  void advance_frame() override {
    device_->advance_frame();
    cpu_->advance_frame();
    disturbed_->advance_frame();
    const State on_cpu = cpu_->state();
    ++frames_;
    raise(apart_, device_->state(), on_cpu);
    raise(by_rounding_, disturbed_->state(), on_cpu);
  }
  State state() const override { return device_->state(); }
  void set_state(const State& state) override {
    device_->set_state(state);
    cpu_->set_state(state);
    disturb(state);
  }
  void retune(const Model& model, const Scene& scene) override {
    device_->retune(model, scene);
    cpu_->retune(model, scene);
    disturbed_->retune(model, scene);
  }
  void steer(const Scene& scene) override {
    device_->steer(scene);
    cpu_->steer(scene);
    disturbed_->steer(scene);
  }
  std::size_t contact_count() const override { return device_->contact_count(); }
  std::string device() const override { return device_->device(); }

 private:
  void disturb(State state) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> off(-disturbance_ * size_, disturbance_ * size_);
    for (auto& u : state.u) u += Vec3<double>{off(random), off(random), off(random)};
    disturbed_->set_state(state);
  }
  // What is no number stays.
  void raise(double& largest, const State& a, const State& b) const {
    for (std::size_t i = 0; i < a.u.size(); ++i) {
      const double apart = norm(a.u[i] - b.u[i]) / size_;
      if (!std::isnan(largest) && !(apart <= largest)) largest = apart;
    }
  }

  std::unique_ptr<Solver> device_, cpu_, disturbed_;
  double size_, disturbance_;  // m; over the size
  std::string name_;
  double apart_ = 0.0, by_rounding_ = 0.0;  // over the size
  int frames_ = 0;
};

}  // namespace viscera::sim
