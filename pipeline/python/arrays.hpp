// What Python gives and is given: values as JSON, arrays as rows of numbers.
#pragma once

#include <fmt/format.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "pipeline/base/param.hpp"

namespace viscera::python {

namespace py = pybind11;

// Throws what is no text, number, flag, list or dict, and what is nested too deeply.
Json json_of(const py::handle& value, int depth = 0);
py::object object_of(const Json& value);

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

// Throws what is no array of whole numbers.
inline void check_whole(const py::object& array, const char* what) {
  const std::string kind = array.attr("dtype").attr("kind").cast<std::string>();
  if (kind == "i" || kind == "u" || kind == "b") return;
  throw py::type_error(fmt::format("{}: allowed: an array of whole numbers", what));
}

// [rows][columns] of whole numbers of at most `most`, of any such type; negative ones are for
// others to refuse.
template <std::size_t columns>
std::vector<std::array<int, columns>> whole_rows_of(const py::object& given, const char* what,
                                                    std::int64_t most) {
  const py::object array = py::module_::import("numpy").attr("asarray")(given);
  check_whole(array, what);
  std::vector<std::array<int, columns>> rows;
  for (const auto& row : rows_of<std::int64_t, columns>(array, what)) {
    std::ranges::transform(row, rows.emplace_back().begin(), [&](std::int64_t value) {
      if (value >= -most && value <= most) return static_cast<int>(value);
      throw py::value_error(fmt::format("{}: {}, allowed: up to {}", what, value, most));
    });
  }
  return rows;
}

// One number each of `count`, which are called `each`.
template <class T>
std::vector<T> numbers_of(const py::object& given, const char* what, std::size_t count,
                          const char* each, std::int64_t most) {
  const py::object array = py::module_::import("numpy").attr("asarray")(given);
  if (array.attr("ndim").cast<int>() != 1 || py::len(array) != count) {
    throw py::value_error(fmt::format("{}: shape {}, allowed: ({},), one a {}", what,
                                      py::repr(array.attr("shape")).cast<std::string>(), count,
                                      each));
  }
  std::vector<T> numbers;
  for (const auto& [number] : whole_rows_of<1>(array.attr("reshape")(-1, 1), what, most)) {
    numbers.push_back(static_cast<T>(number));
  }
  return numbers;
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

// The labels of `count`, which are called `each`: those given, or 1 for None.
std::vector<int> labels_of_each(const py::object& given, std::size_t count, const char* each);

// The materials' names: those given, and label_N for the others.
std::map<int, std::string> names_for(const std::vector<int>& labels,
                                     const std::map<int, std::string>& given);

// work() while other threads run.
template <class Work>
auto beside_others(Work&& work) {
  const py::gil_scoped_release others_may_run;
  return work();
}

// Throws what Ctrl-C, or another signal that Python handles, ends the work with; for those beside
// others, too.
void look_for_signals();

// What was said of what a class holds (named_mesh.hpp): said_of(object), or its `said`.
template <class Class, class SaidOf>
void define_said(Class& defined, SaidOf said_of) {
  using Type = typename Class::type;
  defined
      .def_property_readonly(
          "gates", [said_of](const Type& self) { return object_of(said_of(self).gates); },
          "What was judged: a dict each with name, value, comparison, limit, unit, passed, and "
          "where "
          "it failed meaning, remedy and places.")
      .def_property_readonly(
          "metrics", [said_of](const Type& self) { return object_of(said_of(self).metrics); },
          "What was measured, by name.")
      .def_property_readonly(
          "caveats", [said_of](const Type& self) { return object_of(said_of(self).caveats); },
          "What every reader of a result must know first, a sentence each.");
}
template <class Class>
void define_said(Class& defined) {
  define_said(
      defined, [](const auto& self) -> const auto& { return self.said; });
}

}  // namespace viscera::python
