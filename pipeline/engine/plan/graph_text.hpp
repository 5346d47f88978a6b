// A plan as text: for Mermaid, for Graphviz, and as JSON for whoever starts its stages himself.
//
//   {"jobs": [{"case": "soft", "stage": "tetmesh", "gathers": false, "gpu": false,
//              "settings": "1f…", "manifest": "out/cohort/soft/tetmesh/manifest.json",
//              "needs": ["out/cohort/soft/surface/manifest.json"], "state": "done"}],
//    "refused": [{"case": "odd", "message": "…"}]}
//
// settings: digest of all that can change the stage's result and is not made by another stage.
#pragma once

#include "pipeline/engine/plan/survey.hpp"

namespace viscera::engine {

// `format`: mermaid, dot or json.
std::string graph_text(const std::string& format, const Spec& spec, const Plan& plan,
                       const Survey& found, const std::filesystem::path& out);

}  // namespace viscera::engine
