// The answer in words, from the figures of one scene of a study, and nothing that they do not show.
#pragma once

#include "pipeline/base/param.hpp"

namespace viscera {

// `scene` as in study.hpp. One sentence on the solver's error on the mesh with most settings, one
// on the total or, without a truth of the body, that there is none. Doubtful errors reach no goal.
Json sentences_of(const Json& scene, const std::vector<double>& wanted_mm);

}  // namespace viscera
