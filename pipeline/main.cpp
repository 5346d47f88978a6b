// viscera: runs a spec's stages, each a program of its own, and keeps their results.
#include <CLI/CLI.hpp>
#include <cstdlib>
#include <new>

#include "pipeline/contract/error.hpp"
#include "pipeline/contract/log.hpp"
#include "pipeline/engine/runner.hpp"
#include "pipeline/engine/upkeep.hpp"

namespace {

namespace fs = std::filesystem;
using namespace viscera;

void add_folders(CLI::App& command, fs::path& out, fs::path& cache) {
  command.add_option("--out", out, "the run SPEC.yaml writes OUT/SPEC")->default_val("out");
  command.add_option("--cache", cache, "folder of the cache [OUT/.cache]")
      ->envname("VISCERA_CACHE");
}

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
  add_folders(*run, options.out, options.cache);
  run->add_flag("--quiet", options.quiet, "warnings and errors only");
}

CLI::App* declare_gc(CLI::App& app, GcOptions& options, fs::path& out) {
  auto* gc = app.add_subcommand("gc", "removes results that were not used for long");
  gc->add_option("--max-size", options.max_size, "what may stay: 20GB, 500MB")
      ->transform(CLI::AsSizeValue(true));
  gc->add_option("--max-age", options.max_age_s, "since a result was last used: 30d, 12h")
      ->transform(CLI::AsNumberWithUnit(
          std::map<std::string, double>{{"s", 1}, {"min", 60}, {"h", 3600}, {"d", 86400}}));
  gc->add_flag("--dry-run", options.dry_run, "say what would be removed; remove nothing");
  add_folders(*gc, out, options.cache);
  return gc;
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
  GcOptions gc_options;
  const auto* gc = declare_gc(app, gc_options, options.out);
  auto* verify = app.add_subcommand("verify", "reads all results; removes what is damaged");
  add_folders(*verify, options.out, options.cache);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : static_cast<int>(ExitCode::usage);
  }
  try {
    log::catch_interrupts();
    if (options.cache.empty()) options.cache = options.out / ".cache";
    if (*gc) {
      if (gc_options.cache.empty()) gc_options.cache = options.cache;
      collect_garbage(gc_options);
      return 0;
    }
    if (*verify) return static_cast<int>(verify_store(options.cache));
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
