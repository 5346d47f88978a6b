// Order of work: the asked-for segments are painted in the order of `labels` (which settles
// overlaps), specks are given to their neighbours, the largest body is kept, and the volume is
// cropped to it with a margin of background.
#include "stages/labels/stage.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <itkVersion.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "pipeline/contract/label_name.hpp"
#include "stages/image/image_io.hpp"
#include "stages/image/label_components.hpp"
#include "stages/image/label_facts.hpp"
#include "stages/labels/border.hpp"
#include "stages/labels/bridges.hpp"
#include "stages/labels/clean.hpp"
#include "stages/labels/context.hpp"
#include "stages/labels/segmentation.hpp"

namespace viscera {
namespace {

std::vector<Param> params() {
  return {
      {.name = "labels",
       .type = ParamType::map,
       .fallback = nullptr,
       .doc = "material names and the ids or stored names they are made of, {liver: 1, tumour: [2, "
              "lesion]}; unset: every segment, under its stored name or as label_N"},
      {.name = "overlap",
       .type = ParamType::text,
       .fallback = "last",
       .choices = {"last", "first"},
       .doc =
           "of materials that claim one voxel (layers, masks), which keeps it: the one named last "
           "in labels, or first"},
      quantity("min_component", "0.1 ml", "ml", 0.0, 1000.0,
               "smaller components and holes are given to their neighbours"),
      {.name = "cavities",
       .type = ParamType::text,
       .fallback = "small",
       .choices = {"small", "all"},
       .doc = "holes that are filled: those smaller than min_component, or all"},
      {.name = "keep",
       .type = ParamType::text,
       .fallback = "largest",
       .choices = {"largest", "each", "all"},
       .doc =
           "the largest connected body (all materials together), that of the largest component of "
           "each material, or all"},
      quantity("bridge", "3 mm", "mm", 0.0, 100.0,
               "parts of the body joined by less than this are reported with their places"),
      quantity("pad", "10 mm", "mm", 0.0, 200.0,
               "background left around the body; at least two voxels"),
      border_param(),
  };
}

Error bad_labels(const std::string& field, std::string found) {
  return Error(
      ExitCode::bad_config,
      {.where = "parameters",
       .field = "labels." + field,
       .found = std::move(found),
       .allowed = "an id from 1 to 65535 or a segment's name, or a list of them, each under "
                  "one material",
       .remedy = "write for example {liver: 1, tumour: [2, lesion]}"});
}

// The materials as asked for: whole numbers are ids, texts are names.
using Wanted = std::vector<std::pair<std::string, Json>>;

Wanted parse_wanted(const Json& given) {
  Wanted wanted;
  std::map<Json, std::string> taken;
  for (const auto& [name, value] : given.items()) {
    check_label_name(name, ExitCode::bad_config, "parameters", "labels");
    const Json parts = value.is_array() ? value : Json::array({value});
    for (const auto& part : parts) {
      const bool id = part.is_number_integer() && part >= 1 && part <= max_label_id;
      if (!id && !part.is_string()) throw bad_labels(name, part.dump());
      if (!taken.emplace(part, name).second)
        throw bad_labels(name, fmt::format("{} also stands under '{}'", part.dump(), taken[part]));
    }
    if (parts.empty()) throw bad_labels(name, "no ids");
    wanted.emplace_back(name, parts);
  }
  if (wanted.empty()) throw bad_labels("", "no materials");
  return wanted;
}

std::string list_segments(const Segmentation& segmentation) {
  std::vector<std::string> all;
  for (const auto& s : segmentation.segments) {
    const bool unnamed = s.name == fmt::format("label_{}", s.id);
    all.push_back(unnamed ? std::to_string(s.id) : fmt::format("{} {}", s.id, s.name));
  }
  return fmt::format("{}", fmt::join(all, ", "));
}

// The materials asked for by id or name, or all segments.
std::vector<Material> materials_for(const StageRun& run, const Segmentation& segmentation) {
  std::vector<Material> materials;
  if (!run.has_param("labels")) {
    for (const auto& segment : segmentation.segments) {
      check_label_name(segment.name, ExitCode::bad_input, run.input("volume").string(),
                       fmt::format("name of {}", segment.id));
      const auto same = std::ranges::find(materials, segment.name, &Material::name);
      if (same == materials.end()) {
        materials.push_back({segment.name, {segment.id}});
      } else {  // two lesions, say
        same->ids.push_back(segment.id);
      }
    }
    return materials;
  }
  std::map<int, std::string> taken;
  for (const auto& [name, parts] : parse_wanted(run.params().at("labels"))) {
    Material material{.name = name};
    for (const auto& part : parts) {
      std::vector<int> found;  // several where they have one name
      for (const Segment& s : segmentation.segments)
        if (part.is_string() ? part == s.name : part == s.id) found.push_back(s.id);
      if (found.empty()) {
        throw Error(ExitCode::bad_input,
                    {.where = run.input("volume").string(),
                     .field = "labels." + name,
                     .found = fmt::format("{} {} does not occur", part.is_string() ? "name" : "id",
                                          part.dump()),
                     .allowed = "the segments in this file: " + list_segments(segmentation),
                     .remedy = "correct 'labels', or give another volume"});
      }
      for (const int id : found) {
        if (!taken.emplace(id, name).second)
          throw bad_labels(name, fmt::format("{} also stands under '{}'", part.dump(), taken[id]));
        material.ids.push_back(id);
      }
    }
    materials.push_back(std::move(material));
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

// Bodies that hang together by little: a simulation would fold or tear there.
void report_bridges(StageRun& run, const LabelImage& body, std::size_t min_voxels) {
  const double thickness = run.param<double>("bridge");
  if (thickness <= 0.0) return;
  const auto bridges = find_bridges(body, thickness, min_voxels);
  Json list = Json::array();
  for (const auto& bridge : bridges) {
    list.push_back({{"place_mm", bridge.place},
                    {"area_mm2", bridge.area_mm2},
                    {"smaller_ml", bridge.smaller_ml}});
  }
  run.metric("bridges", list);
  if (bridges.empty()) return;
  const auto& [p, area, ml] = bridges.front();
  log::warn(
      "{} parts of the body hang on bridges thinner than {:.3g} mm, the largest ({:.2f} ml) "
      "near ({:.1f}, {:.1f}, {:.1f}) mm",
      bridges.size(), thickness, ml, p[0], p[1], p[2]);
}

// What several materials claimed, and who kept it.
void report_overlaps(StageRun& run, const LabelImage& image, const std::vector<Overlap>& overlaps) {
  Json list = Json::array();
  for (const auto& overlap : overlaps) {
    const auto &kept = image.names.at(overlap.kept), &lost = image.names.at(overlap.lost);
    log::warn("{} and {} overlap in {} voxels: they go to {}", lost, kept, overlap.voxels, kept);
    list.push_back({{"kept", kept}, {"lost", lost}, {"voxels", overlap.voxels}});
  }
  run.metric("overlaps", list);
}

// Of a label, of which less than this is left out in bodies beside the largest: crumbs.
constexpr double share_worth_a_word = 0.01;

// What `keep` has left out, where it is more than crumbs.
void report_left_out(StageRun& run, const std::map<int, std::size_t>& before,
                     const LabelImage& body) {
  const auto after = count_labels(body);
  const double ml_per_voxel = body.frame.voxel_volume() / 1000.0;
  std::vector<std::string> parts;
  for (const auto& [id, voxels] : before) {
    const auto left = after.find(id);
    const std::size_t lost = voxels - (left == after.end() ? 0 : left->second);
    if (static_cast<double>(lost) < share_worth_a_word * static_cast<double>(voxels)) continue;
    parts.push_back(fmt::format("{:.3g} of {:.3g} ml of {}",
                                ml_per_voxel * static_cast<double>(lost),
                                ml_per_voxel * static_cast<double>(voxels), body.names.at(id)));
  }
  if (parts.empty()) return;
  run.caveat(
      fmt::format("The body is the largest that hangs together, without {}; keep: all takes "
                  "all of it.",
                  fmt::join(parts, ", ")));
}

void clean(StageRun& run, LabelImage& body, std::size_t min_voxels) {
  Cleaning cleaning;
  const auto keep = run.param<std::string>("keep");
  absorb_specks(body, min_voxels, run.param<std::string>("cavities") == "all", cleaning);
  if (keep != "all") {
    const auto before = count_labels(body);
    if (keep == "each") keep_largest_of_each(body, cleaning);
    keep_largest_body(body, cleaning);
    report_left_out(run, before, body);
  }
  report_cleaning(run, cleaning);
}

void run_labels(StageRun& run) {
  const auto segmentation = read_segmentation(run.inputs("volume"));
  const auto [image, labels] = clean_labels(run, segmentation);
  write_nrrd(run.out("labels.nrrd"), image);
  if (run.has_input("image")) pass_on_image(run, image, segmentation.frame_of_reference);
  write_atomically(run.out("labels.json"),
                   Json{{"labels", labels}, {"frame", frame_json(image.frame)}}.dump(1) + "\n");
}

// The labels are cleaned, which takes little more than saying how long it takes; writing them comes
// besides, and passing on the image.
Estimate estimate_labels(StageRun& run, const Expected& before) {
  const auto begin = std::chrono::steady_clock::now();
  const LabelImage image = clean_labels(run, read_segmentation(run.inputs("volume"))).image;
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  Estimate estimate{.wall_low_s = took.count(),
                    .wall_high_s = (run.has_input("image") ? 3.0 : 1.5) * took.count(),
                    .expected = before};
  estimate.expected.take(find_facts(image));
  estimate.words.push_back(fmt::format("{:.4g} ml", estimate.expected.body_ml()));
  return estimate;
}

}  // namespace

CleanLabels clean_labels(StageRun& run, const Segmentation& segmentation) {
  const ImageNotes& notes = segmentation.notes;
  if (notes.repair.shift_mm > 0.0) {
    log::warn("{}: axes made orthonormal, which moved the corners by up to {:.3g} mm",
              run.input("volume").string(), notes.repair.shift_mm);
  }
  const auto materials = materials_for(run, segmentation);
  std::vector<Overlap> overlaps;
  LabelImage image =
      paint(segmentation, materials, run.param<std::string>("overlap") == "last", overlaps);
  report_overlaps(run, image, overlaps);

  std::array<int, 3> offset{}, padding{};
  LabelImage body = crop(image, {1, 1, 1}, offset);
  const double ml_per_voxel = image.frame.voxel_volume() / 1000.0;
  const auto min_voxels =
      static_cast<std::size_t>(std::ceil(run.param<double>("min_component") / ml_per_voxel));
  clean(run, body, min_voxels);
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
    run.caveat(
        fmt::format("Nothing is left of {} after cleaning; a smaller min_component, or "
                    "keep: all, may leave some.",
                    material.name));
    body.names.erase(material.ids.front());
  }
  report_bridges(run, body, min_voxels);
  const auto cuts = cuts_of_kept(std::move(image), body, offset);
  CleanLabels result;
  result.image = crop(body, margin_voxels(body.frame, run.param<double>("pad")), padding);
  result.labels = describe_labels(result.image, materials, cuts);
  for (const auto& label : result.labels) {
    log::info("{} (id {}): {:.2f} ml, components: {}", label["name"].get<std::string>(),
              label["id"].get<int>(), label["ml"].get<double>(), label["components"].get<int>());
  }
  run.metric("labels", result.labels);
  run.metric("pixel_type", notes.pixel_type);
  run.metric("frame_skew", notes.repair.skew);
  run.metric("frame_shift", notes.repair.shift_mm, "mm");
  judge_border(run, body, cuts);
  return result;
}

Stage labels_stage() {
  Stage stage;
  stage.info = {
      .name = "labels",
      .version = "5",
      .doc = "A segmented volume to one clean, cropped label volume.",
      .inputs = {{.role = "volume",
                  .many = true,
                  .doc = "label volume (NIfTI, NRRD with layers, MetaImage), DICOM SEG, "
                         "folder of DICOM masks, or several of these on one grid"},
                 {.role = "image",
                  .required = false,
                  .doc = "the CT that was segmented, for the report: a volume (NIfTI, "
                         "NRRD, MetaImage), or a folder of DICOM planes"}},
      .outputs = {{"labels.nrrd", "labels", "one id per voxel, cropped, LPS mm"},
                  {"image.nrrd", "image", "the CT around the labels, on its own grid, HU"},
                  {"labels.json", "", "names, ids, volumes, components, border cuts"}},
      .params = params(),
      .gates = {border_gate()},
      .libraries = {{"ITK", itk::Version::GetITKVersion()}}};
  stage.run = run_labels;
  stage.estimate = estimate_labels;
  stage.check = [](const StageRun& run) {
    if (run.has_param("labels")) parse_wanted(run.params().at("labels"));
  };
  return stage;
}

}  // namespace viscera
