#include "stages/common/image_io.hpp"

#include <fmt/format.h>
#include <itkImageFileReader.h>
#include <itkImageFileWriter.h>
#include <itkImageIOFactory.h>
#include <itkMetaDataObject.h>
#include <itkNrrdImageIO.h>
#include <nifti1_io.h>
#include <zlib.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <span>
#include <sstream>

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/error.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t max_voxels = std::size_t{1} << 29;
constexpr int max_id = 65535;
constexpr const char* formats =
    "a whole NIfTI (.nii, .nii.gz), NRRD (.nrrd) or MetaImage (.mha, .mhd)";
constexpr const char* label_prefix = "label_";

using Matrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

Error bad_image(const fs::path& path, std::string field, std::string found, std::string allowed,
                std::string remedy) {
  return Error(ExitCode::bad_input, {.where = path.string(),
                                     .field = std::move(field),
                                     .found = std::move(found),
                                     .allowed = std::move(allowed),
                                     .remedy = std::move(remedy)});
}

// The sentence that matters in ITK's exceptions, which open with a file, a line and an address.
std::string reason(const itk::ExceptionObject& e) {
  std::string text = e.GetDescription();
  const auto address = text.find("): ");
  if (address != std::string::npos) text = text.substr(address + 3);
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.front()))) text.erase(0, 1);
  return text.substr(0, text.find('\n'));
}

Error unreadable(const fs::path& path, const std::string& why) {
  return bad_image(path, "", "cannot be read: " + why, formats,
                   "export the volume again, or copy the file again");
}

