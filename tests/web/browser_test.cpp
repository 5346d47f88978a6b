// The report as a browser shows it: not blank, moving with time, in both themes, without script
// errors, and never taking text of a file for markup.
#include "tests/web/browser.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <limits>
#include <regex>

#include "pipeline/base/atomic_file.hpp"
#include "stages/image/image_io.hpp"
#include "tests/common/needs.hpp"
#include "tests/geometry/shapes.hpp"
#include "tests/web/sample_run.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

constexpr int width = 1400, height = 900;

struct Rectangle {
  int left, top, w, h;
};

class Web : public ::testing::Test {
 protected:
  void SetUp() override { VISCERA_NEEDS(installed("chromium"), "chromium is not installed"); }

  // Runs viscera-report on the named inputs of a sample run.
  void make_report(const SampleRun& run, const std::vector<std::string>& inputs) {
    write_sample_run(run_, run);
    std::string command = fmt::format("'{}' --quiet --out '{}'", VISCERA_REPORT, out_.string());
    for (const auto& input : inputs) {
      const auto equals = input.find('=');
      command += fmt::format(" --in '{}={}'", input.substr(0, equals),
                             (run_ / input.substr(equals + 1)).string());
    }
    ASSERT_EQ(std::system((command + " >/dev/null").c_str()), 0);
  }
  void make_whole_report(const SampleRun& run = {}) {
    make_report(run, {"labels=labels/labels.nrrd", "mesh=tetmesh/mesh.vtu",
                      "trajectory=simulate/trajectory.h5"});
  }
  std::string address(const std::string& hash) const {
    return "file://" + (out_ / "report.html").string() + "#" + hash;
  }

  // An attribute of the page's #status element.
  static std::string status(const std::string& document, const std::string& attribute) {
    std::smatch tag, value;
    if (!std::regex_search(document, tag, std::regex("<output id=\"status\"[^>]*>"))) return "";
    const std::string text = tag.str();
    return std::regex_search(text, value, std::regex(attribute + "=\"([^\"]*)\"")) ? value[1].str()
                                                                                   : "";
  }
  Rectangle canvas(const std::string& document) {
    Rectangle r{};
    const std::string text = status(document, "data-canvas");
    EXPECT_EQ(std::sscanf(text.c_str(), "%d,%d,%d,%d", &r.left, &r.top, &r.w, &r.h), 4) << text;
    EXPECT_LE(r.top + r.h, height) << "the 3D view must stand on the first screen";
    return r;
  }

  TemporaryFolder folder_{fs::temp_directory_path()};
  fs::path run_ = folder_.path() / "run", out_ = folder_.path() / "out";
  Browser browser_{folder_.path()};
};

// From the first `begin` to the next `end`.
std::string between(const std::string& text, const std::string& begin, const std::string& end) {
  const auto from = text.find(begin);
  if (from == std::string::npos) return "";
  return text.substr(from, text.find(end, from) - from);
}

// Part of a rectangle in the second label's orange, seen through the first label or bare.
double orange_part(const Picture& picture, const Rectangle& r) {
  int orange = 0;
  for (int y = r.top; y < r.top + r.h; ++y) {
    for (int x = r.left; x < r.left + r.w; ++x) {
      const std::uint8_t* p = &picture.rgb[3u * (static_cast<std::size_t>(y) * width + x)];
      orange += p[0] > 110 && p[0] > p[1] + 25 && p[1] > p[2] + 35;
    }
  }
  return orange / (static_cast<double>(r.w) * r.h);
}

TEST_F(Web, TheMeshIsDrawnMovesAndFollowsThemeAndField) {
  make_whole_report();
  const std::string document = browser_.document(address("t=0"), width, height);
  ASSERT_EQ(status(document, "data-state"), "ready") << document.substr(0, 2000);
  const Rectangle r = canvas(document);
  const auto picture = [this](const std::string& hash) {
    return browser_.screenshot(address(hash), width, height);
  };
  const auto changed = [&r](const Picture& a, const Picture& b) {
    return difference(a, b, r.left, r.top, r.w, r.h);
  };

  const Picture start = picture("t=0&theme=light"), later = picture("t=0.2&theme=light");
  const Picture dark = picture("t=0.2&theme=dark");
  for (const Picture* p : {&start, &later, &dark}) {
    EXPECT_GT(p->statistics(r.left, r.top, r.w, r.h).deviation, 12.0) << "a blank canvas";
    EXPECT_GT(orange_part(*p, r), 0.005) << "the inner label does not show";
  }
  EXPECT_GT(changed(start, later), 0.02) << "time does not move it";
  EXPECT_GT(start.statistics(0, 0, width, height).mean, 180.0);
  EXPECT_LT(dark.statistics(0, 0, width, height).mean, 70.0);

  const Picture shape = picture("t=0.2&theme=light&colour=shape");
  const Picture ratio = picture("t=0.2&theme=light&colour=ratio");
  EXPECT_GT(changed(later, shape), 0.05);
  EXPECT_GT(changed(later, ratio), 0.05);
  EXPECT_GT(changed(shape, ratio), 0.05);
  const Picture stress = picture("t=0.2&theme=light&colour=stress");
  EXPECT_GT(changed(stress, shape), 0.05);
  EXPECT_GT(changed(picture("t=0.2&theme=light&colour=quality"), stress), 0.05);
  EXPECT_GT(stress.statistics(r.left, r.top, r.w, r.h).deviation, 12.0) << "a blank canvas";
  EXPECT_EQ(browser_.console(), "");
}

