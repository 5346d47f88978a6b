// Order of work: the asked-for ids are selected, specks are given to their neighbours, the largest
// body is kept, and the volume is cropped to it with a margin of background. Voxels hold one id
// each, so materials never compete for a voxel except where a speck is given away (clean.hpp).
#include "stages/labels/stage.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <itkVersion.h>

#include <algorithm>
#include <cmath>

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/error.hpp"
#include "pipeline/contract/log.hpp"
#include "stages/common/image_io.hpp"
#include "stages/common/label_components.hpp"
#include "stages/labels/clean.hpp"

namespace viscera {
namespace {

std::vector<Param> params() {
  return {
      {.name = "labels",
       .type = ParamType::map,
       .fallback = nullptr,
       .doc = "material names and the ids they are made of, {liver: 1, tumour: [2, 3]}; unset: "
              "every id that occurs, under its stored name or as label_N"},
      quantity("min_component", "0.1 ml", "ml", 0.0, 1000.0,
               "smaller components and holes are given to their neighbours"),
      {.name = "keep",
       .type = ParamType::text,
       .fallback = "largest",
       .choices = {"largest", "all"},
       .doc = "the largest connected body (all materials together), or all of them"},
      quantity("pad", "10 mm", "mm", 0.0, 200.0,
               "background left around the body; at least two voxels"),
      {.name = "border",
       .type = ParamType::text,
       .fallback = "gate",
       .choices = {"warn", "gate"},
       .doc = "what a label cut by the border of the volume means: a failed gate, or a warning"},
  };
}

Error bad_labels(const std::string& field, std::string found) {
  return Error(ExitCode::bad_config, {.where = "parameters",
                                      .field = "labels." + field,
                                      .found = std::move(found),
                                      .allowed = "an id from 1 to 65535, or a list of them, each "
                                                 "under one name",
                                      .remedy = "write for example {liver: 1, tumour: [2, 3]}"});
}

std::vector<Material> parse_materials(const Json& given) {
  std::vector<Material> materials;
  std::map<int, std::string> taken;
  for (const auto& [name, value] : given.items()) {
    Material material{.name = name};
    for (const auto& id : value.is_array() ? value : Json::array({value})) {
      if (!id.is_number_integer() || id < 1 || id > 65535) throw bad_labels(name, id.dump());
      material.ids.push_back(id);
      if (!taken.emplace(id, name).second)
        throw bad_labels(name, fmt::format("id {} also stands under '{}'", id.dump(), taken[id]));
    }
    if (material.ids.empty()) throw bad_labels(name, "no ids");
    materials.push_back(std::move(material));
  }
  if (materials.empty()) throw bad_labels("", "no materials");
  return materials;
}

std::string list_ids(const std::map<int, std::size_t>& present) {
  std::vector<int> ids;
  for (const auto& [id, count] : present) ids.push_back(id);
  return fmt::format("{}", fmt::join(ids, ", "));
}

// The materials asked for, or all that occur.
std::vector<Material> materials_for(const StageRun& run, const LabelImage& image) {
  const auto present = count_labels(image);
  const std::string file = run.input("volume").string();
  if (present.empty()) {
    throw Error(ExitCode::bad_input, {.where = file,
                                      .field = "voxel values",
                                      .found = "all zero",
                                      .allowed = "at least one labelled voxel",
                                      .remedy = "give the segmentation of this patient"});
  }
  if (!run.has_param("labels")) {
    std::vector<Material> all;
    for (const auto& [id, count] : present) {
      const auto name = image.names.find(id);
      all.push_back({name == image.names.end() ? fmt::format("label_{}", id) : name->second, {id}});
    }
    return all;
  }
  const auto materials = parse_materials(run.params().at("labels"));
  for (const auto& material : materials)
    for (const int id : material.ids) {
      if (present.count(id)) continue;
      throw Error(ExitCode::bad_input, {.where = file,
                                        .field = "labels." + material.name,
                                        .found = fmt::format("id {} does not occur", id),
                                        .allowed = "the ids in this file: " + list_ids(present),
                                        .remedy = "correct 'labels', or give another volume"});
    }
  return materials;
}

std::array<int, 3> margin_voxels(const Frame& frame, double pad_mm) {
  std::array<int, 3> margin;
  for (int a = 0; a < 3; ++a)
    margin[a] = std::max(2, static_cast<int>(std::ceil(pad_mm / frame.spacing[a])));
  return margin;
}

Json frame_json(const Frame& frame) {
  return {{"size", frame.size},
          {"spacing_mm", frame.spacing},
          {"origin_lps_mm", frame.origin},
          {"direction", frame.direction}};
}

Json describe_labels(const LabelImage& image, const std::vector<Material>& materials,
                     const std::vector<BorderCut>& cuts) {
  const auto counts = count_labels(image);
  const Components components = find_components(image);
  Json list = Json::array();
  for (const auto& material : materials) {
    const int id = material.ids.front();
    const auto found = counts.find(id);
    const std::size_t voxels = found == counts.end() ? 0 : found->second;
    const auto parts = std::count_if(components.list.begin(), components.list.end(),
                                     [id](const Component& c) { return c.label == id; });
    Json borders = Json::array();
    for (const auto& cut : cuts)
      if (cut.label == id) borders.push_back({{"face", cut.face}, {"area_mm2", cut.area_mm2}});
    list.push_back({{"name", material.name},
                    {"id", id},
                    {"source_ids", material.ids},
                    {"voxels", voxels},
                    {"ml", static_cast<double>(voxels) * image.frame.voxel_volume() / 1000.0},
                    {"components", parts},
                    {"borders", borders}});
  }
  return list;
}

double report_cuts(const LabelImage& image, const std::vector<BorderCut>& cuts) {
  double area = 0.0;
  std::map<int, std::string> faces;
  for (const auto& cut : cuts) {
    auto& list = faces[cut.label];
    list += fmt::format("{}{} {:.0f} mm2", list.empty() ? "" : ", ", cut.face, cut.area_mm2);
    area += cut.area_mm2;
  }
  for (const auto& [id, list] : faces)
    log::warn("{} is cut by the border of the volume: {}", image.names.at(id), list);
  return area;
}

// Restricts the cuts of the whole volume to what survived the cleaning.
std::vector<BorderCut> cuts_of_kept(LabelImage original, const LabelImage& kept,
                                    const std::array<int, 3>& offset) {
  std::fill(original.voxels.begin(), original.voxels.end(), std::uint16_t{0});
  const auto& size = kept.frame.size;
  for (int k = 0; k < size[2]; ++k)
    for (int j = 0; j < size[1]; ++j)
      for (int i = 0; i < size[0]; ++i) {
        const auto id = kept.voxels[kept.frame.index(i, j, k)];
        if (id == 0) continue;
        original.voxels[original.frame.index(i + offset[0], j + offset[1], k + offset[2])] = id;
      }
  return find_border_cuts(original);
}

void report_cleaning(StageRun& run, const Cleaning& cleaning) {
  const std::pair<const char*, const Change*> changes[] = {
      {"specks_absorbed", &cleaning.specks_absorbed},
      {"specks_removed", &cleaning.specks_removed},
      {"cavities_filled", &cleaning.cavities_filled},
      {"bodies_removed", &cleaning.bodies_removed}};
  for (const auto& [name, change] : changes) {
    run.metric(name, change->components);
    run.metric(fmt::format("{}_voxels", name), change->voxels);
    if (change->components > 0)
      log::info("{}: {} components, {} voxels", name, change->components, change->voxels);
  }
}

void run_labels(StageRun& run) {
  auto [image, notes] = read_image(run.input("volume"));
  if (notes.frame_shift_mm > 0.0) {
    log::warn("{}: axes made orthonormal, which moved the corners by up to {:.3g} mm",
              run.input("volume").string(), notes.frame_shift_mm);
  }
  const auto materials = materials_for(run, image);
  select(image, materials);

  Cleaning cleaning;
  std::array<int, 3> offset{}, padding{};
  LabelImage body = crop(image, {1, 1, 1}, offset);
  const double ml_per_voxel = image.frame.voxel_volume() / 1000.0;
  const auto min_voxels =
      static_cast<std::size_t>(std::ceil(run.param<double>("min_component") / ml_per_voxel));
  absorb_specks(body, min_voxels, cleaning);
  if (run.param<std::string>("keep") == "largest") keep_largest_body(body, cleaning);
  const auto left = count_labels(body);
  if (left.empty()) {
    throw Error(ExitCode::bad_input,
                {.where = run.input("volume").string(),
                 .field = "min_component",
                 .found = fmt::format("nothing is left: every component is smaller than {} ml",
                                      run.param<double>("min_component")),
                 .remedy = "lower min_component"});
  }
  for (const auto& material : materials) {
    if (left.count(material.ids.front())) continue;
    log::warn("{}: nothing is left of it after cleaning; lower min_component or keep all bodies",
              material.name);
    body.names.erase(material.ids.front());
  }
  const auto cuts = cuts_of_kept(std::move(image), body, offset);
  const double cut_area = report_cuts(body, cuts);
  const LabelImage result =
      crop(body, margin_voxels(body.frame, run.param<double>("pad")), padding);

  const Json labels = describe_labels(result, materials, cuts);
  write_nrrd(run.out("labels.nrrd"), result);
  write_atomically(run.out("labels.json"),
                   Json{{"labels", labels}, {"frame", frame_json(result.frame)}}.dump(1) + "\n");
  for (const auto& label : labels) {
    log::info("{} (id {}): {:.2f} ml, components: {}", label["name"].get<std::string>(),
              label["id"].get<int>(), label["ml"].get<double>(), label["components"].get<int>());
  }
  run.metric("labels", labels);
  run.metric("pixel_type", notes.pixel_type);
  run.metric("frame_skew", notes.frame_skew);
  run.metric("frame_shift", notes.frame_shift_mm, "mm");
  report_cleaning(run, cleaning);
  run.metric("border_area", cut_area, "mm2");
  if (run.param<std::string>("border") == "gate")
    run.gate("border_area", cut_area, "<=", 0.0, "mm2");
}

}  // namespace

Stage labels_stage() {
  Stage stage;
  stage.info = {.name = "labels",
                .version = "1",
                .doc = "A segmented volume to one clean, cropped label volume.",
                .inputs = {{.role = "volume",
                            .doc = "label volume: NIfTI (.nii, .nii.gz), NRRD or MetaImage"}},
                .outputs = {{"labels.nrrd", "labels", "one id per voxel, cropped, LPS mm"},
                            {"labels.json", "", "names, ids, volumes, components, border cuts"}},
                .params = params(),
                .libraries = {{"ITK", itk::Version::GetITKVersion()}}};
  stage.run = run_labels;
  stage.check = [](const StageRun& run) {
    if (run.has_param("labels")) parse_materials(run.params().at("labels"));
  };
  return stage;
}

}  // namespace viscera
