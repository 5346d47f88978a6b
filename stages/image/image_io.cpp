#include "stages/image/image_io.hpp"

#include <fmt/format.h>
#include <itkImageFileReader.h>
#include <itkImageFileWriter.h>
#include <itkMetaDataObject.h>
#include <itkMetaImageIO.h>
#include <itkNrrdImageIO.h>
#include <itkVectorImage.h>
#include <nifti1_io.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <sstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/contract/label_name.hpp"
#include "stages/image/stored_segments.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

constexpr const char* label_prefix = "label_";

// The sentence that matters in ITK's exceptions, which open with a file, a line and an address.
std::string reason(const itk::ExceptionObject& e) {
  std::string text = e.GetDescription();
  const auto address = text.find("): ");
  if (address != std::string::npos) text = text.substr(address + 3);
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.front()))) text.erase(0, 1);
  return text.substr(0, text.find('\n'));
}

Error unreadable(const fs::path& path, const std::string& why) {
  return bad_image(path, "", "cannot be read: " + why, image_formats,
                   "export the volume again, or copy the file again");
}

// MetaImage only prints that data are missing and goes on with zeros: what it prints is read here.
class Muted {
 public:
  Muted() : before_(std::cerr.rdbuf(text_.rdbuf())) {}
  ~Muted() { std::cerr.rdbuf(before_); }
  Muted(const Muted&) = delete;
  Muted& operator=(const Muted&) = delete;
  bool says(const char* words) const { return text_.str().find(words) != std::string::npos; }

 private:
  std::ostringstream text_;
  std::streambuf* before_;
};

// Label ids from stored numbers, whatever their type.
template <class Value>
std::vector<std::uint16_t> to_ids(const fs::path& path, std::size_t count, Value value_at) {
  std::vector<std::uint16_t> ids(count);
  for (std::size_t v = 0; v < count; ++v) {
    const float value = value_at(v);
    if (!(value >= 0.0f && value <= static_cast<float>(max_label_id)) ||
        value != std::floor(value)) {
      throw bad_image(path, "voxel values", fmt::format("{} at voxel {}", value, v),
                      fmt::format("whole numbers from 0 to {}", max_label_id),
                      "give a segmentation (labels), not the CT or a probability map");
    }
    ids[v] = static_cast<std::uint16_t>(value);
  }
  return ids;
}

// A library's reading of the header must be ours, which was held against the file.
void check_agreement(const fs::path& path, const ImageHeader& header,
                     const std::array<int, 3>& size, std::size_t layers) {
  if (size == header.size && layers == static_cast<std::size_t>(header.layers)) return;
  throw unreadable(
      path, fmt::format("its size is read as {}x{}x{}x{}", size[0], size[1], size[2], layers));
}

// What a file stores, taken layer by layer: keep(count, value_at) is called for each, with the
// number of voxels and a function from a voxel to its value as float. Every id is exact as a float,
// and whatever a float would round is refused as no id.
template <class Keep>
Frame read_with_itk(const fs::path& path, const ImageHeader& header, const Keep& keep) {
  using Image = itk::VectorImage<float, 3>;
  itk::ImageIOBase::Pointer io = itk::NrrdImageIO::New();
  if (header.format == ImageFormat::meta) io = itk::MetaImageIO::New();
  io->SetFileName(path.string());
  io->ReadImageInformation();
  std::array<int, 3> size{1, 1, 1};
  for (unsigned a = 0; a < std::min(io->GetNumberOfDimensions(), 3u); ++a)
    size[a] = static_cast<int>(io->GetDimensions(a));
  check_agreement(path, header, size, io->GetNumberOfComponents());
  auto reader = itk::ImageFileReader<Image>::New();
  reader->SetFileName(path.string());
  reader->SetImageIO(io);
  const Muted printed;
  reader->Update();
  if (printed.says("not read completely")) throw unreadable(path, "its data end too early");
  const Image& image = *reader->GetOutput();
  Frame frame;
  frame.size = size;
  for (unsigned a = 0; a < 3; ++a) {
    frame.spacing[a] = image.GetSpacing()[a];
    frame.origin[a] = image.GetOrigin()[a];
    for (unsigned c = 0; c < 3; ++c) frame.direction[3 * a + c] = image.GetDirection()(a, c);
  }
  const auto layers = static_cast<std::size_t>(header.layers);
  for (std::size_t layer = 0; layer < layers; ++layer) {
    keep(frame.voxels(),
         [&](std::size_t v) { return image.GetBufferPointer()[v * layers + layer]; });
  }
  return frame;
}

