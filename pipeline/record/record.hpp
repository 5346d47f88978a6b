// `viscera record`: one folder by which a reviewer judges a finished run and an archive keeps it:
//
//   record.md                what a person reads
//   record.json              the same for programs; its schema: record.schema.json
//   ro-crate-metadata.json   what archives read (crate.hpp)
//   STAGE/…                  the outputs and manifests of the stages; of paths the last name alone
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace viscera::engine {

struct RecordRequest {
  std::filesystem::path run;
  std::filesystem::path out;       // empty: the folder `record` in that of the run
  std::filesystem::path programs;  // folder of the viscera-STAGE executables
  std::filesystem::path cache;     // which may remember what they declare
  std::string license;             // of the data; empty: nobody has said
};

// Appears as a whole: a record that was there stays until the new one is complete. Throws what
// read_run and check_outputs throw, and Error(usage) when `out` holds something else than a record.
// Prints where the record is.
void write_record(const RecordRequest& request);

std::string_view record_schema();  // of record.json, JSON Schema draft 7

}  // namespace viscera::engine
