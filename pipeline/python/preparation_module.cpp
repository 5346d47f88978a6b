// The module viscera._preparation: labels, surfaces and tets. Apart from viscera._viscera, so that
// a simulation does not load the libraries of images and meshing.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <optional>

#include "pipeline/base/log.hpp"
#include "pipeline/python/arrays.hpp"
#include "pipeline/python/preparation.hpp"

namespace viscera::python {
namespace {

using Triple = std::array<double, 3>;

// As SimpleITK's arrays: [k][j][i].
LabelImage volume_of(const py::object& given, const Triple& spacing, const Triple& origin,
                     const std::array<double, 9>& direction,
                     const std::map<int, std::string>& names) {
  const py::object numbers = py::module_::import("numpy").attr("asarray")(given);
  check_whole(numbers, "array");
  if (numbers.attr("ndim").cast<int>() != 3) {
    throw py::value_error(fmt::format("array: shape {}, allowed: (n, m, l), the last axis along x",
                                      py::repr(numbers.attr("shape")).cast<std::string>()));
  }
  for (const char* extreme : {"min", "max"}) {
    if (numbers.attr("size").cast<py::ssize_t>() == 0) break;  // refused with the shape
    const py::object value = numbers.attr(extreme)();
    if (value < py::int_(0) || value > py::int_(max_label_id)) {
      throw py::value_error(fmt::format("array: {}, allowed: ids from 0 to {}",
                                        py::str(value).cast<std::string>(), max_label_id));
    }
  }
  const auto voxels = array_of<std::uint16_t>(numbers, "array");
  LabelImage image{.frame = {.spacing = spacing, .origin = origin, .direction = direction},
                   .voxels = {voxels.data(), voxels.data() + voxels.size()},
                   .names = names};
  for (int a = 0; a < 3; ++a) {
    constexpr py::ssize_t most = std::numeric_limits<int>::max();
    image.frame.size[a] = static_cast<int>(std::min(most, voxels.shape(2 - a)));
  }
  return image;
}

SurfaceMesh triangles_of(const py::object& points, const py::object& triangles,
                         const py::object& labels, const std::map<int, std::string>& names) {
  SurfaceMesh surface;
  surface.points = rows_of<double, 3>(points, "points");
  surface.triangles = whole_rows_of<3>(triangles, "triangles", std::numeric_limits<int>::max());
  surface.labels = labels_of_each(labels, surface.triangles.size(), "triangle");
  surface.label_names = names_for(surface.labels, names);
  check_surface(surface);
  return surface;
}

// Voxels in the order of their axes, [k][j][i], as a view.
py::array voxels_of(const py::object& self) {
  const LabelImage& image = self.cast<const Labels&>().image;
  const auto& size = image.frame.size;
  return view_of<std::uint16_t>(image.voxels, self).reshape({size[2], size[1], size[0]});
}

void define_labels(py::module_& module) {
  py::class_<Labels> labels(module, "Labels",
                            "Segmented voxels, cleaned: one body with a margin of background.");
  labels
      .def_property_readonly("voxels", &voxels_of,
                             "[k, j, i] ids, the last axis along the first of `direction`; a view")
      .def_property_readonly(
          "spacing", [](const Labels& self) { return self.image.frame.spacing; },
          "mm along each axis: x, y, z")
      .def_property_readonly(
          "origin", [](const Labels& self) { return self.image.frame.origin; },
          "LPS mm, the centre of voxel [0, 0, 0]")
      .def_property_readonly(
          "direction", [](const Labels& self) { return self.image.frame.direction; },
          "row by row; column a is axis a in LPS")
      .def_property_readonly(
          "names", [](const Labels& self) { return self.image.names; }, "the materials by id")
      .def(
          "surface",
          [](const Labels& self, const py::kwargs& params) {
            const Json values = json_of(params);
            return beside_others([&] { return surface_of(self, values); });
          },
          "A smooth closed surface of each material; params are those of viscera-surface.")
      .def(
          "tet_mesh",
          [](const Labels& self, const Surface* surface, const NamedMesh* size_field,
             const py::kwargs& params) {
            const Json values = json_of(params);
            return beside_others([&] { return mesh_of(&self, surface, size_field, values); });
          },
          py::arg("surface") = py::none(), py::arg("size_field") = py::none(),
          "A tetrahedral mesh of all materials; params are those of viscera-tetmesh, as in "
          "cell_size=\"5 mm\". The mesh's distance from a surface is measured. size_field: a mesh "
          "of these labels with cell sizes, of Simulation.certify().")
      .def("__repr__", [](const Labels& self) {
        const auto& size = self.image.frame.size;
        return fmt::format("<viscera.Labels: {} x {} x {} voxels, {} materials>", size[0], size[1],
                           size[2], self.image.names.size());
      });
  define_said(labels);
}

void define_surface(py::module_& module) {
  py::class_<Surface> surface(
      module, "Surface",
      "Closed triangle surfaces, one a material, seen from outside; points in mm.");
  surface
      .def(py::init([](const py::object& points, const py::object& triangles,
                       const py::object& labels, const std::map<int, std::string>& names) {
             return Surface{.mesh = triangles_of(points, triangles, labels, names), .said = {}};
           }),
           py::arg("points"), py::arg("triangles"), py::arg("labels") = py::none(),
           py::arg("names") = std::map<int, std::string>())
      .def_property_readonly("points",
                             [](const py::object& self) {
                               return view_of<double>(self.cast<const Surface&>().mesh.points,
                                                      self);
                             })
      .def_property_readonly("triangles",
                             [](const py::object& self) {
                               return view_of<int>(self.cast<const Surface&>().mesh.triangles,
                                                   self);
                             })
      .def_property_readonly("labels",
                             [](const py::object& self) {
                               return view_of<int>(self.cast<const Surface&>().mesh.labels, self);
                             })
      .def_property_readonly("names", [](const Surface& self) { return self.mesh.label_names; })
      .def(
          "tet_mesh",
          [](const Surface& self, const py::kwargs& params) {
            const Json values = json_of(params);
            return beside_others([&] { return mesh_of(nullptr, &self, nullptr, values); });
          },
          "A tetrahedral mesh inside the surface; params are those of viscera-tetmesh.")
      .def("__repr__", [](const Surface& self) {
        return fmt::format("<viscera.Surface: {} triangles, {} points>", self.mesh.triangles.size(),
                           self.mesh.points.size());
      });
  define_said(surface);
}

}  // namespace

PYBIND11_MODULE(_preparation, module) {
  log::set_level(log::Level::warn);
  log::set_name("viscera");
  log::ask_for_interrupts(look_for_signals);
  define_labels(module);
  define_surface(module);
  module.def("read_labels",
             [](const std::vector<std::filesystem::path>& sources, const py::dict& params) {
               const Json values = json_of(params);
               return beside_others([&] { return read_labels(sources, values); });
             });
  module.def("labels_of", [](const py::object& given, const Triple& spacing, const Triple& origin,
                             const std::array<double, 9>& direction,
                             const std::map<int, std::string>& names, const py::dict& params) {
    LabelImage volume = volume_of(given, spacing, origin, direction, names);
    const Json values = json_of(params);
    return beside_others([&] { return labels_of(std::move(volume), values); });
  });
}

}  // namespace viscera::python
