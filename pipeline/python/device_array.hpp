// Numbers that lie in a device's memory, for libraries that work there: handed on in place by
// DLPack (PyTorch, CuPy, JAX) and by the CUDA array interface (Warp, Numba).
#pragma once

#include <pybind11/pybind11.h>

#include <cstddef>

namespace viscera::python {

namespace py = pybind11;

struct DeviceArray {
  const void* data = nullptr;  // [rows][3], in a CUDA device's memory
  std::size_t rows = 0;
  int bytes = 0;     // of a number: 4 or 8, floating
  int device = 0;    // CUDA's number of it
  py::object owner;  // of the memory
};

void define_device_array(py::module_& module);

}  // namespace viscera::python
