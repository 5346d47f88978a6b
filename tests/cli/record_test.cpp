// `viscera record` and `viscera diff` on runs as the engine lays them out.
#include <gtest/gtest.h>

#include "pipeline/base/json_value.hpp"
#include "tests/cli/workplace.hpp"
#include "tests/common/needs.hpp"

namespace viscera::test {
namespace {

namespace fs = std::filesystem;

class Record : public testing::Test {
 protected:
  void SetUp() override { ASSERT_EQ(work_.run({"--set", "beta.limit=99"}).exit, 0); }

  Json record() const {
    const auto result = work_.viscera({"record", "out/spec"});
    EXPECT_EQ(result.exit, 0) << result.errors;
    return json("out/spec/record/record.json");
  }
  Json json(const std::string& file) const { return read_json(work_.path(file)).root().object(); }
  void expect_refused(const std::string& run, int exit, const std::string& part) const {
    const auto before = work_.snapshot();
    const auto result = work_.viscera({"record", run});
    EXPECT_EQ(result.exit, exit) << result.errors;
    EXPECT_TRUE(contains(result.errors, part)) << part << "\n" << result.errors;
    EXPECT_TRUE(contains(result.errors, "remedy:")) << result.errors;
    EXPECT_EQ(work_.snapshot(), before) << "a refused record leaves nothing";
  }
  const Workplace work_;
};

Json parameter(const Json& record, const std::string& stage, const std::string& name) {
  for (const auto& one : record["parameters"]) {
    if (one["stage"] == stage && one["name"] == name) return one;
  }
  return Json::object();
}

TEST_F(Record, SaysOfEveryParameterWhereItWasSet) {
  const Json found = record();
  const Json size = parameter(found, "beta", "size");
  EXPECT_EQ(size["origin"], "spec");
  EXPECT_TRUE(contains(size["where"], "spec.yaml:")) << size;
  EXPECT_EQ(size["unit"], "mm");
  EXPECT_EQ(parameter(found, "beta", "limit")["origin"], "command line");
  EXPECT_EQ(parameter(found, "alpha", "text")["origin"], "default");
  EXPECT_EQ(found["run"]["stages"], (Json{"alpha", "beta", "gamma"}));
}

TEST_F(Record, IsOneFolderThatHoldsWhatTheStagesWrote) {
  record();
  for (const char* file : {"record.md", "record.json", "record.schema.json",
                           "ro-crate-metadata.json", "alpha/alpha.txt", "gamma/page.html"})
    EXPECT_TRUE(fs::is_regular_file(work_.path("out/spec/record") / file)) << file;
  EXPECT_EQ(work_.read("out/spec/record/beta/beta.txt"), work_.read("out/spec/beta/beta.txt"));
  EXPECT_FALSE(fs::exists(work_.path("out/spec/record/volume.txt"))) << "inputs may be a patient's";
}

TEST_F(Record, NamesNoFolderOfTheMachine) {
  ASSERT_EQ(work_
                .viscera({"run", work_.path("spec.yaml").string(), "--set",
                          "input=" + work_.path("volume.txt").string()})
                .exit,
            0);
  record();
  const std::string here = work_.path("").string();
  for (const auto& entry : fs::recursive_directory_iterator(work_.path("out/spec/record"))) {
    if (!entry.is_regular_file()) continue;
    EXPECT_FALSE(contains(read_file(entry.path()), here)) << entry.path();
  }
}

TEST_F(Record, HasTheSameBytesWhenItIsWrittenAgain) {
  record();
  const std::string first = work_.read("out/spec/record/record.json");
  const std::string crate = work_.read("out/spec/record/ro-crate-metadata.json");
  record();
  EXPECT_EQ(work_.read("out/spec/record/record.json"), first);
  EXPECT_EQ(work_.read("out/spec/record/ro-crate-metadata.json"), crate);
}

TEST_F(Record, ReplacesARecordAndNothingElse) {
  record();
  work_.write("out/spec/record/note.txt", "of the earlier record\n");
  record();
  EXPECT_FALSE(fs::exists(work_.path("out/spec/record/note.txt")));
  fs::create_directory(work_.path("mine"));
  work_.write("mine/thesis.txt", "years\n");
  const auto refused = work_.viscera({"record", "out/spec", "--out", "mine"});
  EXPECT_EQ(refused.exit, 2);
  EXPECT_TRUE(contains(refused.errors, "holds something else")) << refused.errors;
  EXPECT_EQ(work_.read("mine/thesis.txt"), "years\n");
  EXPECT_EQ(work_.viscera({"record", "out/spec", "--out", "elsewhere/of/it"}).exit, 0);
  EXPECT_TRUE(fs::is_regular_file(work_.path("elsewhere/of/it/record.json")));
}

TEST_F(Record, NamesEveryFileToArchives) {
  record();
  const Json crate = json("out/spec/record/ro-crate-metadata.json");
  std::map<std::string, Json> entities;
  for (const auto& entity : crate["@graph"]) {
    EXPECT_TRUE(entities.emplace(entity["@id"], entity).second) << entity["@id"] << " twice";
  }
  std::size_t files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(work_.path("out/spec/record"))) {
    if (!entry.is_regular_file() || entry.path().filename() == "ro-crate-metadata.json") continue;
    const std::string id = entry.path().lexically_relative(work_.path("out/spec/record")).string();
    ASSERT_TRUE(entities.contains(id)) << id;
    EXPECT_EQ(entities[id]["contentSize"], std::to_string(entry.file_size())) << id;
    ++files;
  }
  EXPECT_EQ(entities["./"]["hasPart"].size(), files);
  EXPECT_EQ(entities["#beta"]["instrument"]["@id"], "#viscera-beta");
  EXPECT_EQ(entities["#beta"]["object"][0]["@id"], "alpha/alpha.txt");
  // All that is referred to is there.
  for (const auto& [id, entity] : entities) {
    for (const char* member : {"hasPart", "mentions", "object", "result"}) {
      for (const auto& one : entity.value(member, Json::array()))
        EXPECT_TRUE(entities.contains(one["@id"])) << one;
    }
  }
}

TEST_F(Record, FollowsItsSchema) {
  VISCERA_NEEDS(works("python3 -c 'import jsonschema'"), "python3-jsonschema is not installed");
  record();
  work_.write("schema.json", work_.viscera({"schema", "record"}).out);
  EXPECT_EQ(work_.read("schema.json"), work_.read("out/spec/record/record.schema.json"));
  work_.write("check.py", R"(
import json, sys, jsonschema
schema, record = json.load(open(sys.argv[1])), json.load(open(sys.argv[2]))
jsonschema.Draft7Validator.check_schema(schema)
jsonschema.Draft7Validator(schema).validate(record)
del record["credibility"][3]
assert not jsonschema.Draft7Validator(schema).is_valid(record)
)");
  const std::string command = "python3 '" + work_.path("check.py").string() + "' '" +
                              work_.path("schema.json").string() + "' '" +
                              work_.path("out/spec/record/record.json").string() + "'";
  EXPECT_EQ(std::system(command.c_str()), 0);
}

TEST_F(Record, OfNoRunIsRefused) {
  expect_refused("absent", 2, "no such folder");
  expect_refused("bin", 2, "a folder without run.json");
}

TEST_F(Record, OfSeveralCasesNamesThem) {
  work_.write("cases.yaml", work_.read("spec.yaml") + "cases: {one: {}, two: {beta.size: 5mm}}\n");
  ASSERT_EQ(work_.run_spec("cases.yaml").exit, 0);
  expect_refused("out/cases", 2, "the folder of 2 runs: one, two");
  EXPECT_EQ(work_.viscera({"record", "out/cases/two"}).exit, 0);
}

TEST_F(Record, OfAFailedRunIsRefused) {
  ASSERT_EQ(work_.run({"--set", "beta.text=fail"}).exit, 4);
  expect_refused("out/spec", 4, "beta: failed with 4: volume.txt: text fail");
}

TEST_F(Record, OfAnUnfinishedRunIsRefused) {
  work_.write("other.yaml", work_.read("spec.yaml"));
  ASSERT_EQ(work_.run_spec("other.yaml", {"--until", "alpha", "--set", "alpha.text=x"}).exit, 0);
  expect_refused("out/other", 4, "beta: has not run");
}

TEST_F(Record, OfStagesOfTwoRunsIsRefused) {
  ASSERT_EQ(work_.run({"--until", "alpha", "--set", "alpha.text=new"}).exit, 0);
  expect_refused("out/spec", 4, "which alpha has written since");
}

TEST_F(Record, OfADamagedManifestIsRefused) {
  fs::remove(work_.path("out/spec/beta/manifest.json"));
  work_.write("out/spec/beta/manifest.json", "{\"schema\": 1, \"stage\": 3}");
  expect_refused("out/spec", 4, "manifest.json: stage: 3");
}

TEST_F(Record, OfAChangedOutputIsRefused) {
  fs::remove(work_.path("out/spec/beta/beta.txt"));
  work_.write("out/spec/beta/beta.txt", "edited\n");
  expect_refused("out/spec", 4, "beta.txt: SHA-256");
}

TEST_F(Record, OfAFailedGateSaysSoFirst) {
  ASSERT_EQ(work_.run({"--set", "beta.limit=1"}).exit, 5);
  EXPECT_EQ(record()["run"]["state"], "failed");
  const std::string page = work_.read("out/spec/record/record.md");
  EXPECT_TRUE(contains(page.substr(0, page.find("## Methods")), "size")) << page.substr(0, 500);
}

TEST_F(Record, DiffTellsParametersAndOutputsThatDiffer) {
  work_.write("other.yaml", work_.read("spec.yaml"));
  ASSERT_EQ(work_.run_spec("other.yaml", {"--set", "beta.size=5mm"}).exit, 0);
  const auto result = work_.viscera({"diff", "out/spec", "out/other"});
  EXPECT_EQ(result.exit, 0) << result.errors;
  EXPECT_TRUE(contains(result.out, "beta.size: 4 -> 5 mm (+25 %)")) << result.out;
  EXPECT_TRUE(contains(result.out, "inputs: 1 differ, 3 equal")) << result.out;
  EXPECT_FALSE(contains(result.out, "alpha.txt")) << "it is equal\n" << result.out;
  EXPECT_EQ(work_.viscera({"diff", "out/spec", "absent"}).exit, 2);
}

class DiffFolder : public Record {
 protected:
  void SetUp() override {
    Record::SetUp();
    work_.write("other.yaml", work_.read("spec.yaml"));
    ASSERT_EQ(work_.run_spec("other.yaml", {"--set", "beta.size=5mm"}).exit, 0);
  }
  // The engine's stages have none that shows runs side by side.
  void add_compare() const {
    fs::create_hard_link(work_.path("bin/viscera-alpha"), work_.path("bin/viscera-compare"));
  }
  CommandResult diff(const std::vector<std::string>& environment = {}) const {
    return work_.viscera({"diff", "out/spec", "out/other", "--out", "out/diff"}, environment);
  }
};

TEST_F(DiffFolder, HoldsTablesAndThePicturesOfTheStageThatShowsBothRuns) {
  add_compare();
  const auto result = diff();
  ASSERT_EQ(result.exit, 0) << result.errors;
  EXPECT_EQ(result.out, "out/diff/diff.md\n");
  const std::string page = work_.read("out/diff/diff.md");
  EXPECT_TRUE(contains(page, "| beta.size | 4 | 5 | mm | +25 % |")) << page;
  EXPECT_TRUE(contains(page, "![compare/overlay.png](compare/overlay.png)")) << page;
  const std::string seen = work_.read("out/diff/compare/compare.txt");
  EXPECT_TRUE(contains(seen, R"("methods":["A","B"])")) << seen;
  EXPECT_LT(seen.find(work_.read("out/spec/beta/beta.txt")),
            seen.find(work_.read("out/other/beta/beta.txt")));
  const Json parameters = json("out/diff/diff.json")["parts"]["parameters"]["differing"];
  EXPECT_EQ(parameters[0]["name"], "beta.size");
}

TEST_F(DiffFolder, WithoutThatStageSaysWhyThereAreNoPictures) {
  ASSERT_EQ(diff().exit, 0);
  EXPECT_TRUE(contains(work_.read("out/diff/diff.md"), "No pictures: "))
      << work_.read("out/diff/diff.md");
}

TEST_F(DiffFolder, ReplacesAnEarlierOneAndNothingElse) {
  ASSERT_EQ(diff().exit, 0);
  work_.write("out/diff/left.txt", "of the earlier one");
  ASSERT_EQ(diff().exit, 0);
  EXPECT_FALSE(fs::exists(work_.path("out/diff/left.txt")));
  const auto before = work_.snapshot();
  const auto refused = work_.viscera({"diff", "out/spec", "out/other", "--out", "out/spec"});
  EXPECT_EQ(refused.exit, 2) << refused.errors;
  EXPECT_TRUE(contains(refused.errors, "earlier diff")) << refused.errors;
  EXPECT_EQ(work_.snapshot(), before);
}

TEST_F(DiffFolder, WhenThatStageFailsLeavesTheEarlierOneAndSaysWhatItSaid) {
  add_compare();
  ASSERT_EQ(diff().exit, 0);
  work_.write("out/diff/left.txt", "of the earlier one");
  const auto result = diff({"FAKE_compare=fail"});
  EXPECT_EQ(result.exit, 4) << result.errors;
  EXPECT_TRUE(contains(result.errors, "too odd")) << result.errors;
  EXPECT_TRUE(fs::exists(work_.path("out/diff/left.txt")));
  for (const auto& entry : fs::directory_iterator(work_.path("out")))
    EXPECT_FALSE(contains(entry.path().filename(), ".partial")) << entry.path();
}

TEST_F(DiffFolder, OfARunThatWasChangedAfterwardsIsRefused) {
  fs::remove(work_.path("out/spec/beta/beta.txt"));
  work_.write("out/spec/beta/beta.txt", "edited\n");
  EXPECT_EQ(diff().exit, 4);
  EXPECT_FALSE(fs::exists(work_.path("out/diff")));
}

}  // namespace
}  // namespace viscera::test