template <class Stored, class Keep>
void keep_nifti(const nifti_image& image, const Keep& keep) {
  const auto* values = static_cast<const Stored*>(image.data);
  const double slope = image.scl_slope == 0.0f ? 1.0 : image.scl_slope;
  const double offset = image.scl_slope == 0.0f ? 0.0 : image.scl_inter;
  keep(image.nvox, [&](std::size_t v) {
    return static_cast<float>(slope * static_cast<double>(values[v]) + offset);
  });
}

template <class Keep>
void keep_nifti(const nifti_image& image, const Keep& keep) {
  switch (image.datatype) {
    case NIFTI_TYPE_UINT8:
      return keep_nifti<std::uint8_t>(image, keep);
    case NIFTI_TYPE_INT8:
      return keep_nifti<std::int8_t>(image, keep);
    case NIFTI_TYPE_UINT16:
      return keep_nifti<std::uint16_t>(image, keep);
    case NIFTI_TYPE_INT16:
      return keep_nifti<std::int16_t>(image, keep);
    case NIFTI_TYPE_UINT32:
      return keep_nifti<std::uint32_t>(image, keep);
    case NIFTI_TYPE_INT32:
      return keep_nifti<std::int32_t>(image, keep);
    case NIFTI_TYPE_UINT64:
      return keep_nifti<std::uint64_t>(image, keep);
    case NIFTI_TYPE_INT64:
      return keep_nifti<std::int64_t>(image, keep);
    case NIFTI_TYPE_FLOAT32:
      return keep_nifti<float>(image, keep);
    default:
      return keep_nifti<double>(image, keep);
  }
}

// Millimetres per unit of a NIfTI header; one that names no unit means millimetres.
double mm_per_unit(int units) {
  if (units == NIFTI_UNITS_METER) return 1e3;
  return units == NIFTI_UNITS_MICRON ? 1e-3 : 1.0;
}

// NIfTI's own library: its axes need not be orthonormal there, which ITK refuses.
template <class Keep>
Frame read_with_niftilib(const fs::path& path, const ImageHeader& header, const Keep& keep) {
  nifti_set_debug_level(0);  // it prints what is told here by exceptions
  const std::unique_ptr<nifti_image, decltype(&nifti_image_free)> nifti(
      nifti_image_read(path.c_str(), 1), nifti_image_free);
  if (!nifti) throw unreadable(path, "NIfTI header or data incomplete");
  Frame frame;
  frame.size = {nifti->nx, nifti->ny, nifti->nz};
  check_agreement(path, header, frame.size, nifti->nvox / header.voxels());
  const mat44 affine = nifti->sform_code > 0 ? nifti->sto_xyz : nifti->qto_xyz;
  const double scale = mm_per_unit(nifti->xyz_units);
  for (int c = 0; c < 3; ++c) {
    double length = 0.0;
    for (int r = 0; r < 3; ++r) length = std::hypot(length, affine.m[r][c]);
    frame.spacing[c] = length * scale;
    for (int r = 0; r < 3; ++r) {
      const double lps = r < 2 ? -1.0 : 1.0;
      frame.direction[3 * r + c] = lps * affine.m[r][c] / length;
      frame.origin[r] = lps * affine.m[r][3] * scale;
    }
  }
  keep_nifti(*nifti, keep);
  return frame;
}

template <class Keep>
Frame read_layers(const fs::path& path, const ImageHeader& header, const Keep& keep) {
  try {
    return header.format == ImageFormat::nifti ? read_with_niftilib(path, header, keep)
                                               : read_with_itk(path, header, keep);
  } catch (const itk::ExceptionObject& e) {
    throw unreadable(path, reason(e));
  }
}