// A force by its size, a probe by its way from where it was at the start.
TEST_F(Web, TheChartsShowForcesAndProbes) {
  make_whole_report();
  const std::string document = browser_.document(address("t=0"), width, height);
  EXPECT_NE(
      document.find("Force on the body, by what exerts it against time: ground ends at 13&nbsp;N"),
      std::string::npos);
  EXPECT_NE(document.find("How far probes have moved against time: tip ends at "),
            std::string::npos);
  EXPECT_EQ(document.find("probe tip x"), std::string::npos) << "a component has a plot";
}

TEST_F(Web, PlayingReachesTheEndWithEverythingOn) {
  make_whole_report();
  const std::string document =
      browser_.document(address("t=0&play=1&edges=1&colour=displacement"), width, height);
  EXPECT_EQ(status(document, "data-state"), "ready");
  EXPECT_NE(document.find(">0.22&nbsp;s</output>"), std::string::npos)
      << document.substr(document.find("id=\"clock\""), 60);
  EXPECT_EQ(browser_.console(), "");
}

TEST_F(Web, NamesFromFilesAreTextNeverMarkup) {
  SampleRun run;
  run.tumour_name = "</script><script>document.title='owned'</script><img src=x onerror=alert(1)>";
  make_whole_report(run);
  const std::string document = browser_.document(address("t=0"), width, height);
  EXPECT_EQ(status(document, "data-state"), "ready");
  EXPECT_EQ(document.find("<img"), std::string::npos);
  EXPECT_EQ(document.find("<title>owned"), std::string::npos);
  EXPECT_NE(document.find("&lt;img src=x onerror=alert(1)&gt;"), std::string::npos);
  EXPECT_EQ(browser_.console(), "");
}

TEST_F(Web, LabelsAndMeshAloneMakeAReportWithoutTheView) {
  make_report({}, {"labels=labels/labels.nrrd", "mesh=tetmesh/mesh.vtu"});
  const std::string document = browser_.document(address(""), width, height);
  EXPECT_EQ(status(document, "data-state"), "ready");
  EXPECT_NE(document.find("All 2 quality gates passed"), std::string::npos);
  EXPECT_NE(document.find("1705"), std::string::npos) << "the labels' volume";
  EXPECT_EQ(browser_.console(), "");
}

TEST_F(Web, LostPartsAreRingedAndListedWithPlaceAndThickness) {
  make_whole_report();
  const std::string document = browser_.document(address("t=0"), width, height);
  for (const char* text :
       {"Parts that were lost", ">4.25</td>", ">1.75</td>", ">1.63</td>", "60.0, -20.0, 30.0",
        "The mesh lacks 2.5 ml, 0.14 % of the label, up to 4.3 mm away", "a cell size of 1.6 mm"})
    EXPECT_NE(document.find(text), std::string::npos) << text;
  const Rectangle r = canvas(document);
  const Picture picture = browser_.screenshot(address("t=0&theme=light"), width, height);
  int red = 0;  // the ring's colour, which no label has
  for (int y = r.top; y < r.top + r.h; ++y) {
    for (int x = r.left; x < r.left + r.w; ++x) {
      const std::uint8_t* p = &picture.rgb[3u * (static_cast<std::size_t>(y) * width + x)];
      red += p[0] > 140 && p[1] < 60 && p[2] < 60;
    }
  }
  EXPECT_GT(red, 40);
  EXPECT_LT(red, 400);
  EXPECT_EQ(browser_.console(), "");
}

TEST_F(Web, TheCtIsShownWithTheLabelsOnIt) {
  const LabelImage labels = testing::nested_balls();
  ScalarImage ct{.frame = labels.frame};
  for (const int id : labels.voxels) ct.values.push_back(id == 0 ? -100.0f : 30.0f * float(id));
  write_nrrd(folder_.path() / "labels.nrrd", labels);
  write_nrrd(folder_.path() / "ct.nrrd", ct);
  make_report({}, {"labels=../labels.nrrd", "image=../ct.nrrd"});
  const std::string document = browser_.document(address("theme=light"), width, height);
  EXPECT_EQ(status(document, "data-state"), "ready");
  for (const char* plane : {"CT, axial at ", "CT, coronal at ", "CT, sagittal at "})
    EXPECT_NE(document.find(plane), std::string::npos) << plane;
  EXPECT_NE(document.find("outlines of 2 labels"), std::string::npos);
  const Picture picture = browser_.screenshot(address("theme=light"), width, height);
  EXPECT_GT(orange_part(picture, {0, 0, width, height}), 0.0002) << "no outline of the inner label";
  EXPECT_EQ(browser_.console(), "");
}

