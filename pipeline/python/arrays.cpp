#include "pipeline/python/arrays.hpp"

#include "pipeline/base/json_value.hpp"
#include "stages/mesh/tet_mesh.hpp"

namespace viscera::python {

// As Python's own recursion, bounded: what is nested deeper refers to itself.
Json json_of(const py::handle& value, int depth) {
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

py::object object_of(const Json& value) {
  if (value.is_boolean()) return py::bool_(value.get<bool>());
  if (value.is_number_integer()) return py::int_(value.get<std::int64_t>());
  if (value.is_number()) return py::float_(value.get<double>());
  if (value.is_string()) return py::str(value.get<std::string>());
  if (value.is_array()) {
    py::list list;
    for (const Json& item : value) list.append(object_of(item));
    return list;
  }
  if (value.is_object()) {
    py::dict dict;
    for (const auto& [name, member] : value.items()) dict[py::str(name)] = object_of(member);
    return dict;
  }
  return py::none();
}

std::vector<int> labels_of_each(const py::object& given, std::size_t count, const char* each) {
  if (given.is_none()) return std::vector<int>(count, 1);
  return numbers_of<int>(given, "labels", count, each, max_label);
}

void look_for_signals() {
  const py::gil_scoped_acquire held;
  if (PyErr_CheckSignals() != 0) throw py::error_already_set();
}

std::map<int, std::string> names_for(const std::vector<int>& labels,
                                     const std::map<int, std::string>& given) {
  std::map<int, std::string> names;
  for (const int label : labels) {
    if (names.contains(label)) continue;
    const auto known = given.find(label);
    names[label] = known != given.end() ? known->second : fmt::format("label_{}", label);
  }
  return names;
}

}  // namespace viscera::python
