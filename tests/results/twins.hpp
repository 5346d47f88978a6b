// A solver on a device and the same on the CPU, step by step: how far apart do they come?
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "sim/solvers/solver.hpp"

namespace viscera::sim {

// Of all twins that have ended; those that have blown up, in which rounding grows without bound,
// count apart.
struct Agreement {
  static constexpr double allowed = 1e-4;  // at any vertex and frame, over L
  int runs = 0, blown_up = 0;
  double largest = 0.0;              // of those that are within what is allowed
  std::vector<std::string> farther;  // what the others are
};
inline Agreement& agreement() {
  static Agreement all;
  return all;
}

class Twins final : public Solver {
 public:
  // `size` is the body's, m; `name` says what it is that runs.
  Twins(std::unique_ptr<Solver> device, std::unique_ptr<Solver> cpu, double size, std::string name)
      : device_(std::move(device)), cpu_(std::move(cpu)), size_(size), name_(std::move(name)) {}
  ~Twins() override {
    Agreement& all = agreement();
    ++(finite_ ? all.runs : all.blown_up);
    if (!finite_) return;
    if (apart_ <= Agreement::allowed) {
      all.largest = std::max(all.largest, apart_);
    } else {
      all.farther.push_back(fmt::format("{}: {:.2g} L after {} frames", name_, apart_, frames_));
    }
  }
  void advance_frame() override {
    device_->advance_frame();
    cpu_->advance_frame();
    const State a = device_->state(), b = cpu_->state();
    ++frames_;
    finite_ = finite_ && a.finite() && b.finite();
    for (std::size_t i = 0; finite_ && i < a.u.size(); ++i) {
      apart_ = std::max(apart_, norm(a.u[i] - b.u[i]) / size_);
    }
  }
  State state() const override { return device_->state(); }
  void set_state(const State& state) override {
    device_->set_state(state);
    cpu_->set_state(state);
  }
  void retune(const Model& model, const Scene& scene) override {
    device_->retune(model, scene);
    cpu_->retune(model, scene);
  }
  void steer(const Scene& scene) override {
    device_->steer(scene);
    cpu_->steer(scene);
  }
  std::size_t contact_count() const override { return device_->contact_count(); }
  std::string device() const override { return device_->device(); }

 private:
  std::unique_ptr<Solver> device_, cpu_;
  double size_, apart_ = 0.0;
  std::string name_;
  int frames_ = 0;
  bool finite_ = true;
};

}  // namespace viscera::sim
