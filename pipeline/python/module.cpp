// The module viscera._viscera. What users read of it is in viscera/__init__.py.
#include <pybind11/functional.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <limits>
#include <mutex>

#include "pipeline/base/json_value.hpp"
#include "pipeline/base/log.hpp"
#include "pipeline/python/simulation.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/body.hpp"
#include "stages/simulate/probes.hpp"

namespace py = pybind11;

namespace viscera::python {
namespace {

// As Python's own recursion, bounded: what is nested deeper refers to itself.
Json json_of(const py::handle& value, int depth = 0) {
  if (depth > max_json_depth) {
    throw py::value_error(
        fmt::format("a value nested deeper than {}, or within itself", max_json_depth));
  }
  if (value.is_none()) return nullptr;
  if (py::isinstance<py::bool_>(value)) return value.cast<bool>();
  if (py::isinstance<py::int_>(value)) return value.cast<std::int64_t>();
  if (py::isinstance<py::float_>(value)) return value.cast<double>();
  if (py::isinstance<py::str>(value)) return value.cast<std::string>();
  if (py::isinstance<py::dict>(value)) {
    Json object = Json::object();
    for (const auto& [name, member] : value.cast<py::dict>()) {
      object[py::str(name).cast<std::string>()] = json_of(member, depth + 1);
    }
    return object;
  }
  if (py::isinstance<py::sequence>(value)) {
    Json list = Json::array();
    for (const auto& item : value.cast<py::sequence>()) list.push_back(json_of(item, depth + 1));
    return list;
  }
  throw py::type_error("neither text, number, flag, list nor dict: " +
                       py::repr(value).cast<std::string>());
}

// `what` is said of what is no array.
template <class T>
auto array_of(const py::object& given, const char* what) {
  auto array = py::array_t<T, py::array::c_style | py::array::forcecast>::ensure(given);
  if (!array) throw py::type_error(fmt::format("{}: allowed: an array of numbers", what));
  return array;
}

// [rows][columns] of an array, whatever its order and type; `what` is said of another shape.
template <class T, std::size_t columns>
std::vector<std::array<T, columns>> rows_of(const py::object& given, const char* what) {
  const auto array = array_of<T>(given, what);
  if (array.ndim() != 2 || array.shape(1) != static_cast<py::ssize_t>(columns)) {
    throw py::value_error(fmt::format("{}: shape {}, allowed: (n, {})", what,
                                      py::repr(array.attr("shape")).template cast<std::string>(),
                                      columns));
  }
  const auto* const first = reinterpret_cast<const std::array<T, columns>*>(array.data());
  return {first, first + array.shape(0)};
}

// [rows][columns] of whole numbers of at most `most`, of any such type; negative ones are for
// others to refuse.
template <std::size_t columns>
std::vector<std::array<int, columns>> whole_rows_of(const py::object& given, const char* what,
                                                    std::int64_t most) {
  const py::object array = py::module_::import("numpy").attr("asarray")(given);
  const std::string kind = array.attr("dtype").attr("kind").cast<std::string>();
  if (kind != "i" && kind != "u" && kind != "b") {
    throw py::type_error(fmt::format("{}: allowed: an array of whole numbers", what));
  }
  std::vector<std::array<int, columns>> rows;
  for (const auto& row : rows_of<std::int64_t, columns>(array, what)) {
    std::ranges::transform(row, rows.emplace_back().begin(), [&](std::int64_t value) {
      if (value >= -most && value <= most) return static_cast<int>(value);
      throw py::value_error(fmt::format("{}: {}, allowed: up to {}", what, value, most));
    });
  }
  return rows;
}

// One number a tet.
template <class T>
std::vector<T> numbers_of(const py::object& given, const char* what, std::size_t tets,
                          std::int64_t most) {
  const py::object array = py::module_::import("numpy").attr("asarray")(given);
  if (array.attr("ndim").cast<int>() != 1 || py::len(array) != tets) {
    throw py::value_error(fmt::format("{}: shape {}, allowed: ({},), one a tet", what,
                                      py::repr(array.attr("shape")).cast<std::string>(), tets));
  }
  std::vector<T> numbers;
  for (const auto& [number] : whole_rows_of<1>(array.attr("reshape")(-1, 1), what, most)) {
    numbers.push_back(static_cast<T>(number));
  }
  return numbers;
}

NamedMesh mesh_of(const py::object& points, const py::object& tets, const py::object& labels,
                  const std::map<int, std::string>& names, const py::dict& regions) {
  NamedMesh named;
  TetMesh& mesh = named.mesh;
  mesh.points = rows_of<double, 3>(points, "points");
  mesh.tets = whole_rows_of<4>(tets, "tets", std::numeric_limits<int>::max());
  mesh.labels = labels.is_none() ? std::vector<int>(mesh.tets.size(), 1)
                                 : numbers_of<int>(labels, "labels", mesh.tets.size(), max_label);
  for (const int label : mesh.labels) {
    if (mesh.label_names.contains(label)) continue;
    const auto known = names.find(label);
    mesh.label_names[label] = known != names.end() ? known->second : fmt::format("label_{}", label);
  }
  for (const auto& [name, inside] : regions) {
    mesh.regions[py::str(name).cast<std::string>()] = numbers_of<char>(
        py::reinterpret_borrow<py::object>(inside), "regions", mesh.tets.size(), 1);
  }
  return named;
}

// A view of what `owner` holds, which lives as long as the view: [rows][columns] of T, not to be
// written to.
template <class T, class Row>
py::array view_of(const std::vector<Row>& rows, const py::object& owner) {
  constexpr auto columns = static_cast<py::ssize_t>(sizeof(Row) / sizeof(T));
  std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(rows.size())};
  if (columns > 1) shape.push_back(columns);
  py::array_t<T> view(shape, reinterpret_cast<const T*>(rows.data()), owner);
  view.attr("setflags")(py::arg("write") = false);
  return view;
}

py::object keeper_of(std::shared_ptr<const sim::State> state) {
  using Kept = std::shared_ptr<const sim::State>;
  return py::capsule(new Kept(std::move(state)),
                     [](void* kept) { delete static_cast<Kept*>(kept); });
}

// By the names of the columns of metrics.csv.
void put(const sim::Diagnostics& now, py::dict& into) {
  constexpr double m3_to_ml = 1e6;
  into["kinetic_J"] = now.kinetic;
  into["elastic_J"] = now.elastic;
  into["gravity_J"] = now.gravity;
  into["total_J"] = now.total();
  into["volume_ml"] = m3_to_ml * now.volume;
  into["volume_ratio"] = now.volume_ratio;
  into["min_J"] = now.min_j;
  into["inverted"] = now.inverted;
  into["max_speed_m_s"] = now.max_speed;
  into["rms_speed_m_s"] = now.rms_speed;
}

void put(const sim::Vec3<double>& point, const std::string& name, const char* unit,
         py::dict& into) {
  into[py::str(fmt::format("{}_x_{}", name, unit))] = point.x;
  into[py::str(fmt::format("{}_y_{}", name, unit))] = point.y;
  into[py::str(fmt::format("{}_z_{}", name, unit))] = point.z;
}

// A simulation, one thread at a time.
class Guarded {
 public:
  Guarded(const NamedMesh& mesh, const std::filesystem::path& scene, const Json& params)
      : simulation_(std::make_unique<Simulation>(mesh, scene, params)) {}

