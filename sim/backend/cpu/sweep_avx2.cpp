#include "sim/backend/cpu/sweep.hpp"

namespace viscera::sim {

void fill_sweeps_avx2(SweepTables& tables) {
  fill_sweeps<avx2>(tables);
}

}  // namespace viscera::sim
