#include "stages/live/session.hpp"

#include <algorithm>
#include <chrono>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "sim/scene/diagnostics.hpp"
#include "stages/simulate/body.hpp"

namespace viscera::live {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t max_messages = 6;
// A body that has moved this many times its own size has left the scene, not deformed.
constexpr double lost_after_sizes = 1e3;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

std::string in_a_line(const Error& error) {
  const Problem& p = error.problem();
  std::string line = p.field.empty() ? p.where : p.field;
  line += ": " + p.found;
  if (!p.allowed.empty()) line += "; allowed: " + p.allowed;
  return line;
}

}  // namespace

void FrameTimes::add(double s) {
  if (times_.size() < most) {
    times_.push_back(s);
  } else {
    times_[next_] = s;
  }
  next_ = (next_ + 1) % most;
}

double FrameTimes::quantile(double q) const {
  if (times_.empty()) return 0.0;
  std::vector<double> sorted = times_;
  const auto at = sorted.begin() +
                  static_cast<std::ptrdiff_t>(q * static_cast<double>(sorted.size() - 1) + 0.5);
  std::nth_element(sorted.begin(), at, sorted.end());
  return *at;
}

Session::Session(std::unique_ptr<World> world, SessionOptions options)
    : world_(std::move(world)),
      options_(std::move(options)),
      body_(world_->body()),
      device_(world_->device()),
      frame_s_(world_->frame_s()),
      good_(world_->state()),
      good_frame_(world_->frame()) {
  if (!options_.trajectory.empty()) {
    std::filesystem::create_directories(options_.trajectory);
    trajectory_.emplace(options_.trajectory, world_->mesh());
    trajectory_->append(0.0, positions_mm(body_, good_));
  }
  if (!options_.input_log.empty()) input_log_.emplace(options_.input_log, *world_);
  if (!options_.force_log.empty()) force_log_.emplace(options_.force_log);
  publish();
  thread_ = std::thread([this] {
    try {
      run();
    } catch (...) {
      failure_ = std::current_exception();
    }
    ended_ = true;
  });
}

Session::~Session() {
  try {
    close();
  } catch (...) {
    // Told by an earlier close(), or of no interest any more.
  }
}

void Session::post(Command command) {
  const std::lock_guard lock(mutex_);
  commands_.push_back(std::move(command));
  changed_.notify_one();
}

void Session::pause(bool paused) {
  const std::lock_guard lock(mutex_);
  paused_ = paused;
  steps_ = 0;
  changed_.notify_one();
}

void Session::step() {
  const std::lock_guard lock(mutex_);
  ++steps_;
  changed_.notify_one();
}

const Snapshot& Session::look() {
  snapshots_.take();
  wanted_ = true;
  return snapshots_.front();
}

void Session::close() {
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    changed_.notify_one();
  }
  if (thread_.joinable()) thread_.join();
  if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
}

bool Session::wait_for(double s) {
  const auto until = Clock::now() + std::chrono::duration<double>(s);
  while (!ended_ && Clock::now() < until) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return ended_;
}

void Session::run() {
  auto due = Clock::now();
  std::vector<Command> commands;
  for (;;) {
    const Turn turn = next_turn(commands);
    if (turn == Turn::end) break;
    const auto begin = Clock::now();
    for (const Command& command : commands) take(command);
    if (turn == Turn::frame) advance(begin);
    if (wanted_.exchange(false)) publish();
    if (turn != Turn::frame) continue;
    const double took = seconds_since(begin);
    times_.add(took);
    if (took > frame_s_) ++over_budget_;
    if (!options_.paced) continue;
    due = std::max(
        due + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(frame_s_)),
        begin);
    std::unique_lock lock(mutex_);
    changed_.wait_until(lock, due, [this] { return closed_; });
  }
  if (trajectory_) trajectory_->finish();
  publish();
}

// What the loop does next, and what was asked for until now.
Session::Turn Session::next_turn(std::vector<Command>& commands) {
  constexpr auto glance = std::chrono::milliseconds(5);  // how soon a paused session is drawn anew
  std::unique_lock lock(mutex_);
  if (paused_ && steps_ == 0) {
    changed_.wait_for(lock, glance,
                      [this] { return closed_ || !paused_ || steps_ > 0 || !commands_.empty(); });
  }
  const bool is_over = options_.frames > 0 && frame_ >= options_.frames;
  if (closed_ || is_over || (diverged_ && options_.stops_when_diverged)) return Turn::end;
  commands = std::exchange(commands_, {});
  if (paused_ && steps_ == 0) return Turn::wait;
  steps_ = std::max(0, steps_ - 1);
  lock.unlock();
  if (options_.input) {
    for (Command& command : options_.input->before(frame_)) commands.push_back(std::move(command));
  }
  return Turn::frame;
}

void Session::take(const Command& command) {
  try {
    world_->apply(command);
    if (input_log_) input_log_->add(frame_, command);
  } catch (const Error& error) {
    if (error.code() == ExitCode::device_unavailable) throw;
    say(in_a_line(error));
  }
}

// On a device the state stays there until somebody wants to see it. What has been asked for until
// this frame was taken at `asked`.
void Session::advance(Clock::time_point asked) {
  try {
    world_->advance();
  } catch (const sim::Diverged& diverged) {
    return go_back(diverged.what());
  } catch (const Error& error) {  // within the frame, which does not count
    if (error.code() != ExitCode::interrupted) throw;
    const std::lock_guard lock(mutex_);
    closed_ = true;
    return;
  }
  frames_ = ++frame_;
  diverged_ = false;
  const bool is_kept = world_->on_cpu() || wanted_ || trajectory_;
  if (!is_kept && !force_log_) return;
  sim::State state = is_kept ? world_->state() : world_->motion();
  if (!is_good(state)) return go_back("values that are not finite, or a body that has left");
  if (force_log_) force_log_->add(frame_, world_->time_s(), asked, world_->pull(state));
  if (!is_kept) return;
  good_ = std::move(state);
  good_frame_ = world_->frame();
  if (!trajectory_) return;
  const auto begin = Clock::now();
  trajectory_->append(static_cast<double>(frame_) * frame_s_, positions_mm(body_, good_));
  spent_["record"] += seconds_since(begin);
}

bool Session::is_good(const sim::State& state) const {
  const double far = lost_after_sizes * body_.size();
  return state.finite() &&
         std::ranges::all_of(state.u, [far](const auto& u) { return dot(u, u) < far * far; });
}

void Session::go_back(const std::string& why) {
  diverged_ = true;
  say(fmt::format("diverged at frame {}: {}; back to the last good state", frame_, why));
  world_->go_back_to(good_, good_frame_);
  const std::lock_guard lock(mutex_);
  paused_ = true;
}

void Session::publish() {
  Snapshot& next = snapshots_.back();
  next.frame = frame_;
  next.time_s = world_->time_s();
  next.state = world_->state();
  next.contacts = world_->contact_count();
  next.setting = world_->setting();
  next.hand = world_->hand();
  next.pull = world_->pull(next.state);
  next.seconds = world_->seconds();
  for (const auto& [part, s] : spent_) next.seconds[part] += s;
  next.times = times_;
  next.over_budget = over_budget_;
  next.diverged = diverged_;
  next.messages = messages_;
  {
    const std::lock_guard lock(mutex_);
    next.paused = paused_;
  }
  snapshots_.publish();
}

void Session::say(std::string message) {
  log::warn("frame {}: {}", frame_, message);
  messages_.push_back(std::move(message));
  if (messages_.size() > max_messages) messages_.pop_front();
}

}  // namespace viscera::live
