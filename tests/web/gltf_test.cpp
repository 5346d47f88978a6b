// animation.glb holds what the trajectory holds: sizes and bounds as the format wants them, every
// label's surface closed, and the last target at the last frame.
#include "stages/report/gltf.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/param.hpp"
#include "tests/web/sample_run.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

class Gltf : public testing::Test {
 protected:
  Gltf() {
    write_sample_run(folder_.path(), {});
    reader_ = std::make_unique<TrajectoryReader>(folder_.path() / "simulate" / "trajectory.h5");
  }

  void make(std::size_t frames) {
    file_ = gltf_binary(*reader_, frames);
    ASSERT_GT(file_.size(), 28u);
    json_ = Json::parse(file_.substr(20, word(12)));
  }
  std::uint32_t word(std::size_t at) const {
    std::uint32_t value = 0;
    std::memcpy(&value, file_.data() + at, 4);
    return value;
  }
  template <class T>
  std::vector<T> values(int accessor) const {
    const Json& a = json_["accessors"][accessor];
    const Json& view = json_["bufferViews"][a["bufferView"].get<int>()];
    std::vector<T> all(view["byteLength"].get<std::size_t>() / sizeof(T));
    const std::size_t begin = 20 + word(12) + 8 + view["byteOffset"].get<std::size_t>();
    std::memcpy(all.data(), file_.data() + begin, all.size() * sizeof(T));
    return all;
  }

  TemporaryFolder folder_{fs::temp_directory_path()};
  std::unique_ptr<TrajectoryReader> reader_;
  std::string file_;
  Json json_;
};

TEST_F(Gltf, ChunksAndBoundsAreWhatTheFormatWants) {
  make(5);
  EXPECT_EQ(file_.substr(0, 4), "glTF");
  EXPECT_EQ(word(4), 2u);
  EXPECT_EQ(word(8), file_.size());
  EXPECT_EQ(word(12) % 4, 0u);
  EXPECT_EQ(20 + word(12) + 8 + word(20 + word(12)), file_.size());
  EXPECT_EQ(json_["materials"].size(), 2u);
  EXPECT_EQ(json_["materials"][0]["name"], "liver");
  EXPECT_EQ(json_["materials"][0]["alphaMode"], "BLEND");
  EXPECT_EQ(json_["animations"][0]["channels"][0]["target"]["path"], "weights");
  for (const auto& primitive : json_["meshes"][0]["primitives"]) {
    ASSERT_EQ(primitive["targets"].size(), 4u);
    const Json& positions = json_["accessors"][primitive["attributes"]["POSITION"].get<int>()];
    for (const auto& target : primitive["targets"]) {
      EXPECT_EQ(json_["accessors"][target["POSITION"].get<int>()]["count"], positions["count"]);
    }
    for (const auto i : values<std::uint32_t>(primitive["indices"])) {
      ASSERT_LT(i, positions["count"].get<std::uint32_t>());
    }
  }
}

TEST_F(Gltf, TheAnimationShowsOneTargetAfterTheOther) {
  make(5);
  const Json& sampler = json_["animations"][0]["samplers"][0];
  const auto times = values<float>(sampler["input"]), weights = values<float>(sampler["output"]);
  ASSERT_EQ(times.size(), 5u);
  EXPECT_EQ(times.front(), 0.0f);
  EXPECT_NEAR(times.back(), reader_->times_s().back(), 1e-6);
  ASSERT_EQ(weights.size(), 20u);
  for (std::size_t f = 0; f < 5; ++f) {
    for (std::size_t t = 0; t < 4; ++t) {
      EXPECT_EQ(weights[4 * f + t], t + 1 == f ? 1.0f : 0.0f);
    }
  }
}

TEST_F(Gltf, TheLastTargetIsTheLastFrameAndEncloses) {
  make(4);
  const Json& primitive = json_["meshes"][0]["primitives"][1];  // the tumour
  auto xyz = values<float>(primitive["attributes"]["POSITION"]);
  const auto moves = values<float>(primitive["targets"][2]["POSITION"]);
  const auto index = values<std::uint32_t>(primitive["indices"]);
  for (std::size_t i = 0; i < xyz.size(); ++i) xyz[i] += moves[i];
  double enclosed = 0.0;
  for (std::size_t t = 0; t < index.size(); t += 3) {
    const float *a = &xyz[3 * index[t]], *b = &xyz[3 * index[t + 1]], *c = &xyz[3 * index[t + 2]];
    enclosed += (a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                 a[2] * (b[0] * c[1] - b[1] * c[0])) /
                6.0;
  }
  const TetMesh& mesh = reader_->mesh();
  const auto last = reader_->positions_mm(reader_->times_s().size() - 1);
  double of_tets = 0.0;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    if (mesh.labels[t] != 2) continue;
    double e[3][3];
    for (int c = 0; c < 3; ++c) {
      for (int k = 0; k < 3; ++k) {
        e[c][k] = last[3 * mesh.tets[t][c + 1] + k] - last[3 * mesh.tets[t][0] + k];
      }
    }
    of_tets += (e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) +
                e[0][1] * (e[1][2] * e[2][0] - e[1][0] * e[2][2]) +
                e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0])) /
               6.0;
  }
  EXPECT_NEAR(enclosed / of_tets, 1.0, 1e-3);
}

TEST_F(Gltf, IsLeftOutWhereNoFrameIsAskedFor) {
  EXPECT_EQ(gltf_binary(*reader_, 0), "");
}

}  // namespace
}  // namespace viscera
