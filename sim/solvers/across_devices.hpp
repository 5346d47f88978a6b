// Ensembles on several devices.
#pragma once

#include <algorithm>
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "sim/base/range.hpp"
#include "sim/base/team.hpp"
#include "sim/solvers/ensemble.hpp"

namespace viscera::sim {

// A thread for each of several devices.
class DeviceTeam {
 public:
  // Makes a device that of the calling thread for the time of work().
  using Enter = std::function<void(int device, const std::function<void()>& work)>;

  DeviceTeam(int devices, Enter enter) : enter_(std::move(enter)), threads_(devices) {}

  int size() const { return threads_.most(); }
  // work(device) on all at the same time. Throws what the first of them throws.
  template <class Work>
  void on_each(const Work& work) const {
    std::vector<std::exception_ptr> thrown(size());
    threads_.run([&](int device) {
      try {
        enter_(device, [&] { work(device); });
      } catch (...) {
        thrown[device] = std::current_exception();
      }
    });
    for (const auto& one : thrown) {
      if (one) std::rethrow_exception(one);
    }
  }
  // What work() returns on one of them, by the caller.
  template <class Work>
  auto on(int device, const Work& work) const {
    if constexpr (std::is_void_v<decltype(work())>) {
      enter_(device, work);
    } else {
      std::optional<decltype(work())> result;
      enter_(device, [&] { result.emplace(work()); });
      return *std::move(result);
    }
  }

 private:
  Enter enter_;
  mutable Team threads_;
};

// Members shared out among devices, which work at the same time: on each as many, to within one.
class AcrossDevices final : public Ensemble {
 public:
  // An ensemble of `members`, of which `first` is the first of all, on the device that was entered.
  using Make = std::function<std::unique_ptr<Ensemble>(int first, int members)>;

  AcrossDevices(int devices, int members, DeviceTeam::Enter enter, const Make& make)
      : members_(members), devices_(devices, std::move(enter)), parts_(devices) {
    const auto members_on = [&](int device) { return part_of({0, members}, device, devices); };
    for (int device = 0; device < devices; ++device) first_.push_back(members_on(device).begin);
    devices_.on_each([&](int device) {
      const Range own = members_on(device);
      parts_[device] = make(own.begin, own.end - own.begin);
    });
  }

  int size() const override { return members_; }
  void advance_frame() override {
    devices_.on_each([this](int device) { parts_[device]->advance_frame(); });
  }
  State state(int member) const override {
    return of(member, [](const Ensemble& part, int own) { return part.state(own); });
  }
  State motion(int member) const override {
    return of(member, [](const Ensemble& part, int own) { return part.motion(own); });
  }
  std::optional<DeviceMotion> motion_on_device(int member) override {
    return of(member, [](Ensemble& part, int own) { return part.motion_on_device(own); });
  }
  void set_state(int member, const State& state) override {
    of(member, [&](Ensemble& part, int own) { part.set_state(own, state); });
  }
  void retune(int member, const Model& model, const Scene& scene) override {
    of(member, [&](Ensemble& part, int own) { part.retune(own, model, scene); });
  }
  void steer(int member, const Scene& scene) override {
    of(member, [&](Ensemble& part, int own) { part.steer(own, scene); });
  }
  std::size_t contact_count(int member) const override {
    return of(member, [](const Ensemble& part, int own) { return part.contact_count(own); });
  }
  double unsettled_force(int member) const override {
    return of(member, [](const Ensemble& part, int own) { return part.unsettled_force(own); });
  }
  ActingDamping damping() const override { return parts_[0]->damping(); }
  std::string device() const override {
    return parts_[0]->device() + ", " + std::to_string(parts_.size()) + " of them";
  }
  bool off_host() const override { return parts_[0]->off_host(); }
  SubstepWork substep_work() const override { return parts_[0]->substep_work(); }

 private:
  template <class Work>
  std::invoke_result_t<Work, Ensemble&, int> of(int member, const Work& work) const {
    const auto next = std::upper_bound(first_.begin(), first_.end(), member);
    const auto device = static_cast<int>(next - first_.begin()) - 1;
    return devices_.on(device, [&] { return work(*parts_[device], member - first_[device]); });
  }

  int members_;
  DeviceTeam devices_;
  std::vector<int> first_;  // [devices] member of each
  std::vector<std::unique_ptr<Ensemble>> parts_;
};

}  // namespace viscera::sim
