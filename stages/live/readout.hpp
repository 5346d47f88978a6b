// What a session says of itself: in a window's corner as text, of a headless run as JSON.
#pragma once

#include "sim/scene/diagnostics.hpp"
#include "stages/live/session.hpp"

namespace viscera::live {

struct Readout {
  std::uint64_t frame = 0;
  double time_s = 0.0;
  std::string device;
  std::size_t tets = 0, vertices = 0;
  double budget_ms = 0.0;                               // the time that a frame stands for
  double last_ms = 0.0, median_ms = 0.0, p99_ms = 0.0;  // wall times of the last 4096 frames
  std::uint64_t over_budget = 0;                        // frames, since the start
  int substeps = 0;
  double cs = 0.0;         // largest, dt sqrt(mu/rho)/h
  std::string cs_warning;  // empty: none
  sim::Diagnostics now;
  std::size_t contacts = 0;
  Point pull;                                            // N, of the hand's hold on the body
  std::vector<std::string> effects;                      // that are on
  std::vector<std::pair<std::string, double>> parts_ms;  // of a frame, since the one before
  bool paused = false, diverged = false;
  std::deque<std::string> messages;
};

// Makes readouts of one session's snapshots, one after the other.
class Reader {
 public:
  explicit Reader(const Session& session);
  Readout read(const Snapshot& snapshot);

 private:
  sim::Model body_;  // with the materials of the snapshot
  std::string device_;
  double frame_s_;
  std::uint64_t frame_before_ = 0;
  Seconds seconds_before_;
};

Json to_json(const Readout& readout);

// Lines for a window. Above the budget they say which effect costs what.
std::string to_text(const Readout& readout);

}  // namespace viscera::live
