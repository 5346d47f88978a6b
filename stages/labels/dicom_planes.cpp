#include "stages/labels/dicom_planes.hpp"

// clang-format off: DCMTK's configuration comes first
#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dcrledrg.h>
#include <dcmtk/dcmdata/dctk.h>
#include <dcmtk/dcmjpeg/djdecode.h>
#include <dcmtk/dcmjpls/djdecode.h>
#include <dcmtk/oflog/oflog.h>
// clang-format on
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>

#include "stages/image/image_header.hpp"
#include "stages/labels/dicom_walk.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t max_pixels = std::uint64_t{1} << 29;
constexpr std::uint64_t max_expanded = std::uint64_t{1} << 24;  // pixels of one compressed plane

struct Syntax {
  const char* uid;
  bool explicit_vr, big_endian, compressed;
};

// Lossy ones would change what is measured; deflated ones may expand a thousandfold.
constexpr Syntax syntaxes[] = {
    {UID_LittleEndianImplicitTransferSyntax, false, false, false},
    {UID_LittleEndianExplicitTransferSyntax, true, false, false},
    {UID_BigEndianExplicitTransferSyntax, true, true, false},
    {UID_RLELosslessTransferSyntax, true, false, true},
    {UID_JPEGProcess14TransferSyntax, true, false, true},
    {UID_JPEGProcess14SV1TransferSyntax, true, false, true},
    {UID_JPEGLSLosslessTransferSyntax, true, false, true},
};

// The attributes of one file, read with names in errors.
class Attributes {
 public:
  Attributes(const fs::path& path, DcmItem& item) : path_(path), item_(item) {}

  [[noreturn]] void refuse(const DcmTagKey& key, std::string found, std::string allowed) const {
    throw bad_image(path_, DcmTag(key).getTagName(), std::move(found), std::move(allowed),
                    "export it again, uncompressed");
  }
  bool has(const DcmTagKey& key) const { return item_.tagExistsWithValue(key); }
  std::string text(const DcmTagKey& key) const {
    OFString value;
    item_.findAndGetOFString(key, value);
    return {value.c_str(), value.size()};
  }
  int integer(const DcmTagKey& key, int lo, int hi) const {
    Uint16 small = 0;
    Uint32 large = 0;
    Sint32 value = -1;
    if (item_.findAndGetUint16(key, small).good()) {
      value = small;
    } else if (item_.findAndGetUint32(key, large).good()) {
      value = large > static_cast<Uint32>(hi) ? -1 : static_cast<Sint32>(large);
    } else if (item_.findAndGetSint32(key, value).bad())
      refuse(key, "missing, or no number", fmt::format("{} to {}", lo, hi));
    if (value < lo || value > hi)
      refuse(key, fmt::format("{}", value), fmt::format("{} to {}", lo, hi));
    return value;
  }
  template <std::size_t N>
  std::array<double, N> reals(const DcmTagKey& key) const {
    std::array<double, N> values{};
    for (std::size_t i = 0; i < N; ++i) {
      const auto read = item_.findAndGetFloat64(key, values[i], static_cast<unsigned long>(i));
      if (read.bad() || !std::isfinite(values[i]))
        refuse(key, "missing, or not a finite number", fmt::format("{} numbers", N));
    }
    return values;
  }
  std::array<double, 2> spacing() const {
    const auto values = reals<2>(DCM_PixelSpacing);
    if (!(values[0] > 0.0 && values[1] > 0.0))
      refuse(DCM_PixelSpacing, fmt::format("{}\\{}", values[0], values[1]), "positive mm");
    return values;
  }
  std::array<double, 6> orientation() const {
    const auto o = reals<6>(DCM_ImageOrientationPatient);
    const double row = std::hypot(o[0], o[1], o[2]), column = std::hypot(o[3], o[4], o[5]);
    const double dot = o[0] * o[3] + o[1] * o[4] + o[2] * o[5];
    if (!(std::abs(row - 1) < 0.01 && std::abs(column - 1) < 0.01 && std::abs(dot) < 0.01)) {
      refuse(DCM_ImageOrientationPatient, text(DCM_ImageOrientationPatient) + "…",
             "two directions of length one at a right angle");
    }
    return o;
  }
  DcmSequenceOfItems& sequence(const DcmTagKey& key) const {
    DcmSequenceOfItems* found = nullptr;
    if (item_.findAndGetSequence(key, found).bad() || found->card() == 0)
      refuse(key, "missing or empty", "a sequence with items");
    return *found;
  }
  Attributes item(const DcmTagKey& key, unsigned long index = 0) const {
    DcmItem* found = sequence(key).getItem(index);
    if (found == nullptr) refuse(key, fmt::format("no item {}", index), "an item per frame");
    return {path_, *found};
  }
  bool has_sequence(const DcmTagKey& key) const { return item_.tagExists(key); }

