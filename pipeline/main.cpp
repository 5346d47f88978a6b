// viscera: runs a spec's stages, each a program of its own, and keeps their results.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <new>

#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/base/log.hpp"
#include "pipeline/engine/programs/catalog.hpp"
#include "pipeline/engine/run/estimate.hpp"
#include "pipeline/engine/run/inspect.hpp"
#include "pipeline/engine/store/upkeep.hpp"
#include "pipeline/record/diff.hpp"
#include "pipeline/record/diff_folder.hpp"
#include "pipeline/record/record.hpp"
#include "pipeline/schema/spec_schema.hpp"

namespace {

namespace fs = std::filesystem;
using namespace viscera;
using namespace viscera::engine;

void add_folders(CLI::App& command, fs::path& out, fs::path& cache) {
  command.add_option("--out", out, "the run SPEC.yaml writes OUT/SPEC")
      ->default_val("out")
      ->check([](const std::string& path) { return path.empty() ? "an empty path" : ""; });
  command.add_option("--cache", cache, "folder of the cache [OUT/.cache]")
      ->envname("VISCERA_CACHE");
}

void add_spec(CLI::App& command, SpecRequest& spec, Places& places, const char* what) {
  command.add_option("spec", spec.path, what)->required();
  command.add_option("--set", spec.sets, "VARIABLE=VALUE or STAGE.PARAM=VALUE, repeatable")
      ->allow_extra_args(false);
  command
      .add_option("--case", spec.only_cases,
                  "only this case, repeatable; what gathers all cases is left out then")
      ->allow_extra_args(false);
  add_folders(command, places.out, places.cache);
}

CLI::AsNumberWithUnit as_seconds() {
  return CLI::AsNumberWithUnit(
      std::map<std::string, double>{{"s", 1}, {"min", 60}, {"h", 3600}, {"d", 86400}});
}

// The library's own message of a range names the largest of all numbers.
CLI::Validator is_time(bool zero_too) {
  return CLI::Validator(
      [zero_too](const std::string& seconds) {
        const double value = std::stod(seconds);
        return value > 0.0 || (zero_too && value == 0.0)
                   ? std::string()
                   : std::string(zero_too ? "a time of 0 or more" : "a time above 0") +
                         " is needed, such as 90s, 30min, 12h or 2d";
      },
      "");
}

CLI::App* declare_run(CLI::App& app, RunOptions& options) {
  auto* run = app.add_subcommand("run", "runs a spec; what is in the cache is not computed again");
  add_spec(*run, options.spec, options.places, "the spec, a YAML file");
  auto* until = run->add_option("--until", options.until, "only this stage and those it needs");
  auto* from = run->add_option("--from", options.from,
                               "run this stage and those that need it even when cached");
  run->add_option("--only", options.only, "this stage alone, on what lies in the run's folder")
      ->excludes(until)
      ->excludes(from);
  run->add_flag("--keep-going", options.spec.keep_going,
                "go on with all that does not need what failed");
  run->add_option("--jobs", options.jobs, "stages at once")->check(CLI::Range(1, 1024));
  run->add_option("--threads", options.threads,
                  "of each stage, at most the machine's [its share of all]")
      ->check(CLI::Range(0, 1024));
  run->add_option("--gpus", options.gpus, "stages at once that may use a GPU [one for each GPU]")
      ->check(CLI::Range(1, 1024));
  run->add_option("--timeout", options.timeout_s, "for each stage: 90s, 30min, 2h")
      ->transform(as_seconds())
      ->check(is_time(false));
  run->add_flag("--dry-run", options.dry_run, "say what would run and why; write nothing");
  run->add_flag("--quiet", options.quiet, "warnings and errors only");
  run->add_option_function<std::string>(
         "--progress", [&options](const std::string& way) { options.json_events = way == "jsonl"; },
         "auto, or jsonl: what happens as JSON lines on stderr")
      ->check(CLI::IsMember({"auto", "jsonl"}));
  return run;
}

struct Inspecting {
  CLI::App *why, *status, *graph, *estimate;
  InspectOptions options;
};

void declare_inspection(CLI::App& app, Inspecting& inspecting) {
  InspectOptions& options = inspecting.options;
  const auto declare = [&](const char* name, const char* doc, const char* what) {
    auto* command = app.add_subcommand(name, doc);
    add_spec(*command, options.spec, options.places, what);
    return command;
  };
  const auto format = [&options](CLI::App* command, const char* flag, const char* doc) {
    command->add_flag_callback(
        std::string("--") + flag, [&options, flag] { options.format = flag; }, doc);
  };
  inspecting.why = declare("why", "says why stages would run, or where a file comes from",
                           "a spec, or a file that a run has made");
  inspecting.why->add_option("stage", options.stage, "of the spec; all when left out");
  inspecting.status = declare("status", "what is done, to do or failed", "the spec");
  format(inspecting.status, "json", "every case with its stages, gates and metrics");
  inspecting.graph = declare("graph", "the stages and what feeds them", "the spec");
  format(inspecting.graph, "mermaid", "as a Mermaid flowchart (default)");
  format(inspecting.graph, "dot", "for Graphviz");
  format(inspecting.graph, "json", "for programs: every job with its manifest and needs");
  inspecting.estimate =
      declare("estimate", "what a run would take, and how far off it would be, in a few seconds",
              "the spec");
  format(inspecting.estimate, "json", "every stage with its time and memory");
}

void print_schema(const Places& places) {
  Store store(places.cache, true);
  Catalog catalog(places.programs, store);
  std::vector<StageInfo> stages;
  for (const auto& name : catalog.names()) stages.push_back(catalog.find(name, "schema").info);
  std::cout << spec_schema(stages).dump(1) << std::endl;
}

// A cohort is looked at as a whole, whatever single cases lack.
ExitCode inspect(Inspecting& inspecting) {
  InspectOptions& options = inspecting.options;
  const std::string kind = options.spec.path.extension();
  if (*inspecting.why && kind != ".yaml" && kind != ".yml") {
    print_origin(options.spec.path);
    return ExitCode::ok;
  }
  options.spec.keep_going = true;
  if (*inspecting.estimate) return print_estimate(options);
  if (*inspecting.why) print_why(options);
  if (*inspecting.status) print_status(options);
  if (*inspecting.graph) print_graph(options);
  return ExitCode::ok;
}

CLI::App* declare_gc(CLI::App& app, GcOptions& options, Places& places) {
  auto* gc = app.add_subcommand("gc", "removes results that were not used for long");
  gc->add_option("--max-size", options.max_size, "what may stay: 20GB, 500MB")
      ->transform(CLI::AsSizeValue(true));
  gc->add_option("--max-age", options.max_age_s, "since a result was last used: 30d, 12h")
      ->transform(as_seconds())
      ->check(is_time(true));
  gc->add_flag("--dry-run", options.dry_run, "say what would be removed; remove nothing");
  add_folders(*gc, places.out, places.cache);
  return gc;
}

CLI::App* declare_record(CLI::App& app, RecordRequest& request) {
  auto* record = app.add_subcommand(
      "record", "writes what a reviewer and an archive need of a finished run into one folder");
  record->add_option("run", request.run, "its folder: OUT/NAME, of a case OUT/NAME/CASE")
      ->required();
  record->add_option("--out", request.out, "the folder that is written [RUN/record]");
  record->add_option("--license", request.license, "of the data, for archives: CC-BY-4.0");
  return record;
}

struct Diffing {
  DiffRequest request;
  bool json = false;
};

CLI::App* declare_diff(CLI::App& app, Diffing& diffing) {
  auto* diff = app.add_subcommand(
      "diff", "says what differs between two finished runs: inputs, parameters, mesh, results");
  diff->add_option("a", diffing.request.a, "the folder of a run")->required();
  diff->add_option("b", diffing.request.b, "the folder of another")->required();
  auto* json = diff->add_flag("--json", diffing.json, "for programs");
  diff->add_option("--out", diffing.request.out,
                   "a folder that is written, with pictures, in place of printing")
      ->excludes(json);
  return diff;
}

void print_diff(const Diffing& diffing) {
  const Json diff = diff_of(read_run(diffing.request.a), read_run(diffing.request.b));
  std::cout << (diffing.json ? document_of(diff) : diff_text(diff)) << std::flush;
}

// The library's own message for an unknown command is that none was given.
void check_command(const CLI::App& app, int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') return;
  std::vector<std::string> names;
  for (const auto* command : app.get_subcommands(nullptr)) names.push_back(command->get_name());
  if (std::ranges::count(names, argv[1])) return;
  throw Error(ExitCode::usage, {.where = "command line",
                                .field = argv[1],
                                .found = "unknown command",
                                .remedy = suggest(argv[1], names)});
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
  app.set_version_flag("--version", "viscera " VISCERA_VERSION);
  declare_run(app, options);
  Inspecting inspecting;
  declare_inspection(app, inspecting);
  Places places;
  GcOptions gc_options;
  const auto* gc = declare_gc(app, gc_options, places);
  auto* verify = app.add_subcommand("verify", "reads all results; removes what is damaged");
  add_folders(*verify, places.out, places.cache);
  auto* schema = app.add_subcommand("schema", "prints a JSON schema: of specs, for editors");
  std::string schema_of = "spec";
  schema->add_option("of", schema_of, "spec, or record: of record.json [spec]")
      ->check(CLI::IsMember({"spec", "record"}));
  RecordRequest record_request;
  const auto* record = declare_record(app, record_request);
  Diffing diffing;
  const auto* diff = declare_diff(app, diffing);
  try {
    check_command(app, argc, argv);
    app.parse(argc, argv);
  } catch (const Error& e) {
    return fail(e.code(), e.what());
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : static_cast<int>(ExitCode::usage);
  }
  try {
    log::catch_interrupts();
    for (Places* each : {&options.places, &inspecting.options.places, &places}) {
      if (each->cache.empty()) each->cache = each->out / ".cache";
      each->programs = fs::read_symlink("/proc/self/exe").parent_path();
    }
    if (*gc) {
      gc_options.cache = places.cache;
      collect_garbage(gc_options);
      return 0;
    }
    if (*schema) {
      if (schema_of == "record") {
        std::cout << record_schema() << std::flush;
      } else {
        print_schema(places);
      }
      return 0;
    }
    if (*record) {
      record_request.programs = places.programs;
      record_request.cache = places.cache;
      write_record(record_request);
      return 0;
    }
    if (*diff) {
      diffing.request.programs = places.programs;
      diffing.request.cache = places.cache;
      diffing.request.out.empty() ? print_diff(diffing) : write_diff(diffing.request);
      return 0;
    }
    if (*verify) return static_cast<int>(verify_store(places.cache));
    if (*inspecting.why || *inspecting.status || *inspecting.graph || *inspecting.estimate)
      return static_cast<int>(inspect(inspecting));
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
