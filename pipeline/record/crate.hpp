// The metadata by which archives read a record: RO-Crate 1.1 (https://w3id.org/ro/crate/1.1), a
// JSON-LD file that names every file of the folder, the programs, and what each made of which
// inputs.
#pragma once

#include "pipeline/record/finished_run.hpp"

namespace viscera::engine {

// `name` relative to the record's folder.
struct RecordFile {
  std::string name, title;
  std::string sha256;
  std::uintmax_t bytes = 0;
};

// Of files other than the metadata itself; outputs of stages are called STAGE/FILE. `license`: of
// the data, "" where nobody has said.
Json crate_metadata(const FinishedRun& run, const std::vector<RecordFile>& files,
                    const std::string& license);

}  // namespace viscera::engine