  // The pixels as bytes; the element must hold `bytes` of them, as the file must.
  const Uint8* pixels(std::uint64_t bytes) const {
    DcmElement* element = nullptr;
    if (item_.findAndGetElement(DCM_PixelData, element).bad())
      refuse(DCM_PixelData, "missing", "pixels");
    const std::uint64_t there = element->getLength();
    if (there < bytes) {
      refuse(DCM_PixelData, fmt::format("its data end too early: {} bytes", there),
             fmt::format("{} bytes, as rows, columns and frames ask for", bytes));
    }
    const Uint8* data = nullptr;
    const Uint16* words = nullptr;
    if (item_.findAndGetUint8Array(DCM_PixelData, data).good() && data != nullptr) return data;
    if (item_.findAndGetUint16Array(DCM_PixelData, words).good() && words != nullptr)
      return reinterpret_cast<const Uint8*>(words);
    refuse(DCM_PixelData, "cannot be read", "uncompressed pixels");
  }

 private:
  const fs::path& path_;
  DcmItem& item_;
};

std::array<int, 2> plane_size(const Attributes& image) {
  return {image.integer(DCM_Columns, 1, 65535), image.integer(DCM_Rows, 1, 65535)};
}

// One image of 8 or 16 bits a pixel: where it lies, without its pixels.
DicomPlane read_place(const fs::path& path, const Attributes& image, int& bits) {
  DicomPlane plane{.file = path,
                   .series = image.text(DCM_SeriesInstanceUID),
                   .frame_of_reference = image.text(DCM_FrameOfReferenceUID),
                   .position = image.reals<3>(DCM_ImagePositionPatient),
                   .orientation = image.orientation(),
                   .spacing = image.spacing(),
                   .size = plane_size(image)};
  image.integer(DCM_SamplesPerPixel, 1, 1);
  if (image.has(DCM_NumberOfFrames)) image.integer(DCM_NumberOfFrames, 1, 1);
  bits = image.integer(DCM_BitsAllocated, 8, 16);
  if (bits != 8 && bits != 16) image.refuse(DCM_BitsAllocated, fmt::format("{}", bits), "8 or 16");
  return plane;
}

std::uint64_t pixels_of(const DicomPlane& plane) {
  return static_cast<std::uint64_t>(plane.size[0]) * plane.size[1];
}

DicomPlane read_mask(const fs::path& path, const Attributes& image) {
  int bits = 0;
  DicomPlane plane = read_place(path, image, bits);
  const std::uint64_t pixels = pixels_of(plane);
  const Uint8* bytes = image.pixels(pixels * bits / 8);
  for (std::size_t p = 0; p < pixels; ++p) {
    const int value = bits == 8 ? bytes[p] : reinterpret_cast<const Uint16*>(bytes)[p];
    if (value == 0) continue;
    if (plane.value != 0 && value != plane.value) {
      image.refuse(DCM_PixelData, fmt::format("values {} and {}", plane.value, value),
                   "a mask: one value beside 0, not the CT");
    }
    plane.value = value;
    extend(plane.runs, p);
  }
  return plane;
}

// Stored numbers have `stored` bits, the highest a sign or not; above them anything may stand.
DicomPlane read_values(const fs::path& path, const Attributes& image) {
  int bits = 0;
  DicomPlane plane = read_place(path, image, bits);
  const int stored = image.integer(DCM_BitsStored, 1, bits);
  image.integer(DCM_HighBit, stored - 1, stored - 1);
  const int sign = image.integer(DCM_PixelRepresentation, 0, 1) << (stored - 1);
  const int mask = (1 << stored) - 1;
  const double slope = image.has(DCM_RescaleSlope) ? image.reals<1>(DCM_RescaleSlope)[0] : 1.0;
  const double intercept =
      image.has(DCM_RescaleIntercept) ? image.reals<1>(DCM_RescaleIntercept)[0] : 0.0;
  const std::uint64_t pixels = pixels_of(plane);
  const Uint8* bytes = image.pixels(pixels * bits / 8);
  plane.values.resize(pixels);
  for (std::size_t p = 0; p < pixels; ++p) {
    const int raw = (bits == 8 ? bytes[p] : reinterpret_cast<const Uint16*>(bytes)[p]) & mask;
    plane.values[p] = static_cast<float>(slope * ((raw ^ sign) - sign) + intercept);
  }
  return plane;
}

