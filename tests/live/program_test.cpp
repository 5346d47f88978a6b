// viscera-live as a program: exit codes, messages, and a headless run under random input.
#include <fmt/format.h>
#include <sys/wait.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "tests/live/live_run.hpp"

namespace viscera::live {
namespace {

struct Ended {
  int code;
  std::string out, errors;
};

class LiveProgram : public Live {
 protected:
  Ended run(const std::string& arguments, const std::string& mesh = "mesh.vtu",
            const std::string& scene = live_scene) const {
    write_atomically(path("scene.yaml"), scene);
    const std::string command = "env -u DISPLAY " VISCERA_LIVE " " + path("scene.yaml").string() +
                                " --in mesh=" + path(mesh).string() + " --set device=cpu " +
                                arguments + " 2> " + path("errors").string();
    FILE* const pipe = popen(command.c_str(), "r");
    std::string out;
    for (std::array<char, 4096> text; const auto n = fread(text.data(), 1, text.size(), pipe);) {
      out.append(text.data(), n);
    }
    const int status = pclose(pipe);
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, out, read_file(path("errors"))};
  }
};

TEST_F(LiveProgram, AHeadlessRunPrintsItsReadout) {
  const Ended run = this->run("--headless 30 --quiet");
  EXPECT_EQ(run.code, 0) << run.errors;
  const Json json = Json::parse(run.out);
  EXPECT_EQ(json["frames"], 30);
  for (const char* name : {"neo_hookean", "gravity", "ground", "viscosity"}) {
    EXPECT_NE(json["effects"].dump().find(name), std::string::npos) << name;
  }
}

TEST_F(LiveProgram, WithoutADisplayItSaysHowToRunHeadless) {
  const Ended run = this->run("");
  EXPECT_EQ(run.code, 6);
  EXPECT_NE(run.errors.find("no DISPLAY"), std::string::npos) << run.errors;
  EXPECT_NE(run.errors.find("--headless"), std::string::npos) << run.errors;
}

TEST_F(LiveProgram, WhatDoesNotFitEndsWithItsExitCode) {
  EXPECT_EQ(run("--headless 1", "absent.vtu").code, 4);
  EXPECT_EQ(run("--headless 1", "mesh.vtu", with(live_scene, "liver:", "spleen:")).code, 3);
  EXPECT_EQ(run("--headless 1", "mesh.vtu", "scene: 1\n").code, 3);
  EXPECT_EQ(run("--headless 1 --set solver=magic").code, 3);
  EXPECT_EQ(run("--headless none").code, 2);
  write_atomically(path("broken.vtu"), "no mesh");
  EXPECT_EQ(run("--headless 1", "broken.vtu").code, 4);
}

TEST_F(LiveProgram, InputOfAnotherMeshIsRefused) {
  const std::string log = path("input.jsonl").string();
  ASSERT_EQ(run("--headless 20 --random 1 --log-input " + log).code, 0);
  write_mesh("other.vtu", 2);
  const Ended other = run("--headless 20 --replay " + log, "other.vtu");
  EXPECT_EQ(other.code, 4);
  EXPECT_NE(other.errors.find("recorded on"), std::string::npos) << other.errors;
  write_atomically(path("input.jsonl"), "{\"frame\": 1}\n");
  EXPECT_EQ(run("--headless 20 --replay " + log).code, 4);
  EXPECT_EQ(run("--headless 20 --replay " + path("absent").string()).code, 4);
  EXPECT_EQ(run("--headless 20 --replay /dev/zero").code, 4) << "it has no end";
}

TEST_F(LiveProgram, WhatTheHandFeelsIsATableWithOneRowAFrame) {
  const std::string table = path("force.csv").string();
  const Ended run = this->run("--headless 40 --random 2 --quiet --log-force " + table);
  ASSERT_EQ(run.code, 0) << run.errors;
  std::istringstream rows(read_file(table));
  std::string header, row, last;
  std::getline(rows, header);
  EXPECT_EQ(header, "frame,time_s,wall_s,delay_ms,pull_x_N,pull_y_N,pull_z_N");
  int frames = 0, pulls = 0;
  double before = 0.0;
  std::array<double, 7> value{};
  while (std::getline(rows, row)) {
    std::istringstream columns(row);
    for (double& v : value) {
      std::string text;
      std::getline(columns, text, ',');
      v = std::stod(text);
    }
    EXPECT_EQ(value[0], ++frames);
    EXPECT_GT(value[2], before) << "time goes on";
    EXPECT_GT(value[3], 0.0);
    EXPECT_LE(value[3], 1e3 * (value[2] - before) + 1e-2) << "asked after the frame before";
    before = value[2];
    pulls += value[4] != 0.0;
  }
  EXPECT_EQ(frames, 40);
  EXPECT_GT(pulls, 3) << "the hand held something";
  const Json readout = Json::parse(run.out);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double at_end = readout["pull_N"][axis];
    EXPECT_NEAR(value[4 + axis], at_end, 1e-5 * std::abs(at_end));
  }
  EXPECT_EQ(this->run("--headless 1 --log-force " + path("absent/force.csv").string()).code, 2);
}

TEST_F(LiveProgram, TheReportReadsWhatWasRecorded) {
  ASSERT_EQ(run("--headless 12 --random 1 --record " + path("recorded").string()).code, 0);
  const std::string report =
      VISCERA_REPORT " --quiet --in trajectory=" + (path("recorded") / "trajectory.h5").string() +
      " --out " + path("report").string() + " > " + path("out").string();
  EXPECT_EQ(std::system(report.c_str()), 0);
  EXPECT_GT(fs::file_size(path("report") / "report.html"), 10000u);
}

// An hour of it: make soak.
TEST_F(LiveProgram, RandomInputLeaksNothingAndMakesNoNaN) {
  constexpr int frames = 12000;
  const Ended run = this->run(fmt::format("--headless {} --random 11 --quiet", frames));
  ASSERT_EQ(run.code, 0) << run.errors;
  const Json json = Json::parse(run.out);
  EXPECT_FALSE(json["diverged"].get<bool>());
  EXPECT_TRUE(json["energy_J"]["total"].is_number()) << "null is how JSON writes NaN";
  EXPECT_NE(run.errors.find("materials.liver.nu"), std::string::npos) << "bad values were tried";
  const Json memory = json["memory_MB"];
  const double early = memory["peak_in_second_tenth"], last = memory["peak_in_last_tenth"];
  ASSERT_GT(early, 0.0);
  EXPECT_LT((last - early) * (1 << 20) / (0.8 * frames), 80.0) << "bytes a frame";
}

}  // namespace
}  // namespace viscera::live
