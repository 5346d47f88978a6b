// What an interrupted run goes on from, to the same bits as if nothing had happened. In the scratch
// folder that the engine keeps for one key:
//
//   positions.f32   float32 [frames][n][3], mm: grows with every frame
//   last-K.h5, before-K.h5, most-K.h5, course-K.json   the state after K frames, that of the frame
//                   before, the most deformed one, and what is known of the frames so far
//   current         K: written last, so that a kill leaves the files of an earlier K
//
// Written every ten seconds, and when a run is interrupted.
#pragma once

#include <chrono>
#include <filesystem>
#include <fstream>
#include <optional>
#include <span>

#include "stages/program/stage_main.hpp"
#include "stages/simulate/frame_loop.hpp"

namespace viscera {

class Resume {
 public:
  // Without a scratch folder nothing is written or found.
  Resume(const StageRun& run, std::size_t vertices, const sim::TimeGrid& time);

  // What an earlier run has left; none when there is nothing, or nothing whole.
  std::optional<Outcome> find();
  std::vector<float> positions(std::size_t frame) const;  // of what was found

  void add(std::span<const float> positions_mm);  // of the next frame
  void note(const Outcome& outcome);              // after each frame

 private:
  std::filesystem::path file(const char* what, std::size_t frames, const char* kind) const;
  Outcome read(std::size_t frames) const;
  void save(const Outcome& outcome);

  std::filesystem::path folder_;  // empty: none
  std::string params_;
  std::size_t vertices_;
  sim::TimeGrid time_;
  std::ofstream positions_;
  std::size_t saved_frames_ = 0;
  std::chrono::steady_clock::time_point saved_ = std::chrono::steady_clock::now();
};

}  // namespace viscera
