// The cache key of a stage: everything that can change its outputs, and nothing else (no paths,
// threads or log flags). One line per component; explain.hpp compares two such transcripts.
//
//   stage tetmesh = [1] 2                    its version
//   param cell_size = [4] 5 mm               declared params with in_key, defaults included
//   input surface = [64] 1f…                 outputs of the stage that feeds the role, or
//   input volume = [70] 1f… .nrrd            a file of the spec: its reader goes by the extension
//   manifest surface = [64] 9c…              only for inputs declared with `manifest`
//   program viscera-tetmesh = [64] 77…       the executable
//   library CGAL = [5] 5.5.1                 what it links
//   probe /proc/… = [64] 03…                 files that stand for the machine, when present
//   probe env:NAME = [1] 0                   environment variables that the stage heeds, when set
#pragma once

#include <map>
#include <string>
#include <vector>

#include "pipeline/base/digest.hpp"
#include "pipeline/engine/plan/graph.hpp"
#include "pipeline/engine/store/store.hpp"

namespace viscera::engine {

struct StageKey {
  KeyTranscript transcript;
  // By role, what the stage must find in the files that it is given: the inputs of its manifest.
  std::multimap<std::string, std::string> inputs;
};

// `entries[i]` is the finished entry of plan stage i; empty for one that was skipped.
StageKey key_of(const PlannedStage& stage, const std::vector<std::optional<Entry>>& entries,
                DigestCache& digests);

// The part of the key that is known before any other stage has run: all but the inputs that stages
// make, and without what stands for the machine, which may be another when the stage runs.
KeyTranscript own_settings(const PlannedStage& stage, DigestCache& digests);

}  // namespace viscera::engine
