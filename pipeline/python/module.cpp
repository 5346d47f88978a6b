// The module viscera._viscera. What users read of it is in viscera/__init__.py.
#include <pybind11/functional.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <unistd.h>

#include <limits>
#include <mutex>

#include "pipeline/base/log.hpp"
#include "pipeline/python/arrays.hpp"
#include "pipeline/python/device_array.hpp"
#include "pipeline/python/simulation.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/body.hpp"

namespace viscera::python {
namespace {

NamedMesh mesh_of(const py::object& points, const py::object& tets, const py::object& labels,
                  const std::map<int, std::string>& names, const py::dict& regions) {
  NamedMesh named;
  TetMesh& mesh = named.mesh;
  mesh.points = rows_of<double, 3>(points, "points");
  mesh.tets = whole_rows_of<4>(tets, "tets", std::numeric_limits<int>::max());
  mesh.labels = labels_of_each(labels, mesh.tets.size(), "tet");
  mesh.label_names = names_for(mesh.labels, names);
  for (const auto& [name, inside] : regions) {
    mesh.regions[py::str(name).cast<std::string>()] = numbers_of<char>(
        py::reinterpret_borrow<py::object>(inside), "regions", mesh.tets.size(), "tet", 1);
  }
  return named;
}

// One view a name.
template <class T>
py::dict views_of(const std::map<std::string, std::vector<T>>& arrays, const py::object& owner) {
  py::dict views;
  for (const auto& [name, values] : arrays) views[py::str(name)] = view_of<T>(values, owner);
  return views;
}
py::dict cell_data_of(const py::object& self) {
  return views_of(self.cast<const NamedMesh&>().mesh.cell_data, self);
}
py::dict regions_of(const py::object& self) {
  py::dict views = views_of(self.cast<const NamedMesh&>().mesh.regions, self);
  for (const auto& [name, inside] : views) views[name] = inside.attr("view")("bool");
  return views;
}

template <class Owned>
py::object keeper_of(std::shared_ptr<const Owned> owned) {
  using Kept = std::shared_ptr<const Owned>;
  return py::capsule(new Kept(std::move(owned)),
                     [](void* kept) { delete static_cast<Kept*>(kept); });
}

// None where it is not known.
py::object object_of(const std::optional<FrameValue>& value) {
  if (!value) return py::none();
  return std::visit([](const auto& known) -> py::object { return py::cast(known); }, *value);
}

// A simulation, one thread at a time.
class Guarded {
 public:
  Guarded(const NamedMesh& mesh, const std::filesystem::path& scene, const Json& params)
      : simulation_(std::make_unique<Simulation>(mesh, scene, params)) {}
  // A copy of the process has neither the threads of its solver, for which it would wait for ever,
  // nor its device: it leaves them alone.
  ~Guarded() {
    if (getpid() != process_) simulation_.release();
  }

  // Frames on; Ctrl-C ends it between two of them.
  void step(int frames) {
    const auto lock = alone();
    const py::gil_scoped_release others_may_run;
    for (int k = 0; k < frames; ++k) {
      simulation_->step();
      look_for_signals();
    }
  }

  py::dict run(const py::object& progress, std::optional<double> until_s) {
    const auto lock = alone();
    const auto keep = [&progress](const ComputedFrame& frame) {
      const py::gil_scoped_acquire held;
      look_for_signals();
      if (!progress.is_none()) progress(frame.index, frame.time_s, frame.now.max_speed);
    };
    return told(beside_others([&] { return simulation_->run(keep, until_s); }));
  }

