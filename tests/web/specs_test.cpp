// The specs in configs/ hold: every stage, param, role and case of theirs is one that there is.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "pipeline/base/atomic_file.hpp"
#include "tests/common/needs.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

// How many specs of a folder plan with this option; each that does not is a failure.
int specs_that_plan(const fs::path& specs, const std::string& option, const fs::path& folder) {
  int count = 0;
  for (const auto& entry : fs::directory_iterator(specs)) {
    const std::string text =
        entry.path().extension() == ".yaml" ? read_file(entry.path()) : std::string();
    if (text.find("\n  " + option.substr(0, option.find('=')) + ":") == std::string::npos) continue;
    const std::string command =
        fmt::format("'{}' run '{}' --dry-run --out '{}' --set '{}' >'{}'", VISCERA_ENGINE,
                    entry.path().string(), folder.string(), option, (folder / "plan").string());
    EXPECT_EQ(std::system(command.c_str()), 0) << entry.path();
    EXPECT_NE(read_file(folder / "plan").find(": would run"), std::string::npos) << entry.path();
    ++count;
  }
  return count;
}

TEST(Specs, OfTheProjectAllPlan) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const std::string input = "input=sample_data/phantom.nrrd";
  EXPECT_GE(specs_that_plan("configs", input, folder.path()), 7);
  EXPECT_EQ(specs_that_plan("configs/gpu", input, folder.path()), 1);
}

TEST(Specs, OfTheGpuBundlePlanOnTheMeshesThatItMakes) {
  const TemporaryFolder folder(fs::temp_directory_path());
  const std::string made = read_file("configs/gpu/meshes.yaml");
  for (const char* mesh : {"16mm", "10mm", "8mm", "5.5mm", "3.5mm"}) {
    EXPECT_NE(made.find(fmt::format("\n  {}:", mesh)), std::string::npos) << mesh;
    write_atomically(folder.path() / (std::string(mesh) + ".vtu"), "<VTKFile/>\n");
  }
  EXPECT_EQ(specs_that_plan("configs/gpu", "meshes=" + folder.path().string(), folder.path()), 3);
}

TEST(Specs, OfTheProjectFollowTheirSchemaAndWhatIsWrongDoesNot) {
  VISCERA_NEEDS(works("python3 -c 'import jsonschema, yaml'"),
                "python3-jsonschema or python3-yaml is not installed");
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
