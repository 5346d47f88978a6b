// The JSON schema (draft 7) of a spec, made from what the stages declare: editors complete and
// check names, ranges and choices with it. The engine does not use it: its own checks say more, and
// know the variables.
#pragma once

#include <vector>

#include "pipeline/contract/manifest.hpp"

namespace viscera {

Json spec_schema(const std::vector<StageInfo>& stages);

}  // namespace viscera
