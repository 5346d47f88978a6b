// Runs of one body and scene side by side, which differ in what may change in a run (retune()):
// materials, friction, the stiffness of attachments.
#pragma once

#include <functional>
#include <memory>

#include "sim/model/model.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/solver.hpp"

namespace viscera::sim {

class Ensemble {
 public:
  virtual ~Ensemble() = default;
  virtual int size() const = 0;
  // One frame of every member. Each gives the bits that it gives in an ensemble of its own.
  virtual void advance_frame() = 0;
  virtual State state(int member) const = 0;
  virtual State motion(int member) const = 0;
  virtual std::optional<DeviceMotion> motion_on_device(int) { return std::nullopt; }
  virtual void set_state(int member, const State& state) = 0;
  // As Solver has it.
  virtual void retune(int member, const Model& model, const Scene& scene) = 0;
  virtual void steer(int member, const Scene& scene) = 0;
  virtual std::size_t contact_count(int member) const = 0;
  virtual double unsettled_force(int) const { return 0.0; }
  virtual ActingDamping damping() const { return {}; }
  virtual std::string device() const = 0;
  virtual bool off_host() const { return false; }
  virtual SubstepWork substep_work() const { return {}; }  // of one member
};

// Gives a member its materials and parameters, in place of those that all share; may be empty.
using Tune = std::function<void(int member, Model& model, Scene& scene)>;

inline std::pair<Model, Scene> tuned(Model model, Scene scene, int member, const Tune& tune) {
  if (tune) tune(member, model, scene);
  return {std::move(model), std::move(scene)};
}

// An ensemble of one is a solver.
class OnlyMember final : public Solver {
 public:
  explicit OnlyMember(std::unique_ptr<Ensemble> ensemble) : ensemble_(std::move(ensemble)) {}
  void advance_frame() override { ensemble_->advance_frame(); }
  State state() const override { return ensemble_->state(0); }
  State motion() const override { return ensemble_->motion(0); }
  std::optional<DeviceMotion> motion_on_device() override { return ensemble_->motion_on_device(0); }
  void set_state(const State& state) override { ensemble_->set_state(0, state); }
  void retune(const Model& model, const Scene& scene) override {
    ensemble_->retune(0, model, scene);
  }
  void steer(const Scene& scene) override { ensemble_->steer(0, scene); }
  std::size_t contact_count() const override { return ensemble_->contact_count(0); }
  double unsettled_force() const override { return ensemble_->unsettled_force(0); }
  ActingDamping damping() const override { return ensemble_->damping(); }
  std::string device() const override { return ensemble_->device(); }
  bool off_host() const override { return ensemble_->off_host(); }
  SubstepWork substep_work() const override { return ensemble_->substep_work(); }

 private:
  std::unique_ptr<Ensemble> ensemble_;
};

// Members that know nothing of one another.
class Separately final : public Ensemble {
 public:
  // make(model, scene) gives a Solver.
  template <class Make>
  Separately(const Model& model, const Scene& scene, int members, const Tune& tune, Make&& make) {
    for (int member = 0; member < members; ++member) {
      const auto [own_model, own_scene] = tuned(model, scene, member, tune);
      members_.push_back(make(own_model, own_scene));
    }
  }
  int size() const override { return static_cast<int>(members_.size()); }
  void advance_frame() override {
    for (auto& member : members_) member->advance_frame();
  }
  State state(int member) const override { return members_[member]->state(); }
  State motion(int member) const override { return members_[member]->motion(); }
  std::optional<DeviceMotion> motion_on_device(int member) override {
    return members_[member]->motion_on_device();
  }
  void set_state(int member, const State& state) override { members_[member]->set_state(state); }
  void retune(int member, const Model& model, const Scene& scene) override {
    members_[member]->retune(model, scene);
  }
  void steer(int member, const Scene& scene) override { members_[member]->steer(scene); }
  std::size_t contact_count(int member) const override { return members_[member]->contact_count(); }
  double unsettled_force(int member) const override { return members_[member]->unsettled_force(); }
  ActingDamping damping() const override { return members_[0]->damping(); }
  std::string device() const override { return members_[0]->device(); }
  bool off_host() const override { return members_[0]->off_host(); }
  SubstepWork substep_work() const override { return members_[0]->substep_work(); }

 private:
  std::vector<std::unique_ptr<Solver>> members_;
};

}  // namespace viscera::sim
