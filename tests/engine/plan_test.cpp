// What the engine says of a plan's stages once some of them have ended.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/engine/plan/case_report.hpp"
#include "pipeline/engine/plan/feed.hpp"
#include "pipeline/engine/run/inspect.hpp"
#include "pipeline/engine/run/run_folders.hpp"

namespace viscera::engine {
namespace {

namespace fs = std::filesystem;

PlannedStage planned(const std::string& stage, const std::string& case_name) {
  PlannedStage one;
  one.program.info.name = stage;
  one.case_name = case_name;
  return one;
}

Entry ended(ExitCode exit, const std::string& message, double wall_s = 0.0) {
  Entry entry;
  entry.manifest = {.stage = "alpha", .exit = exit, .message = message, .params = Json::object()};
  entry.manifest.wall_s = wall_s;
  entry.manifest_json = to_json(entry.manifest);
  return entry;
}

// A program that only describes itself.
void install(const TemporaryFolder& folder, const StageInfo& info) {
  const fs::path program = folder.path() / ("viscera-" + info.name);
  write_atomically(program, "#!/bin/sh\ncat <<'end'\n" + to_json(info).dump() + "\nend\n");
  fs::permissions(program, fs::perms::owner_all);
}

TEST(Plan, AGatheringStageReadsOfEveryCaseAlsoWhatTheFirstStageMakes) {
  const TemporaryFolder folder(fs::temp_directory_path());
  install(folder, {.name = "alpha", .outputs = {{.file = "a.txt", .role = "mesh"}}});
  install(folder, {.name = "omega", .inputs = {{.role = "mesh", .many = true}}});
  Spec spec;
  for (const char* name : {"soft", "stiff"})
    spec.cases.push_back({.name = name, .stages = {{.name = "alpha"}}});
  spec.gather = {{.name = "omega"}};
  Store store(folder.path() / "cache", false);
  Catalog catalog(folder.path(), store);
  const Plan plan = make_plan(spec, catalog);
  ASSERT_EQ(plan.size(), 3u);
  EXPECT_EQ(awaited_by(plan, 2), (std::vector<std::size_t>{0, 1}));
}

// The tets of a round are made for the error that the round before has found.
TEST(Plan, ARoundReadsWhatALaterStageOfTheRoundBeforeMade) {
  const TemporaryFolder folder(fs::temp_directory_path());
  install(folder, {.name = "alpha",
                   .inputs = {{.role = earlier_role, .required = false}},
                   .outputs = {{.file = "a.txt", .role = "mesh"}}});
  install(folder, {.name = "beta",
                   .inputs = {{.role = "mesh"}},
                   .outputs = {{.file = "b.txt", .role = earlier_role, .doc = "if asked"}}});
  write_atomically(folder.path() / "a.yaml",
                   "viscera: 1\nstages:\n  alpha: {}\n  beta: {}\ncases:\n  x: {}\n  y: {}\n"
                   "rounds: 2\n");
  const Spec spec = load_spec({.path = folder.path() / "a.yaml"});
  const auto only = [&](const std::string& name) {
    std::vector<std::string> names;
    for (const SpecCase& one :
         load_spec({.path = folder.path() / "a.yaml", .only_cases = {name}}).cases)
      names.push_back(one.name);
    return names;
  };
  using Names = std::vector<std::string>;
  EXPECT_EQ(only("y"), (Names{"y,round=1", "y,round=2"}));
  EXPECT_EQ(only("x,round=2"), (Names{"x,round=1", "x,round=2"})) << "what it follows";
  EXPECT_EQ(only("x,round=1"), Names{"x,round=1"});
  EXPECT_THROW(only("x,round=3"), Error);
  Store store(folder.path() / "cache", false);
  Catalog catalog(folder.path(), store);
  const Plan plan = make_plan(spec, catalog);
  std::vector<std::string> labels;
  for (const PlannedStage& stage : plan) labels.push_back(stage.label());
  EXPECT_EQ(labels, (std::vector<std::string>{
                        "x,round=1/alpha", "x,round=1/beta", "x,round=2/alpha", "x,round=2/beta",
                        "y,round=1/alpha", "y,round=1/beta", "y,round=2/alpha", "y,round=2/beta"}));
  using Indices = std::vector<std::size_t>;
  EXPECT_EQ(awaited_by(plan, 0), Indices{});
  EXPECT_EQ(awaited_by(plan, 2), Indices{1});
  EXPECT_EQ(awaited_by(plan, 3), Indices{2});
  EXPECT_EQ(awaited_by(plan, 4), Indices{}) << "another case's";
  EXPECT_EQ(awaited_by(plan, 6), Indices{5});
  // What beta has ended without, though it ended well, is said; after a failure alpha just waits.
  Entries entries(plan.size());
  entries[0] = ended(ExitCode::ok, ""), entries[1] = ended(ExitCode::ok, "");
  EXPECT_TRUE(lacks_input(plan[2], entries));
  EXPECT_EQ(left_unmade(plan, 2, entries), "x,round=1/beta wrote no b.txt (if asked)");
  entries[1] = ended(ExitCode::gate_failed, "");
  EXPECT_TRUE(lacks_input(plan[2], entries));
  EXPECT_EQ(left_unmade(plan, 2, entries), "");
}

// Of what `adapt` says the stage hears that has such a param, in the last round that it is the
// last; a later round waits whole for what it reads, and is needed where that was written.
TEST(Plan, AdaptGoesToItsStageAndEachRoundWaitsToBeAskedFor) {
  const TemporaryFolder folder(fs::temp_directory_path());
  install(folder, {.name = "alpha", .outputs = {{.file = "a.txt", .role = "labels"}}});
  install(folder, {.name = "beta",
                   .inputs = {{.role = "labels"}, {.role = earlier_role, .required = false}},
                   .outputs = {{.file = "b.txt", .role = "mesh"}}});
  install(folder, {.name = "gamma",
                   .inputs = {{.role = "mesh"}},
                   .outputs = {{.file = "c.txt", .role = earlier_role}},
                   .params = {{.name = "adapt", .type = ParamType::map, .fallback = nullptr}}});
  write_atomically(folder.path() / "a.yaml",
                   "viscera: 1\nstages: {alpha: {}, beta: {}, gamma: {}}\n"
                   "adapt: {total: 2 %, rounds: 3}\n");
  Store store(folder.path() / "cache", false);
  Catalog catalog(folder.path(), store);
  const Plan plan = make_plan(load_spec({.path = folder.path() / "a.yaml"}), catalog);
  ASSERT_EQ(plan.size(), 9u);
  EXPECT_EQ(plan[2].params.at("adapt").dump(), R"({"total":"2 %"})");
  EXPECT_EQ(plan[8].params.at("adapt").dump(), R"({"last":true,"total":"2 %"})");
  using Indices = std::vector<std::size_t>;
  EXPECT_EQ(awaited_by(plan, 3), Indices{2}) << "which reads nothing of the round before";
  Entries entries(plan.size());
  for (std::size_t i = 0; i < 3; ++i) entries[i] = ended(ExitCode::gate_failed, "");
  EXPECT_FALSE(is_needless(plan, 2, entries));
  EXPECT_TRUE(is_needless(plan, 3, entries)) << "the round before wrote nothing for it";
  EXPECT_TRUE(is_needless(plan, 6, entries)) << "nor will that one";
  entries[2]->manifest.outputs.push_back({.path = "c.txt"});
  EXPECT_FALSE(is_needless(plan, 3, entries));
  EXPECT_FALSE(is_needless(plan, 6, entries)) << "nobody knows yet";
  entries[2] = std::nullopt;
  EXPECT_FALSE(is_needless(plan, 3, entries));
  EXPECT_TRUE(lacks_input(plan[3], entries)) << "after a failure";
}

// A stage that gathers what `cases` others make, and is the last of the plan.
std::string missing_of(std::size_t cases) {
  Plan plan;
  PlannedInput input;
  for (std::size_t i = 0; i < cases; ++i) {
    plan.push_back(planned("alpha", fmt::format("c{}", i)));
    input.producers.push_back(i);
  }
  plan.push_back(planned("omega", ""));
  plan.back().inputs = {input};
  return missing_producers(plan, cases, Entries(plan.size()));
}

TEST(MissingProducers, ThreeAreNamedAndFurtherOnesCounted) {
  EXPECT_EQ(missing_of(1), "c0/alpha");
  EXPECT_EQ(missing_of(3), "c0/alpha, c1/alpha, c2/alpha");
  EXPECT_EQ(missing_of(5), "c0/alpha, c1/alpha, c2/alpha and 2 more");
}

// State and message of a case whose stages have ended so.
std::pair<std::string, std::string> judged_case(const std::vector<Entry>& stages) {
  Spec spec;
  spec.cases.push_back({.name = "soft"});
  Plan plan;
  Entries entries;
  for (std::size_t i = 0; i < stages.size(); ++i) {
    plan.push_back(planned(fmt::format("stage{}", i), "soft"));
    entries.push_back(stages[i]);
  }
  const Json one =
      Json::parse(case_report(spec, plan, entries, Failures(plan.size()))).at("cases").at(0);
  return {one.at("state"), one.at("message")};
}

TEST(CaseReport, TheFirstOfEquallyBadStagesIsTheReasonAndAGoodOneIsNone) {
  using Judged = std::pair<std::string, std::string>;
  const Entry good = ended(ExitCode::ok, "");
  EXPECT_EQ(judged_case({good, good}), Judged("ok", ""));
  EXPECT_EQ(judged_case({good, ended(ExitCode::gate_failed, "slivers"),
                         ended(ExitCode::gate_failed, "too slow"), good}),
            Judged("gates failed", "stage1: slivers"));
}

TEST(RunFolders, AStageThatIsNewInACaseTakesAsLongAsItTookInOthersOnAverage) {
  const TemporaryFolder folder(fs::temp_directory_path());
  Store store(folder.path() / "cache", false);
  const Plan plan = {planned("alpha", "a"), planned("alpha", "b"), planned("alpha", "c"),
                     planned("alpha", "d")};
  RunFolders folders(plan, folder.path() / "out");
  std::vector<bool> settled(plan.size(), false);
  EXPECT_EQ(folders.seconds_left(settled), 0.0);
  for (const std::size_t stage : {0u, 1u}) {
    std::string held_by;
    ASSERT_TRUE(folders.open(stage, held_by));
    folders.lay_out(stage, ended(ExitCode::ok, "", stage == 0 ? 10.0 : 20.0), store, "");
    settled[stage] = true;
    folders.leave(stage);
  }
  EXPECT_EQ(folders.seconds_left(settled), 2 * 15.0);
}

TEST(RunFolders, EveryStageThatItsCaseMadeBeforeTakesAsLongAsThen) {
  const TemporaryFolder folder(fs::temp_directory_path());
  Store store(folder.path() / "cache", false);
  const Plan plan = {planned("alpha", "a"), planned("beta", "a"), planned("gamma", "a")};
  RunFolders folders(plan, folder.path() / "out");
  std::string held_by;
  ASSERT_TRUE(folders.open(0, held_by));
  const std::vector<double> seconds = {100.0, 10.0, 20.0};
  for (std::size_t stage = 0; stage < plan.size(); ++stage)
    folders.lay_out(stage, ended(ExitCode::ok, "", seconds[stage]), store, "");
  EXPECT_EQ(folders.seconds_left({false, false, false}), 130.0);
  EXPECT_EQ(folders.seconds_left({true, false, false}), 30.0);
  EXPECT_EQ(folders.seconds_left({true, true, false}), 20.0);
}

TEST(Origin, OfParamsThoseThatWereLeftUnsetAreNotListed) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const fs::path result = folder.path() / "result.txt";
  write_atomically(result, "a result");
  Manifest manifest{.stage = "alpha", .params = {{"given", 5.0}, {"unset", nullptr}}};
  manifest.param_units = {{"given", "mm"}, {"unset", "mm"}};
  manifest.outputs = {{"result.txt", sha256("a result"), 8}};
  write_atomically(folder.path() / "manifest.json", to_json(manifest).dump());
  testing::internal::CaptureStdout();
  print_origin(result);
  const std::string text = testing::internal::GetCapturedStdout();
  EXPECT_NE(text.find("given = 5.0 mm\n"), std::string::npos) << text;
  EXPECT_EQ(text.find("unset"), std::string::npos) << text;
}

}  // namespace
}  // namespace viscera::engine
