// A scene as input of other finite element programs, solved by one of them.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "stages/simulate/files/checkpoint.hpp"
#include "tests/common/calculix.hpp"
#include "tests/common/needs.hpp"
#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

// Stiff, so that CalculiX's Neo-Hookean law and ours are one to a part in a thousand.
const char* const stiff_scene = R"(scene: 1
materials:
  liver: {E: 200 kPa, nu: 0.4, density: 1060 kg/m3}
effects:
  neo_hookean:
  fixed: {side: superior}
time: {frame_rate: 10 Hz, substeps: 1, end: 1 s}
)";

class SceneFormats : public Simulate {
 protected:
  // Root mean square by which finite elements here and CalculiX on the file differ, over that of
  // the displacement.
  double difference(const std::string& scene, int order) {
    EXPECT_EQ(run(scene, {"--set", "solver=fem", "--set", "fem_time=quasi_static", "--set",
                          fmt::format("fem_order={}", order), "--set",
                          "element=" + std::string(order == 1 ? "linear" : "auto"), "--set",
                          "formats=[inp]"}),
              0)
        << errors;
    const std::string command =
        fmt::format("cd '{}' && OMP_NUM_THREADS=1 ccx scene > ccx.log 2>&1", path("out").string());
    EXPECT_EQ(std::system(command.c_str()), 0) << read_file(path("out") / "ccx.log");
    const auto judged = calculix_field<3>(path("out") / "scene.frd", "DISP");
    const std::size_t vertices = metric("vertices").get<std::size_t>();
    const sim::State own =
        read_checkpoint(path("out") / "checkpoint.h5", vertices, {.frame_s = 0.1, .substeps = 1});
    double off = 0.0, all = 0.0;
    for (std::size_t i = 0; i < vertices; ++i) {
      const auto& u = judged.at(static_cast<int>(i));
      const sim::Vec3<double> truth = {u[0], u[1], u[2]}, miss = 1e3 * own.u[i] - truth;
      off += dot(miss, miss), all += dot(truth, truth);
    }
    EXPECT_GT(all, 0.0);
    return std::sqrt(off / all);
  }
};

TEST_F(SceneFormats, CalculixFindsTheSameRestFromTheFile) {
  VISCERA_NEEDS(installed("ccx"), "calculix-ccx is not installed");
  const auto adding = [](const char* effect) {
    return with(stiff_scene, "  fixed:", fmt::format("  {}\n  fixed:", effect));
  };
  const std::pair<const char*, std::string> scenes[] = {
      {"gravity", adding("gravity: {direction: [1, 0, -2]}")},
      {"load", adding("load: {side: inferior, force: [0.2 N, 0.1 N, -0.3 N]}")},
      {"pressure", adding("pressure: {side: left, pressure: 300 Pa}")},
      {"prescribed",
       adding(
           "prescribed: {side: inferior, displacement: [0.3 mm, 0 mm, -0.4 mm], duration: 0.5 s}")},
      {"spring", with(adding("gravity:"), "fixed: {side: superior}",
                      "spring: {side: superior, stiffness: 20 kPa/mm}")},
      {"mooney_rivlin", with(adding("gravity:"), "neo_hookean:", "mooney_rivlin: {second: 0.4}")},
      {"ogden", with(adding("gravity:"), "neo_hookean:", "ogden: {exponent: -4.7}")},
      {"stvk", with(adding("gravity:"), "neo_hookean:", "stvk:")},
      {"linear", with(adding("gravity:"), "neo_hookean:", "linear:")}};
  for (const auto& [name, scene] : scenes) {
    const bool is_tissue = scene.find("neo_hookean") != std::string::npos;
    EXPECT_LT(difference(scene, 1), 1e-3) << name;
    // Finite elements here have no pressure on quadratic tets.
    if (is_tissue && name != std::string("pressure")) {
      EXPECT_LT(difference(scene, 2), 1e-3) << name << ", quadratic tets";
    }
  }
}

