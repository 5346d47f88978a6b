#include "stages/simulate/probes.hpp"

#include <algorithm>
#include <optional>

#include "pipeline/base/error.hpp"
#include "stages/program/param_values.hpp"
#include "stages/simulate/body.hpp"

namespace viscera {
namespace {

struct ProbeRequest {
  std::string name;
  std::optional<std::array<double, 3>> point;  // mm, LPS
  std::string label;                           // of a centroid
};

ProbeRequest read_probe(const std::string& name, const Json& given) {
  const std::string field = "probes." + name;
  check_plain_name(name, "probes", "probe");
  const auto refuse = [&](const std::string& found) {
    throw Error(ExitCode::bad_config,
                {.where = "parameters",
                 .field = field,
                 .found = found,
                 .allowed = "{point: [10 mm, -4 mm, 870 mm]}, or {centroid: LABEL}"});
  };
  if (!given.is_object()) refuse(given.dump());
  const Json values = resolve({{.name = "point", .type = ParamType::list, .fallback = nullptr},
                               {.name = "centroid", .fallback = ""}},
                              given, "parameters", field + ".");
  ProbeRequest probe{.name = name, .point = {}, .label = values.at("centroid").get<std::string>()};
  if (!values.at("point").is_null()) probe.point = read_place(values.at("point"), field + ".point");
  if (probe.point.has_value() != probe.label.empty())
    refuse(probe.point ? "both point and centroid" : "neither point nor centroid");
  return probe;
}

std::vector<ProbeRequest> read_requests(const StageRun& run) {
  std::vector<ProbeRequest> requests;
  for (const auto& [name, value] : run.params().at("probes").items())
    requests.push_back(read_probe(name, value));
  return requests;
}

}  // namespace

Param probes_param() {
  return {.name = "probes",
          .type = ParamType::map,
          .fallback = Json::object(),
          .doc =
              "points of the body at rest and centroids of labels to follow, in metrics.csv: "
              "{tip: {point: [10 mm, -4 mm, 870 mm]}, lump: {centroid: tumour}}; LPS"};
}

void check_probes(const StageRun& run) {
  read_requests(run);
}

std::vector<sim::Probe> read_probes(const StageRun& run, const sim::Model& model) {
  std::vector<sim::Probe> probes;
  for (const auto& [name, point, label] : read_requests(run)) {
    if (point) {
      const auto& [x, y, z] = *point;
      probes.push_back(sim::probe_of_point(model, name, mm_to_m * sim::Vec3<double>{x, y, z}));
      continue;
    }
    const auto found = std::ranges::find(model.label_names, label);
    if (found == model.label_names.end()) {
      throw Error(ExitCode::bad_config, {.where = "parameters",
                                         .field = "probes." + name + ".centroid",
                                         .found = "'" + label + "', a label that the mesh has not",
                                         .allowed = "a label of the mesh",
                                         .remedy = suggest(label, model.label_names)});
    }
    probes.push_back(
        sim::probe_of_centroid(model, name, static_cast<int>(found - model.label_names.begin())));
  }
  return probes;
}

sim::Vec3<double> place_mm(const sim::Model& model, const sim::Probe& probe,
                           const sim::Vec3<double>& u) {
  return m_to_mm * (model.origin + probe.mean_of(model.rest) + u);
}

}  // namespace viscera
