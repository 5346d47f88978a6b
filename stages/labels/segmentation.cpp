#include "stages/labels/segmentation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "pipeline/contract/manifest.hpp"
#include "stages/image/stored_segments.hpp"
#include "stages/labels/dicom_stack.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

std::vector<std::vector<Run>> runs_by_value(const std::vector<std::uint16_t>& voxels) {
  std::vector<std::vector<Run>> runs(max_label_id + 1);
  for (std::size_t v = 0; v < voxels.size(); ++v)
    if (voxels[v] != 0) extend(runs[voxels[v]], v);
  return runs;
}

std::string unnamed(int value) {
  return fmt::format("label_{}", value);
}

Segmentation from_volume(const fs::path& path) {
  const Volume volume = read_volume(path);
  Segmentation result{.frame = volume.frame, .notes = volume.notes};
  const auto named = stored_segments(volume.header);
  std::set<int> values;
  for (const auto& segment : named) values.insert(segment.value);
  const bool repeated = volume.layers.size() > 1 && values.size() < named.size();
  for (std::size_t layer = 0; layer < volume.layers.size(); ++layer) {
    auto runs = runs_by_value(volume.layers[layer]);
    for (std::size_t s = 0; s < named.size(); ++s) {
      const auto value = static_cast<std::size_t>(named[s].value);
      if (named[s].layer != static_cast<int>(layer) || runs[value].empty()) continue;
      const int id = repeated ? static_cast<int>(s) + 1 : named[s].value;
      result.segments.push_back({id, named[s].name, std::move(runs[value])});
      runs[value].clear();
    }
    for (int value = 1; value <= max_label_id; ++value) {
      if (runs[value].empty()) continue;
      if (volume.layers.size() > 1) {
        throw bad_image(path, "voxel values", fmt::format("{} in layer {}", value, layer),
                        "values that a SegmentN_LabelValue of the header names",
                        "save the segmentation again");
      }
      result.segments.push_back({value, unnamed(value), std::move(runs[value])});
    }
  }
  return result;
}

std::vector<fs::path> sorted_entries(const fs::path& folder) {
  std::vector<fs::path> entries;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with('.') && name != "DICOMDIR") entries.push_back(entry.path());
  }
  std::sort(entries.begin(), entries.end());
  return entries;
}

Segmentation from_planes(const fs::path& path, std::vector<DicomPlane> planes,
                         const std::map<int, std::string>& names) {
  Segmentation result{.frame_of_reference = planes.empty() ? "" : planes[0].frame_of_reference};
  DicomStack stack = stack_planes(std::move(planes), !names.empty());
  result.frame = stack.frame;
  result.notes.pixel_type = names.empty() ? "DICOM masks" : "DICOM segmentation object";
  result.notes.repair = orthonormalise(path, result.frame);
  for (auto& [number, runs] : stack.masks) {
    const auto name = names.find(number);
    result.segments.push_back(
        {number, name == names.end() ? file_name(path.string()) : name->second, std::move(runs)});
  }
  return result;
}

Segmentation from_dicom_folder(const fs::path& folder) {
  std::vector<DicomPlane> planes;
  for (const auto& file : sorted_entries(folder)) {
    DicomFile read = read_dicom(file);
    if (!read.segments.empty() || !fs::is_regular_file(file)) {
      throw bad_image(file, "SOPClassUID", "a segmentation object in a folder of planes",
                      "one plane of a mask a file", "give the object itself");
    }
    std::move(read.planes.begin(), read.planes.end(), std::back_inserter(planes));
  }
  return from_planes(folder, std::move(planes), {});
}

std::string stem(const fs::path& path) {
  std::string name = file_name(path.string());
  return fs::is_directory(path) ? name : name.substr(0, name.find('.'));
}

void check_same_grid(const fs::path& path, const Frame& frame, const Frame& first) {
  double off = 0.0;
  for (const int corner : {0, 1, 2, 4, 7}) {
    std::array<double, 3> p{};
    for (int a = 0; a < 3; ++a) p[a] = corner >> a & 1 ? first.size[a] - 1 : 0;
    std::array<double, 3> in_first = p, in_frame = p;
    for (int a = 0; a < 3; ++a) {
      in_first[a] *= first.spacing[a];
      in_frame[a] *= frame.spacing[a];
    }
    in_first = first.to_lps(in_first);
    in_frame = frame.to_lps(in_frame);
    for (int a = 0; a < 3; ++a) off = std::max(off, std::abs(in_first[a] - in_frame[a]));
  }
  const double allowed = 0.05 * *std::min_element(first.spacing.begin(), first.spacing.end());
  if (frame.size == first.size && off <= allowed) return;
  throw bad_image(path, "grid",
                  fmt::format("{}x{}x{} voxels, corners {:.3g} mm off those of the first volume",
                              frame.size[0], frame.size[1], frame.size[2], off),
                  "volumes on one grid", "resample them onto one grid");
}