template <class Stored, class Value>
void write_as(const fs::path& path, const Frame& frame, const std::vector<Value>& values,
              const std::map<int, std::string>& names) {
  using Image = itk::Image<Stored, 3>;
  auto image = Image::New();
  typename Image::SizeType size;
  typename Image::DirectionType direction;
  for (unsigned a = 0; a < 3; ++a) {
    size[a] = static_cast<itk::SizeValueType>(frame.size[a]);
    for (unsigned c = 0; c < 3; ++c) direction(a, c) = frame.direction[3 * a + c];
  }
  image->SetRegions(typename Image::RegionType(size));
  image->SetSpacing(frame.spacing.data());
  image->SetOrigin(frame.origin.data());
  image->SetDirection(direction);
  image->Allocate();
  std::transform(values.begin(), values.end(), image->GetBufferPointer(),
                 [](Value value) { return static_cast<Stored>(value); });
  auto io = itk::NrrdImageIO::New();
  for (const auto& [id, name] : names)
    itk::EncapsulateMetaData(image->GetMetaDataDictionary(), fmt::format("{}{}", label_prefix, id),
                             name);
  auto writer = itk::ImageFileWriter<Image>::New();
  writer->SetFileName(path.string());
  writer->SetImageIO(io);
  writer->SetInput(image);
  writer->UseCompressionOn();
  try {
    writer->Update();
  } catch (const itk::ExceptionObject& e) {
    throw Error(ExitCode::usage,
                {.where = path.string(),
                 .found = "cannot be written: " + reason(e),
                 .remedy = "check the folder's permissions and the space left on the disk"});
  }
}

}  // namespace

Volume read_volume(const fs::path& path) {
  Volume volume{.header = read_image_header(path)};
  volume.frame = read_layers(path, volume.header, [&](std::size_t count, const auto& value_at) {
    volume.layers.push_back(to_ids(path, count, value_at));
  });
  volume.notes.pixel_type = volume.header.pixel_type;
  volume.notes.repair = orthonormalise(path, volume.frame);
  return volume;
}

ScalarImage read_scalar_image(const fs::path& path) {
  const ImageHeader header = read_image_header(path);
  if (header.layers > 1) {
    throw bad_image(path, "sizes", fmt::format("{} layers", header.layers), "one",
                    "export one volume, one number per voxel");
  }
  ScalarImage result;
  result.frame = read_layers(path, header, [&](std::size_t count, const auto& value_at) {
    result.values.resize(count);
    for (std::size_t v = 0; v < count; ++v) result.values[v] = value_at(v);
  });
  orthonormalise(path, result.frame);
  return result;
}

ReadImage read_image(const fs::path& path) {
  Volume volume = read_volume(path);
  if (volume.layers.size() > 1) {
    throw bad_image(path, "sizes", fmt::format("{} layers", volume.layers.size()), "one",
                    "let viscera-labels settle the overlaps first");
  }
  ReadImage result{.image = {.frame = volume.frame, .voxels = std::move(volume.layers.front())},
                   .notes = volume.notes};
  for (const auto& segment : stored_segments(volume.header)) {
    check_label_name(segment.name, ExitCode::bad_input, path.string(),
                     fmt::format("name of {}", segment.value));
    result.image.names[segment.value] = segment.name;
  }
  return result;
}

Frame as_read_back(Frame frame) {
  for (int a = 0; a < 3; ++a) {
    std::array<double, 3> axis;
    double squared = 0.0;
    for (int r = 0; r < 3; ++r) {
      axis[r] = frame.spacing[a] * frame.direction[3 * r + a];
      squared += axis[r] * axis[r];
    }
    frame.spacing[a] = std::sqrt(squared);
    for (int r = 0; r < 3; ++r) frame.direction[3 * r + a] = (1.0 / frame.spacing[a]) * axis[r];
  }
  return frame;
}

std::optional<std::size_t> voxel_at(const Frame& frame, const std::array<double, 3>& lps) {
  const auto p = frame.from_lps(lps);
  std::array<int, 3> at{};
  for (int a = 0; a < 3; ++a) {
    const double index = std::floor(p[a] / frame.spacing[a] + 0.5);
    if (!(index >= 0.0 && index < frame.size[a])) return std::nullopt;
    at[a] = static_cast<int>(index);
  }
  return frame.index(at[0], at[1], at[2]);
}

void write_nrrd(const fs::path& path, const LabelImage& image) {
  const bool small = std::all_of(image.voxels.begin(), image.voxels.end(),
                                 [](std::uint16_t id) { return id <= 255; });
  small ? write_as<std::uint8_t>(path, image.frame, image.voxels, image.names)
        : write_as<std::uint16_t>(path, image.frame, image.voxels, image.names);
}

void write_nrrd(const fs::path& path, const ScalarImage& image) {
  const bool whole = std::all_of(image.values.begin(), image.values.end(), [](float value) {
    return value == std::floor(value) && std::abs(value) <= 32767.0f;
  });
  whole ? write_as<std::int16_t>(path, image.frame, image.values, {})
        : write_as<float>(path, image.frame, image.values, {});
}

}  // namespace viscera
