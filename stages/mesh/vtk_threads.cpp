#include "stages/mesh/vtk_threads.hpp"

#include <vtkSMPTools.h>  // VTK 9.1's is not C++20

void viscera::compute_vtk_in_one_thread() {
  vtkSMPTools::SetBackend("Sequential");
}
