// What a stage promises (`describe`) and what it says it did (`manifest.json`).
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "pipeline/base/exit_code.hpp"
#include "pipeline/base/param.hpp"
#include "pipeline/contract/gate.hpp"

namespace viscera {

inline constexpr int manifest_schema = 1;

struct InputRole {
  std::string role;  // "volume", "labels", "surface", "mesh", "scene", "trajectory"
  bool required = true;
  bool many = false;  // may be given more than once
  std::string doc;
  // True when the stage also reads the manifest.json beside the file: then what that manifest says
  // (params, metrics, gates; not its times) is part of the key, not the files alone.
  bool manifest = false;
};

struct OutputFile {
  std::string file;  // name under --out
  std::string role;  // the role this file plays for later stages; empty for companions
  std::string doc;
};

// A stage's declaration. The engine connects stages by roles: an input role is fed by the stage
// that declares an output with that role, or by a file named in the spec.
struct StageInfo {
  std::string name;     // "tetmesh"; the executable is viscera-tetmesh
  std::string version;  // raised when results change for equal inputs and params
  std::string doc;
  std::vector<InputRole> inputs;
  std::vector<OutputFile> outputs;
  std::vector<Param> params;
  std::vector<GateInfo> gates;                   // that a run may judge; no others
  std::map<std::string, std::string> libraries;  // name to version: part of the fingerprint
  // What else is part of the fingerprint when present: the content of a file, or with "env:NAME"
  // the value of an environment variable.
  std::vector<std::string> probes;
};

Json to_json(const StageInfo& info);
// Without the gates, of which only people who ask for `describe` read. Throws Error(bad_input).
StageInfo stage_info_from_json(const JsonValue& json);

struct Metric {
  std::string name;
  Json value;            // number, text, list or object
  std::string unit;      // "1" for numbers without dimension
  bool machine = false;  // differs between equal runs (times, rates): no part of any key
};

struct FileDigest {
  std::string path;    // inputs: as given; outputs: relative to --out
  std::string sha256;  // of inputs: as input_digest.hpp defines it
  std::uintmax_t bytes = 0;
};

// The engine adds `key` to the JSON of what it keeps.
struct Manifest {
  std::string stage, version;
  ExitCode exit = ExitCode::ok;
  std::string message;  // why, when exit is not ok
  Json params;          // resolved
  std::map<std::string, std::string> param_units;
  std::multimap<std::string, FileDigest> inputs;  // by role
  std::vector<FileDigest> outputs;
  std::string frame = "LPS mm";  // of every coordinate in the outputs
  std::vector<Metric> metrics;
  std::vector<Gate> gates;
  std::vector<std::string> caveats;  // sentences that a reader of any result must know first
  std::map<std::string, std::string> libraries;
  std::string device = "cpu";
  std::string uncacheable;  // why later runs must not be given this result; empty: they may
  double wall_s = 0.0, cpu_s = 0.0, max_rss_mb = 0.0;
  std::string started;  // UTC, ISO 8601
};

// The last name of an input's path, also of a folder with a slash at its end. What is made from a
// manifest may show this, and nothing else of the path: it is all that a key holds of it.
std::string file_name(const std::string& path);

Json to_json(const Manifest& manifest);
Manifest manifest_from_json(const JsonValue& json);  // throws Error(bad_input)

// The plain file names that the outputs of a `manifest.json` with this text name; none of a text
// that is no manifest, or of names that lead out of its folder.
std::vector<std::string> outputs_named_by(std::string_view manifest_text);

// Whether `name` is one, of a file in the folder at hand.
bool is_file_name(const std::string& name);

}  // namespace viscera
