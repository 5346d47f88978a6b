#include "stages/simulate/probes.hpp"

#include <algorithm>
#include <optional>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "sim/base/refusal.hpp"
#include "stages/image/image_io.hpp"
#include "stages/mesh/landmark_io.hpp"
#include "stages/program/param_values.hpp"
#include "stages/simulate/body.hpp"

namespace viscera {
namespace {

struct ProbeRequest {
  std::string name;
  std::optional<std::array<double, 3>> point;  // mm, LPS
  std::string label;                           // of a centroid or a gap
  std::string beyond;                          // of a gap: an obstacle or another label
};

ProbeRequest read_probe(const std::string& name, const Json& given) {
  const std::string field = "probes." + name;
  check_plain_name(name, "probes", "probe");
  const auto refuse = [&](const std::string& found) {
    throw Error(ExitCode::bad_config,
                {.where = "parameters",
                 .field = field,
                 .found = found,
                 .allowed = "{point: [10 mm, -4 mm, 870 mm]}, {centroid: LABEL} or {between: "
                            "[LABEL, OBSTACLE or LABEL]}"});
  };
  const Json values = resolve(probes_param().entry, given, "parameters", field + ".");
  const Json &point = values.at("point"), &between = values.at("between");
  ProbeRequest probe{
      .name = name, .point = {}, .label = values.at("centroid").get<std::string>(), .beyond = {}};
  const int kinds = !point.is_null() + !probe.label.empty() + !between.is_null();
  if (kinds != 1) refuse(kinds == 0 ? "none of point, centroid and between" : "several at once");
  if (!point.is_null()) probe.point = read_place(point, field + ".point");
  if (!between.is_null()) {
    if (between.size() != 2 || !between[0].is_string() || !between[1].is_string())
      refuse("between " + between.dump());
    probe.label = between[0].get<std::string>(), probe.beyond = between[1].get<std::string>();
  }
  return probe;
}

std::vector<ProbeRequest> read_requests(const StageRun& run) {
  std::vector<ProbeRequest> requests;
  for (const auto& [name, value] : run.params().at("probes").items())
    requests.push_back(read_probe(name, value));
  return requests;
}

// Which of `all` a name is.
int number_of(const std::string& name, const std::vector<std::string>& all,
              const std::string& field, const char* what, const char* allowed) {
  const auto found = std::ranges::find(all, name);
  if (found == all.end()) {
    throw Error(ExitCode::bad_config, {.where = "parameters",
                                       .field = "probes." + field,
                                       .found = "'" + name + "', " + what,
                                       .allowed = allowed,
                                       .remedy = suggest(name, all)});
  }
  return static_cast<int>(found - all.begin());
}

// ITK-SNAP's places: voxels, the centre of the first one at 0.5.
using Place = std::array<double, 3>;

Place from_voxels(const Frame& frame, const Place& voxels) {
  Place mm{};
  for (int k = 0; k < 3; ++k) mm[k] = frame.spacing[k] * (voxels[k] - 0.5);
  return frame.to_lps(mm);
}

Place to_voxels(const Frame& frame, const Place& lps) {
  const Place mm = frame.from_lps(lps);
  Place voxels{};
  for (int k = 0; k < 3; ++k) voxels[k] = mm[k] / frame.spacing[k] + 0.5;
  return voxels;
}

// Follows those of `probes`, whose names they must not have.
void add_landmarks(const StageRun& run, const sim::Model& model, const std::optional<Frame>& image,
                   std::vector<sim::Probe>& probes) {
  const std::filesystem::path file = run.input("landmarks");
  Landmarks landmarks = read_landmarks(file);
  if (landmarks.in_voxels) {
    if (!image) {
      throw Error(ExitCode::bad_input,
                  {.where = file.string(),
                   .found = "places in voxels of an image that the file does not name",
                   .remedy = "give the image that ITK-SNAP had open as the input landmarks_image"});
    }
    for (Landmark& landmark : landmarks.all) landmark.place = from_voxels(*image, landmark.place);
  }
  if (landmarks.were_ras) {
    log::info("{} landmarks are in RAS: taken to LPS", landmarks.all.size());
  }
  const auto refuse = [&file](const std::string& name, std::string found, std::string allowed) {
    throw Error(ExitCode::bad_input, {.where = file.string(),
                                      .field = name,
                                      .found = std::move(found),
                                      .allowed = std::move(allowed)});
  };
  for (const auto& [name, place] : landmarks.all) {
    check_plain_name(name, file.string(), "landmark");
    if (run.params().at("probes").contains(name)) {
      refuse(name, "a landmark with the name of a probe", "names that differ");
    }
    const auto& [x, y, z] = place;
    try {
      probes.push_back(sim::probe_of_point(model, name, mm_to_m * sim::Vec3<double>{x, y, z}));
    } catch (const sim::Refusal& outside) {
      refuse(name, outside.found, outside.allowed);
    }
  }
}

}  // namespace

Param probes_param() {
  return {.name = "probes",
          .type = ParamType::map,
          .fallback = Json::object(),
          .entry = {{.name = "point",
                     .type = ParamType::list,
                     .fallback = nullptr,
                     .doc = "a point of the body at rest, [x, y, z], LPS"},
                    {.name = "centroid", .fallback = "", .doc = "a label of the mesh"},
                    {.name = "between",
                     .type = ParamType::list,
                     .fallback = nullptr,
                     .doc = "a label of the mesh, and an obstacle of the scene or another label"}},
          .doc =
              "points of the body at rest, centroids of labels and gaps between labels and "
              "obstacles or other labels to follow, in metrics.csv: {tip: {point: [10 mm, -4 mm, "
              "870 mm]}, lump: {centroid: tumour}, gap: {between: [liver, ground]}, margin: "
              "{between: [tumour, vessels]}}; LPS"};
}

void check_probes(const StageRun& run) {
  read_requests(run);
}

std::optional<Frame> landmarks_frame(const StageRun& run) {
  if (!run.has_input("landmarks_image")) return std::nullopt;
  return read_scalar_image(run.input("landmarks_image")).frame;
}

std::vector<sim::Probe> read_probes(const StageRun& run, const sim::Model& model,
                                    const std::optional<Frame>& image) {
  std::vector<sim::Probe> probes;
  for (const ProbeRequest& asked : read_requests(run)) {
    if (!asked.beyond.empty()) continue;
    if (asked.point) {
      const auto& [x, y, z] = *asked.point;
      probes.push_back(
          sim::probe_of_point(model, asked.name, mm_to_m * sim::Vec3<double>{x, y, z}));
    } else {
      const int material = number_of(asked.label, model.label_names, asked.name + ".centroid",
                                     "a label that the mesh has not", "a label of the mesh");
      probes.push_back(sim::probe_of_centroid(model, asked.name, material));
    }
  }
  if (run.has_input("landmarks")) add_landmarks(run, model, image, probes);
  return probes;
}

std::vector<sim::GapProbe> read_gaps(const StageRun& run, const sim::Model& model,
                                     const sim::Scene& scene) {
  std::vector<sim::GapProbe> gaps;
  for (const ProbeRequest& asked : read_requests(run)) {
    if (asked.beyond.empty()) continue;
    const std::string field = asked.name + ".between";
    const int material = number_of(asked.label, model.label_names, field,
                                   "a label that the mesh has not", "a label of the mesh");
    std::vector<std::string> known = sim::obstacles_of(scene);
    if (std::ranges::count(known, asked.beyond) > 0) {
      gaps.push_back(sim::gap_probe(model, asked.name, material, asked.beyond));
      continue;
    }
    const std::size_t obstacles = known.size();
    known.insert(known.end(), model.label_names.begin(), model.label_names.end());
    const int other = number_of(asked.beyond, known, field, "neither in the scene nor in the mesh",
                                "ground or another obstacle of the scene, or a label") -
                      static_cast<int>(obstacles);
    gaps.push_back(sim::gap_probe(model, asked.name, material, other));
  }
  return gaps;
}

sim::Vec3<double> place_mm(const sim::Model& model, const sim::Probe& probe,
                           const sim::Vec3<double>& u) {
  return m_to_mm * (model.origin + probe.mean_of(model.rest) + u);
}

void write_landmarks(const StageRun& run, const sim::Model& model,
                     const std::vector<sim::Probe>& probes, const std::vector<sim::Vec3<double>>& u,
                     const std::optional<Frame>& image) {
  if (!run.has_input("landmarks")) return;
  std::vector<Landmark> at_end;
  for (std::size_t k = 0; k < probes.size(); ++k) {
    if (run.params().at("probes").contains(probes[k].name)) continue;
    const auto place = place_mm(model, probes[k], u[k]);
    at_end.push_back({probes[k].name, {place.x, place.y, place.z}});
  }
  write_atomically(run.out("landmarks.csv"), landmarks_as_table(at_end));
  write_atomically(run.out("landmarks.mrk.json"), landmarks_as_markups(at_end));
  if (!image) return;
  for (Landmark& landmark : at_end) landmark.place = to_voxels(*image, landmark.place);
  write_atomically(run.out("landmarks.annot"), landmarks_as_annotations(at_end));
}

}  // namespace viscera
