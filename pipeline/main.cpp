// viscera: runs a spec's stages, each a program of its own, and keeps their results.
#include <CLI/CLI.hpp>
#include <cstdlib>
#include <new>

#include "pipeline/contract/error.hpp"
#include "pipeline/contract/log.hpp"
#include "pipeline/engine/runner.hpp"

namespace {

namespace fs = std::filesystem;
using namespace viscera;

void declare_run(CLI::App& app, RunOptions& options) {
  auto* run = app.add_subcommand("run", "runs a spec; what is in the cache is not computed again");
  run->add_option("spec", options.spec, "the spec, a YAML file")->required();
  run->add_option("--set", options.sets, "VARIABLE=VALUE or STAGE.PARAM=VALUE, repeatable")
      ->allow_extra_args(false);
  run->add_option("--until", options.until, "only this stage and those that it needs");
  run->add_option("--from", options.from, "run this stage and those that need it even when cached");
  run->add_option("--case", options.only_cases,
                  "only this case, repeatable; what gathers all cases does not run then")
      ->allow_extra_args(false);
  run->add_flag("--dry-run", options.dry_run, "say what would run and why; write nothing");
  run->add_option("--out", options.out, "the run SPEC.yaml writes OUT/SPEC")->default_val("out");
  run->add_option("--cache", options.cache, "folder of the cache [OUT/.cache]")
      ->envname("VISCERA_CACHE");
  run->add_flag("--quiet", options.quiet, "warnings and errors only");
}

int fail(ExitCode code, const std::string& message) {
  if (!message.empty()) log::error("{}", message);
  return static_cast<int>(code);
}

}  // namespace

int main(int argc, char** argv) {
  RunOptions options;
  CLI::App app("From a segmented CT to a soft-tissue simulation.", "viscera");
  app.require_subcommand(1);
  declare_run(app, options);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : static_cast<int>(ExitCode::usage);
  }
  try {
    log::catch_interrupts();
    if (options.cache.empty()) options.cache = options.out / ".cache";
    options.programs = fs::read_symlink("/proc/self/exe").parent_path();
    return static_cast<int>(run_spec(options));
  } catch (const Error& e) {
    return fail(e.code(), e.what());
  } catch (const std::bad_alloc&) {
    return fail(ExitCode::try_again, "out of memory");
  } catch (const fs::filesystem_error& e) {
    return fail(ExitCode::usage, std::string(e.what()) +
                                     "\n  remedy:  check the folder's permissions and free space");
  } catch (const std::exception& e) {
    return fail(ExitCode::internal, std::string("internal error: ") + e.what());
  }
}
