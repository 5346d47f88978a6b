#include "sim/backend/cpu_sweep.hpp"

namespace viscera::sim {

void fill_sweeps_baseline(SweepTable<float>& table32, SweepTable<double>& table64) {
  fill_sweeps<baseline>(table32);
  fill_sweeps<baseline>(table64);
}

}  // namespace viscera::sim
