#pragma once

namespace viscera {

// From here on VTK computes in the thread that calls it: for a copy of a process (trial_read.hpp),
// which has none of the threads that VTK keeps.
void compute_vtk_in_one_thread();

}  // namespace viscera
