#include "pipeline/python/device_array.hpp"

#include <dlpack/dlpack.h>
#include <fmt/format.h>

#include <array>
#include <cstdint>
#include <memory>

namespace viscera::python {
namespace {

constexpr const char* not_taken = "dltensor";  // DLPack's name of a capsule that nobody has taken

// What DLPack asks for, with all that it points to.
struct Handed {
  DLManagedTensor tensor{};
  std::array<std::int64_t, 2> shape{};
  py::object owner;
};

// Whoever takes it may let go on any thread.
void let_go(DLManagedTensor* tensor) {
  const py::gil_scoped_acquire held;
  delete static_cast<Handed*>(tensor->manager_ctx);
}

py::object handed_on(const DeviceArray& array) {
  auto handed = std::make_unique<Handed>();
  handed->shape = {static_cast<std::int64_t>(array.rows), 3};
  handed->owner = array.owner;
  DLTensor& tensor = handed->tensor.dl_tensor;
  tensor.data = const_cast<void*>(array.data);
  tensor.device = {kDLCUDA, array.device};
  tensor.ndim = 2;
  tensor.dtype = {kDLFloat, static_cast<std::uint8_t>(8 * array.bytes), 1};
  tensor.shape = handed->shape.data();
  handed->tensor.manager_ctx = handed.get();
  handed->tensor.deleter = let_go;
  PyObject* capsule = PyCapsule_New(&handed->tensor, not_taken, [](PyObject* ended) {
    if (!PyCapsule_IsValid(ended, not_taken)) return;  // taken: whoever has it lets go
    let_go(static_cast<DLManagedTensor*>(PyCapsule_GetPointer(ended, not_taken)));
  });
  if (capsule == nullptr) throw py::error_already_set();
  handed.release();
  return py::reinterpret_steal<py::object>(capsule);
}

py::dict cuda_interface(const DeviceArray& array) {
  using namespace py::literals;
  const bool read_only = true;
  return py::dict(
      "shape"_a = py::make_tuple(array.rows, 3), "typestr"_a = fmt::format("<f{}", array.bytes),
      "data"_a = py::make_tuple(reinterpret_cast<std::uintptr_t>(array.data), read_only),
      "version"_a = 3);
}

// What DLPack's protocol asks for may be another device, or a copy.
void check_asked(const DeviceArray& array, const py::kwargs& options) {
  const auto refuse = [](const std::string& found, const std::string& allowed) {
    throw py::buffer_error(fmt::format("{}, allowed: {}", found, allowed));
  };
  const auto asked = [&options](const char* name) -> py::object {
    return options.contains(name) ? py::object(options[name]) : py::none();
  };
  const py::object device = asked("dl_device");
  if (!device.is_none() && !device.equal(py::make_tuple(static_cast<int>(kDLCUDA), array.device))) {
    refuse(
        fmt::format("dl_device: {}", py::repr(device).cast<std::string>()),
        fmt::format("({}, {}), where the simulation is", static_cast<int>(kDLCUDA), array.device));
  }
  if (asked("copy").is(py::bool_(true))) refuse("copy: True", "False or None: copy what it gives");
}

}  // namespace

void define_device_array(py::module_& module) {
  py::class_<DeviceArray>(module, "DeviceArray")
      .def("__dlpack__",
           [](const DeviceArray& self, const py::kwargs& options) {
             check_asked(self, options);
             return handed_on(self);
           })
      .def("__dlpack_device__",
           [](const DeviceArray& self) {
             return py::make_tuple(static_cast<int>(kDLCUDA), self.device);
           })
      .def_property_readonly("__cuda_array_interface__", &cuda_interface)
      .def_property_readonly("shape",
                             [](const DeviceArray& self) { return py::make_tuple(self.rows, 3); })
      .def("__repr__", [](const DeviceArray& self) {
        return fmt::format("<viscera.DeviceArray: {} x 3, float{}, cuda:{}>", self.rows,
                           8 * self.bytes, self.device);
      });
}

}  // namespace viscera::python
