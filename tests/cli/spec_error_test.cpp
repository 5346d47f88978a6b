// A spec that is wrong ends with the contract's exit code and a message that names place, field and
// remedy, before any stage works and without a trace in the output folder.
#include <gtest/gtest.h>

#include "tests/cli/workplace.hpp"

namespace viscera::test {
namespace {

struct BadSpec {
  const char* name;
  const char* stages;              // the lines under `stages:`, which is line 4
  std::vector<std::string> extra;  // arguments
  int exit;
  std::vector<std::string> says;  // parts of the message
};

std::ostream& operator<<(std::ostream& out, const BadSpec& bad) {
  return out << bad.name;
}

const char* const chain = "  alpha: {in: {volume: volume.txt}}\n  beta: {}\n  gamma: {}\n";

const std::vector<BadSpec> bad_specs = {
    {"UnknownStage", "  alfa: {}\n", {}, 3, {"bad.yaml:5:3", "'alfa'", "did you mean 'alpha'?"}},
    {"UnknownParam",
     "  alpha:\n    in: {volume: volume.txt}\n    txt: hi\n",
     {},
     3,
     {"bad.yaml:7:10", "alpha.txt", "did you mean 'text'?"}},
    {"OutOfRange",
     "  alpha: {in: {volume: volume.txt}}\n  beta:\n    size: 50 mm\n",
     {},
     3,
     {"bad.yaml:7:11", "beta.size", "50 mm", "1 to 10 mm"}},
    {"NoUnit",
     "  alpha: {in: {volume: volume.txt}}\n  beta: {size: 5}\n",
     {},
     3,
     {"bad.yaml:6:16", "beta.size", "has no unit", "5mm"}},
    {"UnknownRole",
     "  alpha: {in: {volum: volume.txt}}\n",
     {},
     3,
     {"bad.yaml:5:23", "alpha.in.volum", "did you mean 'volume'?"}},
    {"MissingRole", "  beta: {}\n", {}, 3, {"bad.yaml:5:3", "beta.in.a", "missing", "add"}},
    {"RoleAlreadyWritten",
     "  alpha: {in: {volume: volume.txt}}\n  beta: {in: {a: volume.txt}}\n",
     {},
     3,
     {"bad.yaml:6:18", "beta.in.a", "stage 'alpha' already writes"}},
    {"TwoWriters",
     "  alpha: {in: {volume: volume.txt}}\n  delta: {in: {volume: volume.txt}}\n",
     {},
     3,
     {"bad.yaml:6:3", "delta", "role 'a'", "'alpha'"}},
    {"Cycle", "  loop_one: {}\n  loop_two: {}\n", {}, 3, {"bad.yaml:5:3", "cycle", "loop_two"}},
    {"TwoFilesForOneRole",
     "  alpha: {in: {volume: [volume.txt, volume.txt]}}\n",
     {},
     3,
     {"alpha.in.volume", "2 files"}},
    {"MissingFile",
     "  alpha:\n    in:\n      volume: absent.nrrd\n",
     {},
     4,
     {"bad.yaml:7:15", "alpha.in.volume", "absent.nrrd"}},
    {"DeviceAsFile",
     "  alpha: {in: {volume: /dev/zero}}\n",
     {},
     4,
     {"alpha.in.volume", "/dev/zero"}},
    {"DuplicateKey", "  beta: {}\n  beta: {}\n", {}, 3, {"bad.yaml:6:3", "beta", "twice"}},
    {"NotYaml", "  beta: {size: 4mm\n", {}, 3, {"bad.yaml:", "remedy"}},
    {"VariableInBraces", "  alpha: {in: {volume: ${input}}}\n", {}, 3, {"bad.yaml:5:", "quotes"}},
    {"UnknownVariable",
     "  alpha: {in: {volume: \"${inptu}\"}}\n",
     {},
     3,
     {"bad.yaml:5:24", "${inptu}", "did you mean 'input'?"}},
    {"StageNameWithSlash", "  ../alpha: {}\n", {}, 3, {"bad.yaml:5:3", "../alpha"}},
    {"SetUnknownVariable",
     chain,
     {"--set", "imput=x"},
     3,
     {"--set imput", "did you mean 'input'?"}},
    {"SetUnknownStage",
     chain,
     {"--set", "betta.size=4mm"},
     3,
     {"--set betta.size", "did you mean 'beta'?"}},
    {"SetUnknownParam",
     chain,
     {"--set", "beta.siz=4mm"},
     3,
     {"command line", "beta.siz", "did you mean 'size'?"}},
    {"SetOutOfRange",
     chain,
     {"--set", "beta.size=4m"},
     3,
     {"command line", "beta.size", "1 to 10 mm"}},
    {"SetWithoutEquals", chain, {"--set", "beta.size"}, 2, {"--set", "STAGE.PARAM=VALUE"}},
};

class SpecRefused : public testing::TestWithParam<BadSpec> {};

TEST_P(SpecRefused, WithPlaceFieldAndRemedyAndNothingWritten) {
  const Workplace work;
  work.write("bad.yaml",
             std::string("viscera: 1\nvars:\n  input: volume.txt\nstages:\n") + GetParam().stages);
  const auto run = work.run_spec("bad.yaml", GetParam().extra);
  EXPECT_EQ(run.exit, GetParam().exit) << run.errors;
  for (const auto& part : GetParam().says) {
    EXPECT_NE(run.errors.find(part), std::string::npos) << part << "\n" << run.errors;
  }
  EXPECT_EQ(work.started().find(" run"), std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(work.path("out/bad")));
}

INSTANTIATE_TEST_SUITE_P(Each, SpecRefused, testing::ValuesIn(bad_specs),
                         [](const auto& instance) { return std::string(instance.param.name); });

TEST(Set, AVariableIsRelativeToTheCurrentFolderAndThatOfTheSpecToTheSpec) {
  const Workplace work;
  std::filesystem::create_directories(work.path("specs/data"));
  std::filesystem::rename(work.path("volume.txt"), work.path("specs/volume.txt"));
  std::filesystem::rename(work.path("spec.yaml"), work.path("specs/spec.yaml"));
  EXPECT_EQ(work.viscera({"run", "specs/spec.yaml"}).exit, 0);
  work.write("mine.txt", "my voxels\n");
  EXPECT_EQ(work.viscera({"run", "specs/spec.yaml", "--set", "input=mine.txt"}).exit, 0);
  EXPECT_NE(work.read("out/spec/page.html").find("my voxels"), std::string::npos);
}

TEST(Set, AVariableWithoutAValueAsksForOne) {
  const Workplace work;
  work.write("open.yaml",
             "viscera: 1\nvars:\n  input:\nstages:\n  alpha:\n    in:\n      volume: ${input}\n");
  const auto run = work.viscera({"run", "open.yaml"});
  EXPECT_EQ(run.exit, 3);
  EXPECT_NE(run.errors.find("add --set input=VALUE"), std::string::npos) << run.errors;
  EXPECT_EQ(work.viscera({"run", "open.yaml", "--set", "input=volume.txt"}).exit, 0);
}

TEST(CommandLine, UnknownOptionsAndNoSubcommandAreUsageErrors) {
  const Workplace work;
  EXPECT_EQ(work.viscera({}).exit, 2);
  EXPECT_EQ(work.viscera({"run"}).exit, 2);
  EXPECT_EQ(work.viscera({"run", "spec.yaml", "--dry"}).exit, 2);
  EXPECT_EQ(work.viscera({"--help"}).exit, 0);
}

}  // namespace
}  // namespace viscera::test