// ITK takes what a cut-off gzip file still yields for the whole: read to its end first.
void check_gzip(const fs::path& path) {
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(gzopen(path.c_str(), "rb"), gzclose);
  std::vector<char> buffer(1 << 18);
  int count = 1;
  while (file && count > 0) count = gzread(file.get(), buffer.data(), 1 << 18);
  int error = Z_OK;
  const std::string why = file ? gzerror(file.get(), &error) : "it cannot be opened";
  if (!file || count < 0 || error != Z_OK) throw unreadable(path, "truncated or damaged: " + why);
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

std::string pixel_type(const itk::ImageIOBase& io) {
  using T = itk::CommonEnums::IOComponent;
  switch (io.GetComponentType()) {
    case T::UCHAR:
      return "uint8";
    case T::CHAR:
      return "int8";
    case T::USHORT:
      return "uint16";
    case T::SHORT:
      return "int16";
    case T::FLOAT:
      return "float32";
    case T::DOUBLE:
      return "float64";
    default:
      return io.GetComponentTypeAsString(io.GetComponentType());
  }
}

// A 3D scalar volume of bearable size, judged from the header before anything is allocated.
void check_header(const fs::path& path, const itk::ImageIOBase& io) {
  const auto refuse = [&path](std::string field, std::string found, std::string allowed) {
    throw bad_image(path, std::move(field), std::move(found), std::move(allowed),
                    "export one volume, one number per voxel");
  };
  const unsigned dimensions = io.GetNumberOfDimensions();
  std::size_t voxels = 1;
  for (unsigned d = 0; d < dimensions; ++d) {
    const auto size = io.GetDimensions(d);
    if (d >= 3 && size != 1)
      refuse("dimensions", fmt::format("axis {} has {}", d, size), "three axes");
    if (size == 0 || size > max_voxels || voxels * size > max_voxels) {
      refuse("dimensions", fmt::format("axis {} has {} voxels", d, size),
             fmt::format("1 to {} voxels in all", max_voxels));
    }
    voxels *= size;
    if (d < 3 && !(std::isfinite(io.GetSpacing(d)) && io.GetSpacing(d) > 0.0))
      refuse("spacing", fmt::format("{} on axis {}", io.GetSpacing(d), d), "positive mm");
    if (d < 3 && !std::isfinite(io.GetOrigin(d)))
      refuse("origin", fmt::format("{} on axis {}", io.GetOrigin(d), d), "finite mm");
  }
  if (dimensions < 3) refuse("dimensions", fmt::format("{} axes", dimensions), "three axes");
  if (io.GetNumberOfComponents() != 1)
    refuse("components", fmt::format("{}", io.GetNumberOfComponents()), "one number per voxel");
}

// Label ids from stored numbers, whatever their type: every id is exact as a float, and whatever a
// float would round is refused as no id.
std::vector<std::uint16_t> to_ids(const fs::path& path, std::span<const float> values) {
  std::vector<std::uint16_t> ids(values.size());
  for (std::size_t v = 0; v < values.size(); ++v) {
    const float value = values[v];
    if (!(value >= 0.0f && value <= static_cast<float>(max_id)) || value != std::floor(value)) {
      throw bad_image(path, "voxel values", fmt::format("{} at voxel {}", value, v),
                      fmt::format("whole numbers from 0 to {}", max_id),
                      "give a segmentation (labels), not the CT or a probability map");
    }
    ids[v] = static_cast<std::uint16_t>(value);
  }
  return ids;
}

std::map<int, std::string> names_in(const itk::MetaDataDictionary& dictionary) {
  std::map<int, std::string> names;
  for (const auto& key : dictionary.GetKeys()) {
    if (key.rfind(label_prefix, 0) != 0) continue;
    const std::string digits = key.substr(std::string(label_prefix).size());
    std::string name;
    if (digits.empty() || digits.size() > 5 ||
        digits.find_first_not_of("0123456789") != std::string::npos ||
        !itk::ExposeMetaData(dictionary, key, name)) {
      continue;
    }
    names[std::stoi(digits)] = name;
  }
  return names;
}

// A volume as it was stored.
struct Volume {
  using Image = itk::Image<float, 3>;
  Frame frame;
  Image::Pointer image;
  std::map<int, std::string> names;
  ImageNotes notes;

  std::span<const float> values() const { return {image->GetBufferPointer(), frame.voxels()}; }
};

Volume read_with(const fs::path& path, itk::ImageIOBase& io) {
  io.SetFileName(path.string());
  io.ReadImageInformation();
  check_header(path, io);
  Volume result;
  auto reader = itk::ImageFileReader<Volume::Image>::New();
  reader->SetFileName(path.string());
  reader->SetImageIO(&io);
  reader->Update();
  result.image = reader->GetOutput();
  const Volume::Image& image = *result.image;
  const auto size = image.GetLargestPossibleRegion().GetSize();
  for (unsigned a = 0; a < 3; ++a) {
    result.frame.size[a] = static_cast<int>(size[a]);
    result.frame.spacing[a] = image.GetSpacing()[a];
    result.frame.origin[a] = image.GetOrigin()[a];
    for (unsigned c = 0; c < 3; ++c) result.frame.direction[3 * a + c] = image.GetDirection()(a, c);
  }
  result.names = names_in(io.GetMetaDataDictionary());
  return result;
}

using NiftiImage = std::unique_ptr<nifti_image, decltype(&nifti_image_free)>;

// Millimetres per unit of a NIfTI header; one that names no unit means millimetres.
double mm_per_unit(int units) {
  if (units == NIFTI_UNITS_METER) return 1e3;
  return units == NIFTI_UNITS_MICRON ? 1e-3 : 1.0;
}

// ITK refuses NIfTI files whose sform is not orthonormal to its taste. The voxels are then read
// from a copy without an orientation, and the axes taken from the sform as they are.
Volume read_skewed_nifti(const fs::path& path, itk::ImageIOBase& io) {
  const NiftiImage nifti(nifti_image_read(path.c_str(), 1), nifti_image_free);
  if (!nifti) throw unreadable(path, "NIfTI header or data incomplete");
  const mat44 affine = nifti->sform_code > 0 ? nifti->sto_xyz : nifti->qto_xyz;
  const double scale = mm_per_unit(nifti->xyz_units);
  nifti->sform_code = nifti->qform_code = 0;
  const TemporaryFolder folder(fs::temp_directory_path());
  const fs::path copy = folder.path() / "volume.nii";
  if (nifti_set_filenames(nifti.get(), copy.c_str(), 0, 1) != 0)
    throw unreadable(path, "no temporary copy could be made");
  nifti->nifti_type = NIFTI_FTYPE_NIFTI1_1;
  nifti_image_write(nifti.get());
  Volume volume = read_with(copy, io);
  for (int c = 0; c < 3; ++c) {
    double length = 0.0;
    for (int r = 0; r < 3; ++r) length = std::hypot(length, affine.m[r][c]);
    volume.frame.spacing[c] = length * scale;
    for (int r = 0; r < 3; ++r) {
      const double lps = r < 2 ? -1.0 : 1.0;
      volume.frame.direction[3 * r + c] = lps * affine.m[r][c] / length;
      volume.frame.origin[r] = lps * affine.m[r][3] * scale;
    }
  }
  return volume;
}

// Replaces the axes by the nearest orthonormal ones; the centre of the volume stays where it is.
void orthonormalise(const fs::path& path, Frame& frame, ImageNotes& notes) {
  Eigen::Map<Matrix> axes(frame.direction.data());
  if (!axes.allFinite() || !(std::abs(axes.determinant()) > 1e-6)) {
    throw bad_image(path, "direction", "axes that span no volume", "three orthonormal axes",
                    "export the volume again with a valid orientation");
  }
  notes.frame_skew = (axes.transpose() * axes - Matrix::Identity()).cwiseAbs().maxCoeff();
  if (notes.frame_skew < 1e-6) return;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(Eigen::Matrix3d(axes),
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d nearest = svd.matrixU() * svd.matrixV().transpose();
  const Eigen::Matrix3d change = nearest - Eigen::Matrix3d(axes);
  Eigen::Vector3d half;
  for (int a = 0; a < 3; ++a) half[a] = 0.5 * (frame.size[a] - 1) * frame.spacing[a];
  for (int corner = 0; corner < 4; ++corner) {
    const Eigen::Vector3d p(half[0], corner & 1 ? half[1] : -half[1],
                            corner & 2 ? half[2] : -half[2]);
    notes.frame_shift_mm = std::max(notes.frame_shift_mm, (change * p).norm());
  }
  const double allowed = 0.5 * *std::max_element(frame.spacing.begin(), frame.spacing.end());
  if (notes.frame_shift_mm > allowed) {
    throw bad_image(
        path, "direction",
        fmt::format("axes are not orthonormal: repairing them moves a corner by {:.3g} mm",
                    notes.frame_shift_mm),
        fmt::format("at most half a voxel ({:.3g} mm)", allowed),
        "resample the volume onto an orthogonal grid");
  }
  Eigen::Map<Eigen::Vector3d>(frame.origin.data()) -= change * half;
  axes = nearest;
}

bool is_orientation_refusal(const itk::ExceptionObject& e) {
  return std::string(e.GetDescription()).find("orthonormal") != std::string::npos;
}

template <class Id>
void write_as(const fs::path& path, const LabelImage& labels) {
  using Image = itk::Image<Id, 3>;
  auto image = Image::New();
  typename Image::SizeType size;
  typename Image::DirectionType direction;
  for (unsigned a = 0; a < 3; ++a) {
    size[a] = static_cast<itk::SizeValueType>(labels.frame.size[a]);
    for (unsigned c = 0; c < 3; ++c) direction(a, c) = labels.frame.direction[3 * a + c];
  }
  image->SetRegions(typename Image::RegionType(size));
  image->SetSpacing(labels.frame.spacing.data());
  image->SetOrigin(labels.frame.origin.data());
  image->SetDirection(direction);
  image->Allocate();
  std::transform(labels.voxels.begin(), labels.voxels.end(), image->GetBufferPointer(),
                 [](std::uint16_t id) { return static_cast<Id>(id); });
  auto io = itk::NrrdImageIO::New();
  for (const auto& [id, name] : labels.names)
    itk::EncapsulateMetaData(image->GetMetaDataDictionary(), fmt::format("{}{}", label_prefix, id),
                             name);
  auto writer = itk::ImageFileWriter<Image>::New();
  writer->SetFileName(path.string());
  writer->SetImageIO(io);
  writer->SetInput(image);
  writer->UseCompressionOn();
  writer->Update();
}

Volume read_volume(const fs::path& path) {
  const itk::ImageIOBase::Pointer io =
      fs::is_regular_file(path)
          ? itk::ImageIOFactory::CreateImageIO(path.c_str(), itk::CommonEnums::IOFileMode::ReadMode)
          : nullptr;
  if (io == nullptr) {
    throw bad_image(path, "", fs::exists(path) ? "not an image that is known here" : "no such file",
                    formats, "check the path, or convert the volume to one of these formats");
  }
  Volume result;
  if (path.extension() == ".gz") check_gzip(path);
  const Muted printed;
  try {
    try {
      result = read_with(path, *io);
    } catch (const itk::ExceptionObject& e) {
      if (!is_orientation_refusal(e)) throw;
      result = read_skewed_nifti(path, *io);
    }
  } catch (const itk::ExceptionObject& e) {
    throw unreadable(path, reason(e));
  }
  if (printed.says("not read completely")) throw unreadable(path, "its data end too early");
  result.notes.pixel_type = pixel_type(*io);
  orthonormalise(path, result.frame, result.notes);
  return result;
}

}  // namespace

ReadImage read_image(const fs::path& path) {
  Volume volume = read_volume(path);
  return {{volume.frame, to_ids(path, volume.values()), std::move(volume.names)}, volume.notes};
}

ScalarImage read_scalar_image(const fs::path& path) {
  const Volume volume = read_volume(path);
  const auto values = volume.values();
  return {volume.frame, {values.begin(), values.end()}};
}

void write_nrrd(const fs::path& path, const LabelImage& image) {
  const bool small = std::all_of(image.voxels.begin(), image.voxels.end(),
                                 [](std::uint16_t id) { return id <= 255; });
  try {
    small ? write_as<std::uint8_t>(path, image) : write_as<std::uint16_t>(path, image);
  } catch (const itk::ExceptionObject& e) {
    throw Error(ExitCode::usage,
                {.where = path.string(),
                 .found = "cannot be written: " + reason(e),
                 .remedy = "check the folder's permissions and the space left on the disk"});
  }
}

}  // namespace viscera