  py::array displacements() {
    const auto lock = alone();
    const auto state = simulation_->state();
    return view_of<double>(state->u, keeper_of(state));
  }
  py::array velocities() {
    const auto lock = alone();
    const auto state = simulation_->state();
    return view_of<double>(state->v, keeper_of(state));
  }
  py::array positions() {
    const auto lock = alone();
    const auto state = simulation_->state();
    const sim::Model& body = simulation_->body();
    py::array_t<double> positions({static_cast<py::ssize_t>(state->u.size()), py::ssize_t{3}});
    auto row = positions.mutable_unchecked<2>();
    for (std::size_t i = 0; i < state->u.size(); ++i) {
      const auto at = m_to_mm * (body.origin + body.rest[i] + state->u[i]);
      const auto k = static_cast<py::ssize_t>(i);
      row(k, 0) = at.x, row(k, 1) = at.y, row(k, 2) = at.z;
    }
    return positions;
  }
  // [vertices][3] m and m/s where the device has them; `self` is this as Python's object.
  py::tuple motion_on_device(const py::object& self) {
    const auto lock = alone();
    const sim::DeviceMotion motion =
        beside_others([this] { return simulation_->motion_on_device(); });
    const auto array = [&](const void* data) {
      return DeviceArray{data, motion.vertices, motion.bytes, motion.device, self};
    };
    return py::make_tuple(array(motion.u), array(motion.v));
  }
  py::dict diagnose() {
    const auto lock = alone();
    const sim::Diagnostics state = simulation_->diagnose();
    py::dict now;
    for (const StateColumn& column : state_columns())
      now[column.name] = object_of(column.value(state));
    return now;
  }
  // [tets][3][3] Pa, symmetric.
  py::array stress() {
    const auto lock = alone();
    const auto tets = beside_others([this] { return simulation_->strained(); });
    py::array_t<double> all(
        {static_cast<py::ssize_t>(tets.size()), py::ssize_t{3}, py::ssize_t{3}});
    auto entry = all.mutable_unchecked<3>();
    for (py::ssize_t t = 0; t < entry.shape(0); ++t) {
      const sim::Mat3<double> cauchy = sim::full(tets[t].cauchy);
      for (int c = 0; c < 3; ++c) {
        const auto& column = cauchy.col[c];
        entry(t, 0, c) = column.x, entry(t, 1, c) = column.y, entry(t, 2, c) = column.z;
      }
    }
    return all;
  }
  // Lengths in mm.
  py::dict certify() {
    const auto lock = alone();
    const auto found = beside_others([this] { return simulation_->certify(); });
    const sim::ErrorBar& bar = found.bar;
    if (!bar.unknown.empty())
      throw std::runtime_error("how far the body is off is not known: " + bar.unknown);
    const auto [solver, element, mesh, support, surface, total] = bar.displacement;
    py::dict parts, quantities;
    parts["total"] = m_to_mm * total;
    parts["share"] = bar.share();
    parts["solver"] = m_to_mm * solver;
    parts["element"] = m_to_mm * element;
    parts["mesh"] = m_to_mm * mesh;
    parts["support"] = m_to_mm * support;
    parts["surface"] =
        bar.surface_unknown.empty() ? py::object(py::float_(m_to_mm * surface)) : py::none();
    for (std::size_t k = 0; k < found.quantities.size(); ++k)
      quantities[py::str(found.quantities[k].name)] = m_to_mm * bar.probes[k].total;
    parts["quantities"] = quantities;
    parts["size_field"] = found.sized;
    return parts;
  }
  // [vertices][3] N.
  py::array forces() {
    const auto lock = alone();
    const auto found = std::make_shared<const std::vector<sim::Vec3<double>>>(
        beside_others([this] { return simulation_->forces(); }));
    return view_of<double>(*found, keeper_of(found));
  }
  void set(const std::string& name, double value) {
    const auto lock = alone();
    simulation_->set(name, value);
  }
  py::dict gradient(const py::object& by_displacement, const std::vector<std::string>& names) {
    const auto lock = alone();
    std::vector<sim::Vec3<double>> slope;
    for (const auto& [x, y, z] : rows_of<double, 3>(by_displacement, "by_displacement")) {
      slope.push_back({x, y, z});
    }
    if (const std::size_t n = simulation_->body().vertex_count(); slope.size() != n) {
      throw py::value_error(
          fmt::format("by_displacement: {} rows, allowed: {}, one a vertex", slope.size(), n));
    }
    const auto found = beside_others([&] { return simulation_->gradient(slope, names); });
    py::dict gradient;
    for (std::size_t k = 0; k < names.size(); ++k) gradient[py::str(names[k])] = found[k];
    return gradient;
  }
  void write(const std::filesystem::path& file) {
    const auto lock = alone();
    beside_others([&] { simulation_->write(file); });
  }
  std::string state_hash() {
    const auto lock = alone();
    return fmt::format("{:016x}", simulation_->state()->hash());
  }
  const Simulation& read() const { return *simulation_; }

 private:
  std::unique_lock<std::mutex> alone() {
    if (getpid() != process_) {
      throw std::runtime_error(
          "this simulation was made in another process, of which this one is a copy (fork); make "
          "it here, or start processes by multiprocessing's \"spawn\"");
    }
    std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (!lock) throw std::runtime_error("another thread is stepping this simulation");
    return lock;
  }

  py::dict told(const Outcome& outcome) const {
    const std::vector<FrameColumn> columns = simulation_->columns(outcome);
    py::list frames;
    for (const ComputedFrame& frame : outcome.frames) {
      py::dict row;
      for (const FrameColumn& column : columns) {
        row[py::str(column.name)] = object_of(column.value(frame));
      }
      frames.append(row);
    }
    py::dict all;
    all["rested"] = outcome.rested;
    all["rest_time_s"] = outcome.rested ? py::object(py::float_(outcome.rest_time_s)) : py::none();
    all["divergence"] =
        outcome.divergence.empty() ? py::object(py::none()) : py::str(outcome.divergence);
    all["frames"] = frames;
    return all;
  }

