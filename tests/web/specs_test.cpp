// The specs in configs/ hold: every stage, param, role and case of theirs is one that there is.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "pipeline/contract/atomic_file.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

TEST(Specs, OfTheProjectAllPlan) {
  const TemporaryFolder folder(fs::temp_directory_path());
  int specs = 0;
  for (const auto& entry : fs::directory_iterator("configs")) {
    if (entry.path().extension() != ".yaml") continue;
    const std::string command =
        fmt::format("'{}' run '{}' --dry-run --out '{}' --set input=sample_data/phantom.nrrd >'{}'",
                    VISCERA_ENGINE, entry.path().string(), folder.path().string(),
                    (folder.path() / "plan").string());
    EXPECT_EQ(std::system(command.c_str()), 0) << entry.path();
    EXPECT_NE(read_file(folder.path() / "plan").find("simulate: would run"), std::string::npos);
    ++specs;
  }
  EXPECT_GE(specs, 7);
}

// Python's jsonschema is there with snakemake.
TEST(Specs, OfTheProjectFollowTheirSchemaAndWhatIsWrongDoesNot) {
  if (std::system("python3 -c 'import jsonschema, yaml' 2>/dev/null") != 0) {
    GTEST_SKIP() << "python3-jsonschema and python3-yaml are not installed";
  }
  const TemporaryFolder folder(fs::temp_directory_path());
  write_atomically(folder.path() / "check.py", R"(
import glob, json, subprocess, sys, yaml, jsonschema
schema = json.loads(subprocess.run([sys.argv[1], "schema"], check=True, stdout=subprocess.PIPE).stdout)
jsonschema.Draft7Validator.check_schema(schema)
validator = jsonschema.Draft7Validator(schema)
specs = glob.glob("configs/*.yaml")
assert len(specs) >= 8
for path in specs:
    validator.validate(yaml.safe_load(open(path)))
head = """viscera: 1
stages:
  labels: {in: {volume: a.nrrd}}
"""
assert validator.is_valid(yaml.safe_load(head))
for wrong in ["  tetmesh: {cell_siz: 4mm}", "  tetmesh: {cell_size: 4}", "  simulate: {solver: magic}",
              "  simulate: {iterations: 0}", "  simulate: {iterations: many}", "  nostage: {}",
              "  surface: {in: {label: a}}", "cases: {a: {simulate.iterations: 0}}",
              "cases: {a: {simulat.iterations: 1}}", "sweep: {simulate.solver: [xpbd, magic]}",
              "case: {}", "viscera: 2"]:
    assert not validator.is_valid(yaml.safe_load(head + wrong)), wrong
)");
  const std::string command =
      fmt::format("python3 '{}' '{}'", (folder.path() / "check.py").string(), VISCERA_ENGINE);
  EXPECT_EQ(std::system(command.c_str()), 0);
}

}  // namespace
}  // namespace viscera
