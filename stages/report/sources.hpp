// What a report tells: the files it was given and, beside each, what its stage wrote about it
// (manifest.json, labels.json, quality.json, metrics.csv, scene.json). All of these companions are
// optional; one that is there but damaged, or that describes another file, is refused.
#pragma once

#include <filesystem>
#include <map>

#include "pipeline/base/param.hpp"

namespace viscera {

// `inputs`: file by role. The result holds
//   inputs  [{role, path, sha256, bytes, has_manifest}]   in the order of the roles' data flow
//   stages  [manifest]                                     of the inputs that have one
//   links   [{stage, role, path, sha256, given}]           a stage's inputs that are also inputs
//                                                          here; given: the same bytes?
//   labels, quality, scene                                 the JSON files, null where absent
//   series  {name: [numbers]}, series_last {name: text}    the columns of metrics.csv
// Throws Error(bad_input) naming the file that is malformed or does not belong to its manifest.
Json read_sources(const std::map<std::string, std::filesystem::path>& inputs);

// Counts of passed and failed gates and the caveats of all stages, and `state`: "diverged",
// "failed", "passed", or "ungated" when no stage judged anything.
Json verdict_of(const Json& sources);

// The machine-readable extract: verdict, gates, scalar metrics, digests, cost; no geometry.
Json summary_of(const Json& report);

}  // namespace viscera
