#include "sim/backend/cpu_sweep.hpp"

namespace viscera::sim {

void fill_sweeps_avx2(SweepTable<float>& table32, SweepTable<double>& table64) {
  fill_sweeps<avx2>(table32);
  fill_sweeps<avx2>(table64);
}

}  // namespace viscera::sim
