// The module viscera._report: the page of viscera-report. Apart, so that a simulation does not load
// the libraries of images.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "pipeline/base/log.hpp"
#include "pipeline/python/arrays.hpp"
#include "stages/report/report_stage.hpp"

namespace viscera::python {
namespace {

// Throws Error for params that the page does not have.
StageRun run_of(const std::map<std::string, std::filesystem::path>& inputs, const Json& params) {
  return make_run(report_stage().info, {inputs.begin(), inputs.end()}, params, "report");
}

}  // namespace

PYBIND11_MODULE(_report, module) {
  log::set_level(log::Level::warn);
  log::set_name("viscera");
  log::ask_for_interrupts(look_for_signals);
  module.def("check", [](const py::dict& params) { run_of({}, json_of(params)); });
  // `inputs`: files by role; `out`: the folder that gets report.html and summary.json.
  module.def("report_in_folder", [](const std::map<std::string, std::filesystem::path>& inputs,
                                    const py::dict& params, const std::filesystem::path& out) {
    const Json values = json_of(params);
    beside_others([&] { run_stage(report_stage(), run_of(inputs, values), out); });
  });
}

}  // namespace viscera::python
