// Why a stage is computed again: the difference between two key transcripts in words.
#pragma once

#include <string>
#include <vector>

namespace viscera::engine {

struct KeyComponent {
  std::string type, name, value;
};

// The lines that KeyTranscript::add wrote; what cannot be read as one is left out.
std::vector<KeyComponent> read_transcript(const std::string& text);

// For example "cell_size 4 mm -> 5 mm (cause)" or "surface changed (cascade)". Roles in
// `produced_roles` are fed by stages: their changes follow from an earlier cause.
std::string explain(const std::string& before, const std::string& after,
                    const std::vector<std::string>& produced_roles);

}  // namespace viscera::engine
