// checkpoint.h5: damaged files are told from whole ones, and whole ones of absurd states do no
// harm.
#include "stages/simulate/files/checkpoint.hpp"

#include <gtest/gtest.h>

#include "pipeline/base/error.hpp"
#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

constexpr sim::TimeGrid grid{.substeps = 32, .end_s = 4};

class Checkpoint : public Simulate {
 protected:
  // Of the cube, a frame after the start, with this velocity at its first vertex.
  void write(double v) const {
    const std::size_t n = read_vtu(path("mesh.vtu")).points.size();
    sim::State state{.u = std::vector<sim::Vec3<double>>(n),
                     .v = std::vector<sim::Vec3<double>>(n)};
    state.v[0].x = v;
    state.step = 32;
    write_checkpoint(path("checkpoint.h5"), state, grid.substep_s());
  }
  int go_on(const std::string& precision) {
    return run(drop_scene, {"--in", "checkpoint=" + path("checkpoint.h5").string(), "--set",
                            "end=0.1s", "--set", "precision=" + precision});
  }
};

TEST_F(Checkpoint, AnyDamagedByteAndAnyTruncationIsBadInput) {
  write(0.5);
  EXPECT_EQ(read_checkpoint(path("checkpoint.h5"), 64, grid).v[0].x, 0.5);
  const std::string whole = read_file(path("checkpoint.h5"));
  const auto refused = [&](const std::string& bytes) {
    write_atomically(path("damaged.h5"), bytes);
    try {
      read_checkpoint(path("damaged.h5"), 64, grid);
    } catch (const Error& e) {
      return e.code() == ExitCode::bad_input &&
             std::string(e.what()).find("damaged.h5: file: a checksum") != std::string::npos;
    }
    return false;
  };
  for (std::size_t i = 0; i < whole.size(); i += 7) {
    std::string damaged = whole;
    damaged[i] = static_cast<char>(damaged[i] ^ (1 << (i % 8)));
    EXPECT_TRUE(refused(damaged)) << "byte " << i << " of " << whole.size();
  }
  for (const std::size_t size :
       {std::size_t{0}, std::size_t{100}, std::size_t{512}, whole.size() - 1})
    EXPECT_TRUE(refused(whole.substr(0, size))) << size << " bytes";
}

TEST_F(Checkpoint, VelocitiesThatNoBodyHasEndTheRunAsBadInputOrDiverged) {
  write(0.0);
  EXPECT_EQ(go_on("fp32"), 0) << errors;
  ASSERT_EQ(manifest().caveats.size(), 1u);
  EXPECT_NE(manifest().caveats[0].find("a checkpoint at t 0.01667 s"), std::string::npos);
  for (const std::string precision : {"fp32", "fp64"}) {
    for (const double v : {1e4, 1e6, 1e12, 1e20, 1e39, 1e300}) {
      write(v);
      const int code = go_on(precision);
      EXPECT_TRUE(code == 4 || code == 7) << v << " m/s: " << code << '\n' << errors;
    }
  }
}

TEST_F(Checkpoint, OfAnotherBodyWithAsManyVerticesIsBadInput) {
  ASSERT_EQ(run(drop_scene, {"--set", "end=0.05s"}), 0) << errors;
  fs::copy_file(path("out") / "checkpoint.h5", path("checkpoint.h5"));
  EXPECT_EQ(go_on("fp32"), 0) << errors;
  TetMesh mesh = read_vtu(path("mesh.vtu"));
  for (auto& p : mesh.points) p[0] *= 1.01;
  write_vtu(path("mesh.vtu"), mesh);
  EXPECT_EQ(go_on("fp32"), 4);
  EXPECT_NE(errors.find("/body: that of another mesh"), std::string::npos) << errors;
}

}  // namespace
}  // namespace viscera