// What a frame of a segmentation object shares with all others, or says for itself.
Attributes functional_group(const Attributes& image, const Attributes& frame,
                            const DcmTagKey& key) {
  if (frame.has_sequence(key)) return frame.item(key);
  return image.item(DCM_SharedFunctionalGroupsSequence).item(key);
}

// Frames lie one behind the other without padding: a bit a pixel, lowest first, or a byte.
std::vector<Run> frame_runs(const Uint8* bytes, std::uint64_t begin, std::uint64_t pixels,
                            bool binary, int threshold) {
  std::vector<Run> runs;
  for (std::uint64_t p = 0; p < pixels; ++p) {
    const std::uint64_t at = begin + p;
    const bool inside = binary ? (bytes[at / 8] >> (at % 8)) & 1 : bytes[at] >= threshold;
    if (inside) extend(runs, p);
  }
  return runs;
}

DicomFile read_segmentation_object(const fs::path& path, const Attributes& image) {
  DicomFile file;
  auto& segments = image.sequence(DCM_SegmentSequence);
  for (unsigned long s = 0; s < segments.card(); ++s) {
    const auto segment = image.item(DCM_SegmentSequence, s);
    file.segments[segment.integer(DCM_SegmentNumber, 1, 65535)] = segment.text(DCM_SegmentLabel);
  }
  const std::string type = image.text(DCM_SegmentationType);
  if (type != "BINARY" && type != "FRACTIONAL")
    image.refuse(DCM_SegmentationType, "'" + type + "'", "BINARY or FRACTIONAL");
  const bool binary = type == "BINARY";
  image.integer(DCM_BitsAllocated, binary ? 1 : 8, binary ? 1 : 8);
  const auto size = plane_size(image);
  const int frames = image.integer(DCM_NumberOfFrames, 1, 1 << 20);
  const auto pixels = static_cast<std::uint64_t>(size[0]) * size[1];
  if (pixels * frames > 32 * max_pixels)
    image.refuse(DCM_NumberOfFrames, fmt::format("{}", frames), "fewer, smaller frames");
  const std::uint64_t numbers = pixels * static_cast<std::uint64_t>(frames);
  const Uint8* bytes = image.pixels(binary ? (numbers + 7) / 8 : numbers);
  const int half = binary ? 1 : (image.integer(DCM_MaximumFractionalValue, 1, 255) + 1) / 2;
  for (int f = 0; f < frames; ++f) {
    const auto frame = image.item(DCM_PerFrameFunctionalGroupsSequence, f);
    const auto measures = functional_group(image, frame, DCM_PixelMeasuresSequence);
    const auto place = functional_group(image, frame, DCM_PlanePositionSequence);
    const auto axes = functional_group(image, frame, DCM_PlaneOrientationSequence);
    const auto segment = functional_group(image, frame, DCM_SegmentIdentificationSequence);
    DicomPlane plane{.file = path,
                     .frame_of_reference = image.text(DCM_FrameOfReferenceUID),
                     .segment = segment.integer(DCM_ReferencedSegmentNumber, 1, 65535),
                     .value = 1,
                     .position = place.reals<3>(DCM_ImagePositionPatient),
                     .orientation = axes.orientation(),
                     .spacing = measures.spacing(),
                     .size = size};
    if (!file.segments.count(plane.segment)) {
      segment.refuse(DCM_ReferencedSegmentNumber, fmt::format("{}", plane.segment),
                     "a number of the segment sequence");
    }
    if (measures.has(DCM_SpacingBetweenSlices))
      plane.depth_spacing = std::abs(measures.reals<1>(DCM_SpacingBetweenSlices)[0]);
    plane.runs = frame_runs(bytes, pixels * static_cast<std::uint64_t>(f), pixels, binary, half);
    file.planes.push_back(std::move(plane));
  }
  return file;
}