  const pid_t process_ = getpid();
  std::mutex mutex_;
  std::unique_ptr<Simulation> simulation_;
};

// viscera.Error: what an Error says, its parts as attributes.
void define_error(py::module_& module) {
  static py::object type = py::reinterpret_steal<py::object>(PyErr_NewExceptionWithDoc(
      "viscera.Error",
      "What a program of viscera says when it ends with an error: `where` (file, line), `field`, "
      "`found`, `allowed`, `remedy`, and the program's `exit_code`.",
      PyExc_RuntimeError, nullptr));
  module.attr("Error") = type;
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Error& error) {
      py::object instance = type(error.what());
      const Problem& problem = error.problem();
      instance.attr("where") = problem.where;
      instance.attr("field") = problem.field;
      instance.attr("found") = problem.found;
      instance.attr("allowed") = problem.allowed;
      instance.attr("remedy") = problem.remedy;
      instance.attr("exit_code") = static_cast<int>(error.code());
      PyErr_SetObject(type.ptr(), instance.ptr());
    }
  });
}

void define_mesh(py::module_& module) {
  py::class_<NamedMesh> mesh_class(module, "TetMesh");
  define_said(mesh_class);
  mesh_class
      .def(py::init(&mesh_of), py::arg("points"), py::arg("tets"), py::arg("labels") = py::none(),
           py::arg("names") = std::map<int, std::string>(), py::arg("regions") = py::dict())
      .def_property_readonly("points",
                             [](const py::object& self) {
                               return view_of<double>(self.cast<const NamedMesh&>().mesh.points,
                                                      self);
                             })
      .def_property_readonly("tets",
                             [](const py::object& self) {
                               return view_of<int>(self.cast<const NamedMesh&>().mesh.tets, self);
                             })
      .def_property_readonly("labels",
                             [](const py::object& self) {
                               return view_of<int>(self.cast<const NamedMesh&>().mesh.labels, self);
                             })
      .def_property_readonly("names", [](const NamedMesh& mesh) { return mesh.mesh.label_names; })
      .def_property_readonly("cell_data", &cell_data_of)
      .def_property_readonly("regions", &regions_of)
      .def("__repr__", [](const NamedMesh& mesh) {
        return fmt::format("<viscera.TetMesh: {} tets, {} vertices>", mesh.mesh.tets.size(),
                           mesh.mesh.points.size());
      });
  module.def(
      "read_mesh",
      [](const std::filesystem::path& file) {
        return NamedMesh{.mesh = read_vtu(file), .name = file.string()};
      },
      py::arg("file"), py::call_guard<py::gil_scoped_release>());
}

void define_simulation(py::module_& module) {
  py::class_<Guarded> simulation(module, "Simulation");
  define_said(simulation, [](const Guarded& self) -> const Said& { return self.read().said(); });
  simulation
      .def(py::init(
          [](const NamedMesh& mesh, const std::filesystem::path& scene, const py::dict& params) {
            const Json values = json_of(params);
            const py::gil_scoped_release others_may_run;
            return std::make_unique<Guarded>(mesh, scene, values);
          }))
      .def("step", &Guarded::step, py::arg("frames") = 1)
      .def("run", &Guarded::run, py::arg("progress") = py::none(), py::arg("until") = py::none())
      .def("motion_on_device",
           [](const py::object& self) { return self.cast<Guarded&>().motion_on_device(self); })
      .def("diagnose", &Guarded::diagnose)
      .def("certify", &Guarded::certify)
      .def("set", &Guarded::set)
      .def("gradient", &Guarded::gradient)
      .def("write", &Guarded::write)
      .def_property_readonly("displacements", &Guarded::displacements)
      .def_property_readonly("velocities", &Guarded::velocities)
      .def_property_readonly("positions", &Guarded::positions)
      .def_property_readonly("stress", &Guarded::stress)
      .def_property_readonly("forces", &Guarded::forces)
      .def_property_readonly("state_hash", &Guarded::state_hash)
      .def_property_readonly("time", [](const Guarded& self) { return self.read().time_s(); })
      .def_property_readonly("frame", [](const Guarded& self) { return self.read().frame(); })
      .def_property_readonly("frame_time",
                             [](const Guarded& self) { return self.read().scene().time.frame_s; })
      .def_property_readonly("loads_end",
                             [](const Guarded& self) { return self.read().loads_end_s(); })
      .def_property_readonly("substeps",
                             [](const Guarded& self) { return self.read().scene().time.substeps; })
      .def_property_readonly("device", [](const Guarded& self) { return self.read().device(); })
      .def_property_readonly("scheme", [](const Guarded& self) { return self.read().scheme(); });
  module.def("simulate_in_folder", [](const NamedMesh& mesh, const std::filesystem::path& scene,
                                      const py::dict& params, const std::filesystem::path& folder) {
    const Json values = json_of(params);
    beside_others([&] { simulate_in_folder(mesh, scene, values, folder); });
  });
}

}  // namespace

PYBIND11_MODULE(_viscera, module) {
  log::set_level(log::Level::warn);
  log::set_name("viscera");
  log::ask_for_interrupts(look_for_signals);
  define_error(module);
  define_mesh(module);
  define_device_array(module);
  define_simulation(module);
  module.attr("__version__") = VISCERA_VERSION;
}

}  // namespace viscera::python
