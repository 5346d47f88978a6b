#include "pipeline/record/diff_folder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iostream>
#include <optional>

#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/engine/programs/process.hpp"
#include "pipeline/record/diff.hpp"
#include "pipeline/record/page.hpp"
#include "pipeline/record/parameters.hpp"
#include "pipeline/record/replaced_folder.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

// The stage that shows runs side by side, and its folder in that of the diff.
constexpr const char* shows_both = "compare";

// What a run has for others to read under a role.
std::optional<fs::path> output_of_role(const FinishedRun& run, const Declarations& declarations,
                                       const std::string& role) {
  for (const auto& [stage, declared] : declarations) {
    const auto output = std::ranges::find(declared.outputs, role, &OutputFile::role);
    if (output != declared.outputs.end()) return run.stage(stage)->folder / output->file;
  }
  return {};
}

void run_stage(const std::vector<std::string>& arguments) {
  std::string last;
  const ProcessEnd end = run_process(arguments, [&last](std::string_view line) {
    std::cerr << line << "\n";
    last = line;
  });
  if (end.signal == 0 && end.exit_code == 0) return;
  throw Error(end.signal == 0 ? static_cast<ExitCode>(end.exit_code) : ExitCode::internal,
              {.where = arguments[0],
               .found = end.signal == 0 ? "it failed: " + last
                                        : fmt::format("it was ended by signal {}", end.signal),
               .remedy = "without --out the differences are printed, without pictures"});
}

// Both runs side by side, into `folder`; "" or why they cannot be shown.
std::string show_both(const FinishedRun& a, const FinishedRun& b, const DiffRequest& request,
                      const fs::path& folder) {
  Store store(request.cache, true);
  Catalog catalog(request.programs, store);
  const auto names = catalog.names();
  if (!std::ranges::count(names, shows_both))
    return "the program viscera-compare is not built: make programs";
  const StageProgramFile program = catalog.find(shows_both, "diff");
  const std::string role = program.info.inputs.front().role;
  std::vector<std::string> arguments = {program.executable, "--out", folder, "--quiet"};
  for (const FinishedRun* run : {&a, &b}) {
    const auto file = output_of_role(*run, declarations_of(*run, catalog), role);
    if (!file) return fmt::format("{} has no {}", run->folder.string(), role);
    arguments.insert(arguments.end(), {"--in", role + "=" + file->string()});
  }
  for (const char* const setting : {"title=Runs A and B", "cases=[A, B]", "methods=[A, B]"})
    arguments.insert(arguments.end(), {"--set", setting});
  run_stage(arguments);
  return "";
}

std::vector<std::string> pictures_in(const fs::path& folder) {
  std::vector<std::string> pictures;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() == ".png")
      pictures.push_back(folder.filename() / entry.path().filename());
  }
  std::ranges::sort(pictures);
  return pictures;
}

}  // namespace

void write_diff(const DiffRequest& request) {
  const FinishedRun a = read_run(request.a), b = read_run(request.b);
  check_outputs(a), check_outputs(b);
  const ReplacedFolder folder(request.out, "diff.json", "diff");
  const Json diff = diff_of(a, b);
  const std::string why_not = show_both(a, b, request, folder.path() / shows_both);
  std::vector<std::string> pictures;
  if (why_not.empty()) pictures = pictures_in(folder.path() / shows_both);
  write_atomically(folder.path() / "diff.md", diff_page(diff, pictures, why_not));
  write_atomically(folder.path() / "diff.json", document_of(diff));
  std::cout << (folder.put_in_place() / "diff.md").string() << "\n";
}

}  // namespace viscera::engine