  // Frames on; Ctrl-C ends it between two of them.
  void step(int frames) {
    const auto lock = alone();
    const py::gil_scoped_release others_may_run;
    for (int k = 0; k < frames; ++k) {
      simulation_->step();
      const py::gil_scoped_acquire held;
      look_for_signals();
    }
  }

  py::dict run(const py::object& progress) {
    const auto lock = alone();
    Outcome outcome;
    {
      const py::gil_scoped_release others_may_run;
      outcome = simulation_->run([&progress](const ComputedFrame& frame) {
        const py::gil_scoped_acquire held;
        look_for_signals();
        if (!progress.is_none()) progress(frame.index, frame.time_s, frame.now.max_speed);
      });
    }
    return told(outcome);
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
  py::dict diagnose() {
    const auto lock = alone();
    py::dict now;
    put(simulation_->diagnose(), now);
    return now;
  }
  std::string state_hash() {
    const auto lock = alone();
    return fmt::format("{:016x}", simulation_->state()->hash());
  }
  const Simulation& read() const { return *simulation_; }

 private:
  static void look_for_signals() {
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  }

  std::unique_lock<std::mutex> alone() {
    std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (!lock) throw std::runtime_error("another thread is stepping this simulation");
    return lock;
  }

  py::dict told(const Outcome& outcome) const {
    py::list frames;
    for (const ComputedFrame& frame : outcome.frames) {
      py::dict row;
      row["frame"] = frame.index;
      row["time_s"] = frame.time_s;
      put(frame.now, row);
      row["contacts"] = frame.contacts;
      row["state_hash"] = fmt::format("{:016x}", frame.state_hash);
      for (std::size_t k = 0; k < frame.forces.size(); ++k) {
        put(frame.forces[k].force, "force_" + outcome.exerting[k], "N", row);
        put(frame.forces[k].moment, "moment_" + outcome.exerting[k], "N_m", row);
      }
      const auto& probes = simulation_->probes();
      for (std::size_t k = 0; k < probes.size(); ++k) {
        put(place_mm(simulation_->body(), probes[k], frame.probes[k]), "probe_" + probes[k].name,
            "mm", row);
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
  py::class_<NamedMesh>(module, "TetMesh")
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
      .def("__repr__", [](const NamedMesh& mesh) {
        return fmt::format("<viscera.TetMesh: {} tets, {} vertices>", mesh.mesh.tets.size(),
                           mesh.mesh.points.size());
      });
  module.def(
      "read_mesh",
      [](const std::filesystem::path& file) {
        return NamedMesh{read_vtu(file), file.string()};
      },
      py::arg("file"), py::call_guard<py::gil_scoped_release>());
}

void define_simulation(py::module_& module) {
  py::class_<Guarded>(module, "Simulation")
      .def(py::init(
          [](const NamedMesh& mesh, const std::filesystem::path& scene, const py::dict& params) {
            const Json values = json_of(params);
            const py::gil_scoped_release others_may_run;
            return std::make_unique<Guarded>(mesh, scene, values);
          }))
      .def("step", &Guarded::step, py::arg("frames") = 1)
      .def("run", &Guarded::run, py::arg("progress") = py::none())
      .def("diagnose", &Guarded::diagnose)
      .def_property_readonly("displacements", &Guarded::displacements)
      .def_property_readonly("velocities", &Guarded::velocities)
      .def_property_readonly("positions", &Guarded::positions)
      .def_property_readonly("state_hash", &Guarded::state_hash)
      .def_property_readonly("time", [](const Guarded& self) { return self.read().time_s(); })
      .def_property_readonly("frame", [](const Guarded& self) { return self.read().frame(); })
      .def_property_readonly("frame_time",
                             [](const Guarded& self) { return self.read().scene().time.frame_s; })
      .def_property_readonly("substeps",
                             [](const Guarded& self) { return self.read().scene().time.substeps; })
      .def_property_readonly("device", [](const Guarded& self) { return self.read().device(); })
      .def_property_readonly("scheme", [](const Guarded& self) { return self.read().scheme(); });
}

}  // namespace

PYBIND11_MODULE(_viscera, module) {
  log::set_level(log::Level::warn);
  log::set_name("viscera");
  define_error(module);
  define_mesh(module);
  define_simulation(module);
  module.attr("__version__") = VISCERA_VERSION;
}

}  // namespace viscera::python
