#include "sim/backend/cpu/sweep.hpp"

namespace viscera::sim {

void fill_sweeps_avx512(SweepTables& tables) {
  fill_sweeps<avx512>(tables);
}

}  // namespace viscera::sim
