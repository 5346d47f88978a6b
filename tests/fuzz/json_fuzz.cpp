// JSON of strangers under libFuzzer: whatever a manifest or a declaration holds, its reader returns
// or throws Error, and what it returns is written and read again as the same.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/contract/manifest.hpp"

namespace {

using namespace viscera;

void read_manifest(const JsonValue& value) {
  const Json first = to_json(manifest_from_json(value));
  const Json second = to_json(manifest_from_json({first, "written"}));
  if (first.dump() != second.dump()) std::abort();
}

void read_declaration(const JsonValue& value) {
  const Json first = to_json(stage_info_from_json(value));
  const Json second = to_json(stage_info_from_json({first, "written"}));
  if (first.dump() != second.dump()) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(bytes), size);
  (void)outputs_named_by(text);
  const JsonText json(text, "fuzz.json");
  for (const auto& read : {read_manifest, read_declaration}) {
    try {
      read(json.root());
    } catch (const Error&) {  // refused, as it should be
    }
  }
  return 0;
}
