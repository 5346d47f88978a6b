// The window on an X server of its own (Xvfb, OpenGL in software): real mouse and key events from
// xdotool, and a look at the picture.
#include <fmt/format.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>

#include "tests/common/needs.hpp"
#include "tests/live/live_run.hpp"
#include "tests/live/screen.hpp"

namespace viscera::live {
namespace {

constexpr int width = 1280, height = 800;  // the window's

// Starts a program; what it says goes to files.
pid_t start(const std::vector<std::string>& words, const fs::path& errors, const fs::path& out) {
  const pid_t child = fork();
  if (child != 0) return child;
  std::vector<char*> argv;
  for (const auto& word : words) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  if (!freopen(errors.c_str(), "w", stderr) || !freopen(out.c_str(), "w", stdout)) _exit(126);
  execvp(argv[0], argv.data());
  _exit(127);
}

void sleep_ms(int ms) {
  std::this_thread::sleep_for(std::chrono::milliseconds(ms));
}

bool is_reddish(const Pixel& c) {
  return c[0] > 60 && c[0] > c[1] + 20 && c[0] > c[2] + 20;
}
bool is_bluish(const Pixel& c) {
  return c[2] > 80 && c[2] > c[0] + 20;
}
bool is_yellow(const Pixel& c) {
  return c[0] > 60 && c[1] > 50 && c[2] < 0.6 * c[1];
}
bool is_light(const Pixel& c) {
  return c[0] > 150 && c[1] > 150 && c[2] > 150;
}

class LiveWindow : public Live {
 protected:
  void SetUp() override {
    VISCERA_NEEDS(installed("Xvfb") && installed("xdotool"), "xvfb or xdotool is not installed");
    server_ = start({"Xvfb", "-displayfd", "1", "-screen", "0", "1300x820x24"}, path("xvfb"),
                    path("display"));
    std::string number;
    for (int glance = 0; glance < 500 && number.empty(); ++glance) {
      sleep_ms(20);
      std::ifstream(path("display")) >> number;
    }
    ASSERT_FALSE(number.empty()) << read_file(path("xvfb"));
    display_ = ":" + number;
    screen_ = std::make_unique<Screen>(display_);
  }
  void TearDown() override {
    screen_.reset();
    for (const pid_t child : {live_, server_}) {
      if (child <= 0) continue;
      kill(child, SIGTERM);
      waitpid(child, nullptr, 0);
    }
  }

  // Shows the cube, and waits until it is drawn.
  void open(const std::string& scene = live_scene, std::vector<std::string> further = {}) {
    write_atomically(path("scene.yaml"), scene);
    std::vector<std::string> words = {"env",         "DISPLAY=" + display_,
                                      VISCERA_LIVE,  path("scene.yaml").string(),
                                      "--in",        "mesh=" + path("mesh.vtu").string(),
                                      "--set",       "device=cpu",
                                      "--log-input", path("input.jsonl").string()};
    words.insert(words.end(), further.begin(), further.end());
    live_ = start(words, path("errors"), path("out"));
    for (int glance = 0; glance < 600; ++glance) {
      sleep_ms(50);
      if (screen_->has_window("viscera-live") && look().count(is_reddish) > 2000) return;
      ASSERT_EQ(waitpid(live_, nullptr, WNOHANG), 0) << read_file(path("errors"));
    }
    FAIL() << "nothing was drawn: " << read_file(path("errors"));
  }

  Picture look() const { return screen_->look(width, height); }

  // Whether it comes about: a window that shares its two cores with other tests takes its time.
  template <class Condition>
  static bool comes_about(const Condition& condition) {
    for (int glance = 0; glance < 600; ++glance) {
      if (condition()) return true;
      sleep_ms(50);
    }
    return false;
  }
  // Whether the picture comes to be as it should.
  template <class Condition>
  bool comes_to(const Condition& condition) const {
    return comes_about([&] { return condition(look()); });
  }
  // Whether the program says so, in its record of input or in its messages.
  bool says(const std::string& file, const std::string& text) const {
    return comes_about([&] { return read_file(path(file)).find(text) != std::string::npos; });
  }

  void xdotool(const std::string& what) const {
    ASSERT_EQ(std::system(fmt::format("DISPLAY={} xdotool {}", display_, what).c_str()), 0);
  }
  void key(const std::string& name) const { xdotool("mousemove 640 740 key " + name); }

  // What the record of input says of one command, line by line.
  template <class Value>
  std::vector<Value> recorded(const char* command, const char* field) const {
    std::vector<Value> values;
    std::ifstream log(path("input.jsonl"));
    for (std::string line; std::getline(log, line);) {
      const Json json = Json::parse(line, nullptr, false);
      if (json.is_object() && json.contains(command)) values.push_back(json[field]);
    }
    return values;
  }

