#include "sim/backend/cpu/sweep.hpp"

namespace viscera::sim {

void fill_sweeps_baseline(SweepTables& tables) {
  fill_sweeps<baseline>(tables);
}

}  // namespace viscera::sim