// Sources side by side, ids numbered anew.
Segmentation join(const std::vector<fs::path>& paths, std::vector<Segmentation> parts) {
  Segmentation result{.frame = parts.front().frame,
                      .notes = parts.front().notes,
                      .frame_of_reference = parts.front().frame_of_reference};
  for (std::size_t p = 0; p < parts.size(); ++p) {
    check_same_grid(paths[p], parts[p].frame, result.frame);
    if (parts[p].notes.repair.shift_mm > result.notes.repair.shift_mm)
      result.notes.repair = parts[p].notes.repair;
    const bool named_by_file =
        parts[p].segments.size() == 1 && parts[p].segments[0].name.starts_with("label_");
    for (auto& segment : parts[p].segments) {
      if (named_by_file) segment.name = stem(paths[p]);
      segment.id = static_cast<int>(result.segments.size()) + 1;
      result.segments.push_back(std::move(segment));
    }
  }
  return result;
}

Segmentation from_folder(const fs::path& folder) {
  const auto entries = sorted_entries(folder);
  if (entries.empty())
    throw bad_image(folder, "", "an empty folder", "DICOM files, or a folder per mask", "");
  if (!fs::is_directory(entries.front())) return from_dicom_folder(folder);
  std::vector<Segmentation> parts;
  for (const auto& entry : entries) {
    if (!fs::is_directory(entry)) {
      throw bad_image(entry, "", "a file beside folders", "a folder per mask, nothing else",
                      "take it out of the folder");
    }
    parts.push_back(from_dicom_folder(entry));
  }
  return join(entries, std::move(parts));
}

Segmentation read_source(const fs::path& path) {
  if (fs::is_directory(path)) return from_folder(path);
  if (!is_dicom(path)) return from_volume(path);
  DicomFile file = read_dicom(path);
  if (file.segments.empty()) {
    throw bad_image(path, "SOPClassUID", "a single plane", "a segmentation object (DICOM SEG)",
                    "give the folder of the series");
  }
  return from_planes(path, std::move(file.planes), file.segments);
}

Segmentation only_filled(const fs::path& called, Segmentation segmentation) {
  auto& segments = segmentation.segments;
  std::erase_if(segments, [](const Segment& s) { return s.runs.empty(); });
  std::stable_sort(segments.begin(), segments.end(),
                   [](const Segment& a, const Segment& b) { return a.id < b.id; });
  if (!segments.empty()) return segmentation;
  throw bad_image(called, "voxel values", "all zero", "at least one labelled voxel",
                  "give the segmentation of this patient");
}

}  // namespace

Segmentation read_segmentation(const std::vector<fs::path>& sources) {
  std::vector<Segmentation> parts;
  for (const auto& source : sources) parts.push_back(read_source(source));
  return only_filled(sources.front(), sources.size() == 1 ? std::move(parts.front())
                                                          : join(sources, std::move(parts)));
}

Segmentation segmentation_of(const LabelImage& image, const fs::path& called) {
  Segmentation result{.frame = image.frame};
  auto runs = runs_by_value(image.voxels);
  for (int value = 1; value <= max_label_id; ++value) {
    const auto name = image.names.find(value);
    result.segments.push_back(
        {value, name == image.names.end() ? unnamed(value) : name->second, std::move(runs[value])});
  }
  return only_filled(called, std::move(result));
}

LabelImage paint(const Segmentation& segmentation, const std::vector<Material>& materials,
                 bool last_wins, std::vector<Overlap>& overlaps) {
  LabelImage image{.frame = segmentation.frame};
  image.voxels.assign(image.frame.voxels(), 0);
  std::map<std::pair<int, int>, std::size_t> claimed;  // kept, lost
  for (const auto& material : materials) {
    const int id = material.ids.front();
    image.names[id] = material.name;
    for (const auto& segment : segmentation.segments) {
      if (!std::count(material.ids.begin(), material.ids.end(), segment.id)) continue;
      for (const Run& run : segment.runs)
        for (std::size_t v = run.begin; v < std::size_t{run.begin} + run.count; ++v) {
          const int before = image.voxels[v];
          if (before != 0 && before != id) {
            ++claimed[last_wins ? std::pair(id, before) : std::pair(before, id)];
            if (!last_wins) continue;
          }
          image.voxels[v] = static_cast<std::uint16_t>(id);
        }
    }
  }
  for (const auto& [pair, voxels] : claimed) overlaps.push_back({pair.first, pair.second, voxels});
  return image;
}

}  // namespace viscera