TEST_F(Web, TheErrorOfTheBodyAtRestLeadsThePageByItsParts) {
  SampleRun run;
  run.certified = true;
  make_whole_report(run);
  const std::string verdict =
      between(browser_.document(address(""), width, height), "id=\"verdict\"", "</div>");
  const auto at = verdict.find("At rest the body is off by 0.53&nbsp;mm");
  EXPECT_LT(at, verdict.find("quality gates passed")) << verdict;
  for (const char* text : {"1&nbsp;% of its displacement", "solver 0.021&nbsp;mm",
                           "elements 0.44&nbsp;mm", "mesh 0.087&nbsp;mm", "tumour 0.5&nbsp;mm"})
    EXPECT_NE(verdict.find(text), std::string::npos) << text << verdict;
  run.no_error_bar = "the body is not at rest";
  make_whole_report(run);
  EXPECT_NE(browser_.document(address(""), width, height)
                .find("How far the body is off is not known: the body is not at rest."),
            std::string::npos);
}

TEST_F(Web, TheSolversErrorIsToldFromThatOfElementsAndMeshWhichWasNotAskedFor) {
  make_whole_report({});
  const std::string document = browser_.document(address(""), width, height);
  const auto at = document.find("Solver's error at rest");
  ASSERT_NE(at, std::string::npos);
  const std::string figure = document.substr(at, 250);
  EXPECT_NE(figure.find("1.2&nbsp;%"), std::string::npos) << figure;
  EXPECT_NE(figure.find("the error of elements and mesh comes besides"), std::string::npos)
      << figure;
  EXPECT_NE(document.find("How far the body is off was not asked for"), std::string::npos);
}

TEST_F(Web, AFailedGateLeadsThePageWithItsMeaningAndRemedyAndItsPlaceIsRinged) {
  SampleRun run;
  run.gate_fails = true;
  make_whole_report(run);
  const std::string document = browser_.document(address(""), width, height);
  EXPECT_NE(document.find("1 of 4 quality gates failed"), std::string::npos);
  const std::string verdict = between(document, "id=\"verdict\"", "</div>");
  EXPECT_NE(verdict.find("min dihedral 12.31°, required ≥ 15°"), std::string::npos) << verdict;
  EXPECT_NE(
      verdict.find(
          "The mesh has slivers. At (-12.5, 44.1, 8.3) mm LPS. To change it: set improve: own."),
      std::string::npos)
      << verdict;
  const std::string table = between(document, "id=\"gates-table\"", "</table>");
  for (const char* text : {"The mesh has slivers.", "at (-12.5, 44.1, 8.3) mm", "set improve: own"})
    EXPECT_NE(table.find(text), std::string::npos) << text << table;
  EXPECT_EQ(document.find("id=\"gates-choice\" hidden"), std::string::npos) << "no rings";
  EXPECT_NE(document.find("attachment, tearing, self contact"), std::string::npos) << "effects off";
  EXPECT_EQ(browser_.console(), "");
}

TEST_F(Web, ACaveatIsTheFirstLineOfTheReportAndStandsInItsSummary) {
  SampleRun run;
  run.caveat = "The body is cut at its <superior> side.";
  make_whole_report(run);
  const std::string document = browser_.document(address(""), width, height);
  const std::string verdict = between(document, "id=\"verdict\"", "</div>");
  const auto caveat = verdict.find("The body is cut at its &lt;superior&gt; side.");
  EXPECT_LT(caveat, verdict.find("All 4 quality gates passed")) << verdict;
  const Json summary = Json::parse(read_file(out_ / "summary.json"));
  EXPECT_EQ(summary["verdict"]["caveats"], Json::array({run.caveat}));
}

TEST_F(Web, FiftyThousandTetsStaySmallAndOpenSoon) {
  SampleRun run;
  run.cells = 20;
  run.frames = 120;
  make_whole_report(run);
  EXPECT_LT(fs::file_size(out_ / "report.html"), 15'000'000u);
  double least = std::numeric_limits<double>::infinity();  // ms; what else runs here only adds
  for (int load = 0; load < 5 && least > 2000.0; ++load) {
    const std::string ms =
        status(browser_.document(address("t=0"), width, height), "data-first-frame-ms");
    ASSERT_FALSE(ms.empty());
    least = std::min(least, std::stod(ms));
  }
  std::printf("first frame after %g ms, page of %.1f MB\n", least,
              static_cast<double>(fs::file_size(out_ / "report.html")) / 1e6);
  EXPECT_LT(least, 2000.0);
}

}  // namespace
}  // namespace viscera