const Syntax& check_file(const fs::path& path) {
  DcmFileFormat head;
  const auto read =
      head.loadFile(path.c_str(), EXS_Unknown, EGL_noChange, DCM_MaxReadLength, ERM_metaOnly);
  DcmMetaInfo& info = *head.getMetaInfo();
  const Attributes meta(path, info);
  if (read.bad()) meta.refuse(DCM_FileMetaInformationVersion, read.text(), "a DICOM file");
  const std::string uid = meta.text(DCM_TransferSyntaxUID);
  const auto syntax = std::find_if(std::begin(syntaxes), std::end(syntaxes),
                                   [&uid](const Syntax& s) { return uid == s.uid; });
  if (syntax == std::end(syntaxes)) {
    meta.refuse(DCM_TransferSyntaxUID,
                fmt::format("{} {}", uid, dcmFindNameOfUID(uid.c_str(), "of an unknown name")),
                "plain pixels, RLE, lossless JPEG or JPEG-LS (gdcmconv --raw makes them plain)");
  }
  const auto length =
      static_cast<std::uint64_t>(meta.integer(DCM_FileMetaInformationGroupLength, 0, 1 << 20));
  constexpr std::uint64_t first = 128 + 4 + 12;  // preamble, magic, this element
  check_elements(path, first + length, syntax->explicit_vr, syntax->big_endian);
  return *syntax;
}

void register_decoders() {
  static const bool once = [] {
    DcmRLEDecoderRegistration::registerCodecs();
    DJDecoderRegistration::registerCodecs();
    DJLSDecoderRegistration::registerCodecs();
    return true;
  }();
  (void)once;
}

// A decoder allocates by the attributes: what they promise is bounded before it runs.
void expand(const Attributes& image, DcmDataset& data) {
  if (image.text(DCM_SOPClassUID) == UID_SegmentationStorage)
    image.refuse(DCM_PixelData, "a compressed segmentation object", "plain pixels");
  image.integer(DCM_SamplesPerPixel, 1, 1);
  if (image.has(DCM_NumberOfFrames)) image.integer(DCM_NumberOfFrames, 1, 1);
  const auto size = plane_size(image);
  if (static_cast<std::uint64_t>(size[0]) * size[1] > max_expanded)
    image.refuse(DCM_Rows, fmt::format("{}x{} pixels", size[0], size[1]), "planes up to 4096x4096");
  register_decoders();
  const auto done = data.chooseRepresentation(EXS_LittleEndianExplicit, nullptr);
  if (done.bad()) image.refuse(DCM_PixelData, done.text(), "pixels that can be expanded");
}

using ReadPlane = DicomPlane (*)(const fs::path&, const Attributes&);

DicomFile read_file_as(const fs::path& path, ReadPlane read_plane) {
  OFLog::configure(OFLogger::OFF_LOG_LEVEL);  // what it prints is told here by exceptions
  if (!is_dicom(path))
    throw bad_image(path, "", "not a DICOM file", "DICOM files only", "take it out of the folder");
  const Syntax& syntax = check_file(path);
  DcmFileFormat file;
  const auto read = file.loadFile(path.c_str());
  if (read.bad()) {
    throw bad_image(path, syntax.compressed ? "PixelData" : "",
                    fmt::format("cannot be read: {}", read.text()), "a whole DICOM file",
                    "copy the file again");
  }
  DcmDataset& data = *file.getDataset();
  const Attributes image(path, data);
  if (syntax.compressed) expand(image, data);
  if (image.text(DCM_SOPClassUID) == UID_SegmentationStorage)
    return read_segmentation_object(path, image);
  return {.planes = {read_plane(path, image)}};
}

}  // namespace

bool is_dicom(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::array<char, 132> head{};
  return file.read(head.data(), head.size()) && std::string_view(&head[128], 4) == "DICM";
}

DicomFile read_dicom(const fs::path& path) {
  return read_file_as(path, read_mask);
}

DicomPlane read_dicom_values(const fs::path& path) {
  DicomFile file = read_file_as(path, read_values);
  if (file.segments.empty()) return std::move(file.planes.front());
  throw bad_image(path, "SOPClassUID", "a segmentation object", "the planes of a CT",
                  "name it under 'volume'");
}

}  // namespace viscera