TEST_F(SceneFormats, FebioGetsTheSameProblemWithGravityByMassAndAgainstItsDirection) {
  const std::string scene = with(stiff_scene, "  fixed:",
                                 "  gravity: {acceleration: 9 m/s2}\n"
                                 "  load: {side: inferior, force: [0 N, 0 N, -0.5 N]}\n"
                                 "  pressure: {side: left, pressure: 250 Pa}\n"
                                 "  fixed:");
  ASSERT_EQ(run(scene, {"--set", "formats=[inp, feb]", "--set", "end=0.1s"}), 0) << errors;
  const std::string feb = read_file(path("out") / "scene.feb"),
                    inp = read_file(path("out") / "scene.inp");
  EXPECT_NE(inp.find("TYPE=C3D10"), std::string::npos) << "elements are smoothed";
  for (const char* part :
       {"<febio_spec version=\"4.0\">", "type=\"neo-Hookean\"", "<E>0.2</E>", "<v>0.4</v>",
        "<Elements type=\"tet10\" name=\"liver\">", "<force lc=\"1\">-0,-0,9000</force>",
        "<pressure lc=\"1\">0.00025</pressure>", "<tri6 id=\"18\">", "node_set=\"held\""}) {
    EXPECT_NE(feb.find(part), std::string::npos) << part;
  }
  EXPECT_EQ(feb.find("<tri6 id=\"19\">"), std::string::npos) << "3 x 3 cells at a side";
  const std::size_t set = feb.find("<NodeSet name=\"held\">");
  const std::string held = feb.substr(set, feb.find("</NodeSet>", set) - set);
  EXPECT_EQ(held.find('\n'), std::string::npos) << "numbers are parted by commas alone";
  EXPECT_EQ(std::ranges::count(held, ','), 48) << "16 vertices, and 33 edges between them";
  double sum = 0.0;
  const std::size_t begin = feb.find("name=\"force_z\"");
  for (std::size_t at = begin; at < feb.find("</NodeData>", begin);) {
    at = feb.find("<node lid", at);
    if (at > feb.find("</NodeData>", begin)) break;
    at = feb.find('>', at) + 1;
    sum += std::stod(feb.substr(at));
  }
  EXPECT_NEAR(sum, -0.5, 1e-9);
}

TEST_F(SceneFormats, WhatAFormatCannotHoldIsRefusedByName) {
  const auto refusal = [&](const std::string& scene, const char* formats) {
    EXPECT_EQ(run(scene, {"--set", fmt::format("formats={}", formats)}), 3) << errors;
    EXPECT_FALSE(fs::exists(path("out") / "scene.inp"));
    return errors;
  };
  EXPECT_NE(refusal(drop_scene, "[inp]").find("effects.ground"), std::string::npos) << errors;
  const std::string bed =
      with(stiff_scene, "fixed: {side: superior}", "spring: {side: superior, stiffness: 1 kPa/mm}");
  EXPECT_NE(refusal(bed, "[feb]").find("feb with effects.spring"), std::string::npos) << errors;
  const auto ogden = [](const char* terms) { return with(stiff_scene, "neo_hookean:", terms); };
  EXPECT_NE(refusal(ogden("ogden: {exponent: -4.7}"), "[feb]").find("ogden"), std::string::npos);
  EXPECT_NE(refusal(ogden("ogden: [{exponent: 2, share: 0.5}, {exponent: 4, share: 0.5}]"), "[inp]")
                .find("several terms"),
            std::string::npos)
      << errors;
  EXPECT_NE(refusal(stiff_scene, "[imp]").find("inp"), std::string::npos) << errors;
}

// As a scene ends: the last of its schedule, and where what is prescribed comes to.
TEST_F(SceneFormats, TheProblemIsThatOfTheScenesEnd) {
  const std::string scene = with(
      with(stiff_scene, "  fixed:",
           "  gravity: {acceleration: 9 m/s2}\n"
           "  prescribed: {side: inferior, displacement: [0 mm, 0 mm, 2 mm], duration: 1 s}\n"
           "  fixed:"),
      "time:", "schedule:\n  - {at: 0.2 s, effects: {gravity: {acceleration: 4 m/s2}}}\ntime:");
  ASSERT_EQ(run(scene, {"--set", "formats=[inp]", "--set", "end=0.5s"}), 0) << errors;
  const std::string inp = read_file(path("out") / "scene.inp");
  EXPECT_NE(inp.find("GRAV, 4000,"), std::string::npos);
  EXPECT_NE(inp.find(", 3, 3, 1\n"), std::string::npos) << "half of the way";
}

}  // namespace
}  // namespace viscera