  int end_of_program() {
    int status = 0;
    for (int glance = 0; glance < 400; ++glance, sleep_ms(25)) {
      if (waitpid(live_, &status, WNOHANG) == 0) continue;
      live_ = 0;
      return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    return -1;
  }

  std::unique_ptr<Screen> screen_;
  pid_t live_ = 0;

 private:
  pid_t server_ = 0;
  std::string display_;
};

TEST_F(LiveWindow, ShowsBodyHelpReadoutAndSlidersAndKeysChangeThePicture) {
  open();
  const Picture first = look();
  EXPECT_GT(first.count(is_light, 0.0, 0.0, 0.45, 0.2), 500) << "help";
  EXPECT_TRUE(comes_to([](const Picture& p) { return p.count(is_light, 0, 0.75, 0.45, 1) > 500; }))
      << "readout";
  EXPECT_GT(first.count(is_light, 0.78, 0.0, 1.0, 0.4), 300) << "sliders";
  key("h");
  EXPECT_TRUE(comes_to([](const Picture& p) { return p.count(is_light, 0, 0, 0.4, 0.2) < 50; }))
      << "the help is hidden";
  key("c");
  EXPECT_TRUE(comes_to([](const Picture& p) { return p.count(is_bluish) > 1000; }))
      << "colours of displacement";
  key("2");
  EXPECT_TRUE(says("input.jsonl", "8.5 kPa"));
  key("d");
  EXPECT_TRUE(says("input.jsonl", "\"drop\""));
  key("r");
  EXPECT_TRUE(says("input.jsonl", "\"reset\""));
  key("q");
  EXPECT_EQ(end_of_program(), 0);
}

TEST_F(LiveWindow, TheMousePullsTheBodyWhereItIsAndTurnsTheViewBeside) {
  open(with(live_scene, "  gravity:\n", ""));
  key("g");  // no ghost
  sleep_ms(300);
  const auto in_upper_half = [](const Picture& p) {
    return p.count(is_reddish, 0.3, 0.0, 0.75, 0.4);
  };
  const int before = in_upper_half(look());
  xdotool("mousemove 640 400 mousedown 1");
  ASSERT_TRUE(says("input.jsonl", "\"grab\"")) << read_file(path("errors"));
  xdotool("mousemove 640 300 mousemove 640 200");
  EXPECT_TRUE(says("input.jsonl", "\"drag\""));
  EXPECT_TRUE(comes_to([&](const Picture& p) { return in_upper_half(p) > before + 3000; }));
  xdotool("mouseup 1");
  EXPECT_TRUE(says("input.jsonl", "\"release\""));
  const auto grabs = read_file(path("input.jsonl")).find("grab");
  const Picture still = look();
  xdotool("mousemove 60 400 mousedown 1 mousemove 160 430 mouseup 1");
  EXPECT_TRUE(comes_to([&](const Picture& p) { return p.differing(still) > 2000; }));
  EXPECT_EQ(read_file(path("input.jsonl")).find("grab", grabs + 1), std::string::npos);
}

TEST_F(LiveWindow, SlidersChangeMaterialsAndWhatIsOutOfRangeSpringsBackWithAMessage) {
  open();
  // The first slider is E of the only material: a click beside its handle. The second is nu, 0.45:
  // its handle is dragged to the right end, 0.5.
  xdotool("mousemove 1100 56 click 1");
  EXPECT_TRUE(says("input.jsonl", "materials.liver.E")) << read_file(path("errors"));
  xdotool("mousemove 1207 124 mousedown 1 mousemove 1230 124 mousemove 1260 124 mouseup 1");
  EXPECT_TRUE(says("errors", "materials.liver.nu: 0.5")) << read_file(path("errors"));
  key("q");
  EXPECT_EQ(end_of_program(), 0);
}

TEST_F(LiveWindow, TheToolFollowsTheMouseAndTheWheelPressesItIn) {
  open(with(live_scene, "  gravity:\n", ""));
  const auto places = [this] { return recorded<std::array<double, 3>>("tool", "tool"); };
  // How far it has come since it appeared, away from who looks: posterior.
  const auto pressed_in = [&] { return places().back()[1] - places().front()[1]; };
  xdotool("mousemove 540 400 key t");
  ASSERT_TRUE(says("input.jsonl", "\"tool\"")) << read_file(path("errors"));
  for (int turn = 0; turn < 30; ++turn) xdotool("click 4");
  EXPECT_TRUE(comes_about([&] { return pressed_in() >= 10.0; }))
      << "30 turns of a tenth of its radius, 6.9 mm";
  const double before = places().back()[2];
  xdotool("mousemove 540 300");
  EXPECT_TRUE(comes_about([&] { return places().back()[2] > before + 5.0; }))
      << "it follows the mouse";
  xdotool("key t");
  EXPECT_TRUE(says("input.jsonl", "\"lift\""));
}

// The record of input counts frames: a drop says after how many it was asked for.
TEST_F(LiveWindow, APausedWindowStandsStillAndStepsByKey) {
  open();
  key("space");
  sleep_ms(500);
  const auto drops = [this] { return recorded<int>("drop", "frame"); };
  const auto frame_now = [&] {
    const auto before = drops().size();
    key("d");
    EXPECT_TRUE(comes_about([&] { return drops().size() > before; }));
    return drops().back();
  };
  const int paused_at = frame_now();
  sleep_ms(300);
  EXPECT_EQ(frame_now(), paused_at);
  for (int step = 0; step < 3; ++step) key("n");
  int now = paused_at;
  for (int glance = 0; glance < 50 && now < paused_at + 3; ++glance) now = frame_now();
  EXPECT_EQ(now, paused_at + 3);
  EXPECT_EQ(frame_now(), paused_at + 3);
  key("space");
  for (int glance = 0; glance < 50 && now < paused_at + 10; ++glance) now = frame_now();
  EXPECT_GT(now, paused_at + 3);
}

TEST_F(LiveWindow, ASecondSolverIsDrawnOverTheFirstInItsColour) {
  open(live_scene, {"--second", "pbd"});
  EXPECT_TRUE(
      comes_to([](const Picture& p) { return p.count(is_yellow, 0.2, 0.2, 0.78, 1) > 1000; }));
}

TEST_F(LiveWindow, AWindowThatIsClosedMidRunEndsTheProgramCleanly) {
  open();
  screen_->close_window("viscera-live");
  EXPECT_EQ(end_of_program(), 0) << read_file(path("errors"));
}

TEST_F(LiveWindow, ASignalEndsItAsInterrupted) {
  open();
  kill(live_, SIGINT);
  EXPECT_EQ(end_of_program(), 130);
}

}  // namespace
}  // namespace viscera::live
