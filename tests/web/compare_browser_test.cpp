// The page of a comparison as a browser shows it: the runs over one another, moving with time, in
// both themes, without script errors.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <regex>

#include "pipeline/base/atomic_file.hpp"
#include "tests/common/needs.hpp"
#include "tests/web/browser.hpp"
#include "tests/web/sample_run.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

constexpr int width = 1400, height = 2600;

class CompareWeb : public testing::Test {
 protected:
  void SetUp() override {
    VISCERA_NEEDS(installed("chromium"), "chromium is not installed");
    std::string inputs;
    for (const int frames : {12, 8}) {
      const fs::path run = folder_.path() / std::to_string(frames);
      write_sample_run(run, {.frames = frames});
      inputs += fmt::format(" --in 'trajectory={}'", (run / "simulate/trajectory.h5").string());
    }
    const std::string command = fmt::format(
        "'{}' --quiet --out '{}' {} --set 'cases=[{}, second]' --set 'methods=[{}, second]' "
        "--set 'grid=[second]' --set 'references=[{{precision: fp32}}]' >/dev/null",
        VISCERA_COMPARE, out_.string(), inputs, "<img src=x>", "<img src=x>");
    ASSERT_EQ(std::system(command.c_str()), 0);
  }
  std::string address(const std::string& hash) const {
    return "file://" + (out_ / "compare.html").string() + "#" + hash;
  }

  TemporaryFolder folder_{fs::temp_directory_path()};
  fs::path out_ = folder_.path() / "out";
  Browser browser_{folder_.path()};
};

TEST_F(CompareWeb, RunsAreDrawnOverOneAnotherMoveAndFollowTheTheme) {
  const std::string document = browser_.document(address("t=0"), width, height);
  ASSERT_NE(document.find("data-state=\"ready\""), std::string::npos) << document.substr(0, 2000);
  EXPECT_NE(document.find("&lt;img src=x&gt;"), std::string::npos) << "names are text";
  EXPECT_EQ(document.find("<img src=\"x\""), std::string::npos);
  EXPECT_NE(document.find("data:image/png;base64"), std::string::npos) << "the figures";
  EXPECT_NE(document.find("Solver error only: no two meshes"), std::string::npos);
  EXPECT_NE(document.find("not known: no finer truth"), std::string::npos);
  std::smatch found;
  ASSERT_TRUE(std::regex_search(document, found,
                                std::regex("data-canvas=\"([0-9]+),([0-9]+),([0-9]+),([0-9]+)\"")));
  const int left = std::stoi(found[1]), top = std::stoi(found[2]), w = std::stoi(found[3]),
            h = std::stoi(found[4]);
  const auto picture = [this](const std::string& hash) {
    return browser_.screenshot(address(hash), width, height);
  };
  const Picture start = picture("t=0&theme=light"), later = picture("t=0.2&theme=light");
  const Picture dark = picture("t=0.2&theme=dark");
  for (const Picture* p : {&start, &later, &dark}) {
    EXPECT_GT(p->statistics(left, top, w, h).deviation, 12.0) << "a blank canvas";
  }
  EXPECT_GT(difference(start, later, left, top, w, h), 0.02) << "time does not move it";
  EXPECT_GT(start.statistics(0, 0, width, height).mean, 180.0);
  EXPECT_LT(dark.statistics(0, 0, width, height).mean, 110.0);
  EXPECT_EQ(browser_.console(), "");
}

}  // namespace
}  // namespace viscera
