// NIfTI-1 headers: one file, gzipped or not, or a pair of .hdr and .img.
#include <fmt/format.h>
#include <nifti1_io.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>

#include "stages/image/header_checks.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t header_bytes = 348, first_data = 352;
constexpr std::uint64_t max_offset = 1 << 24;

struct NiftiType {
  int code;
  const char* name;
  int bytes;
};

constexpr NiftiType nifti_types[] = {
    {NIFTI_TYPE_UINT8, "uint8", 1},     {NIFTI_TYPE_INT8, "int8", 1},
    {NIFTI_TYPE_UINT16, "uint16", 2},   {NIFTI_TYPE_INT16, "int16", 2},
    {NIFTI_TYPE_UINT32, "uint32", 4},   {NIFTI_TYPE_INT32, "int32", 4},
    {NIFTI_TYPE_UINT64, "uint64", 8},   {NIFTI_TYPE_INT64, "int64", 8},
    {NIFTI_TYPE_FLOAT32, "float32", 4}, {NIFTI_TYPE_FLOAT64, "float64", 8}};

using GzFile = std::unique_ptr<gzFile_s, int (*)(gzFile)>;

bool read_bytes(gzFile file, void* to, std::uint64_t count) {
  return gzread(file, to, static_cast<unsigned>(count)) == static_cast<int>(count);
}

nifti_1_header read_struct(const HeaderChecks& checks, gzFile file, bool& swapped) {
  nifti_1_header header;
  static_assert(sizeof header == header_bytes);
  if (!read_bytes(file, &header, sizeof header)) {
    checks.refuse("header", "truncated: it ends within its header, or its gzip data do not expand",
                  fmt::format("{} bytes of NIfTI-1 header", header_bytes));
  }
  swapped = header.dim[0] < 0 || header.dim[0] > 7;
  if (swapped) swap_nifti_header(&header, 1);
  if (header.sizeof_hdr == 540)
    checks.refuse("sizeof_hdr", "540: NIfTI-2", "348: NIfTI-1, as every tool can write it");
  if (header.sizeof_hdr != static_cast<int>(header_bytes))
    checks.refuse("sizeof_hdr", fmt::format("{}", header.sizeof_hdr), "348");
  if (std::memcmp(header.magic, "n+1", 4) != 0 && std::memcmp(header.magic, "ni1", 4) != 0)
    checks.refuse("magic", "neither n+1 nor ni1", "a NIfTI-1 file, with an orientation");
  return header;
}

std::array<double, 9> sform_axes(const nifti_1_header& h) {
  return {h.srow_x[0], h.srow_x[1], h.srow_x[2], h.srow_y[0], h.srow_y[1],
          h.srow_y[2], h.srow_z[0], h.srow_z[1], h.srow_z[2]};
}

void check_orientation(const HeaderChecks& checks, const nifti_1_header& h) {
  for (int a = 1; a <= 3; ++a) {
    // Where no sform has the axes, NIfTI's library takes a negative one for 1 mm.
    if (!std::isfinite(h.pixdim[a]) || (h.pixdim[a] <= 0.0f && h.sform_code <= 0)) {
      checks.refuse("pixdim", fmt::format("spacing {} on axis {}", h.pixdim[a], a - 1),
                    "positive mm");
    }
  }
  if (h.sform_code > 0) {
    checks.spans_volume("srow", sform_axes(h));
    checks.finite("srow", {h.srow_x[3], h.srow_y[3], h.srow_z[3]});
  } else if (h.qform_code > 0) {
    const double square = double(h.quatern_b) * h.quatern_b + double(h.quatern_c) * h.quatern_c +
                          double(h.quatern_d) * h.quatern_d;
    checks.finite("qoffset", {h.qoffset_x, h.qoffset_y, h.qoffset_z});
    if (!(square <= 1.001)) {
      checks.refuse("quatern", fmt::format("({}, {}, {})", h.quatern_b, h.quatern_c, h.quatern_d),
                    "the last three numbers of a quaternion of length one");
    }
  }
}

// The text of all extensions; each must lie within what is left before the voxels.
std::string read_extensions(const HeaderChecks& checks, gzFile file, std::uint64_t room,
                            bool swapped) {
  std::string text;
  std::array<char, 4> flag{};
  if (room < 4 || !read_bytes(file, flag.data(), 4) || flag[0] == 0) return text;
  for (room -= 4; room >= 16;) {
    std::array<std::int32_t, 2> head{};  // size, code
    if (!read_bytes(file, head.data(), sizeof head)) break;
    if (swapped) nifti_swap_4bytes(2, head.data());
    if (head[0] == 0) break;  // padding
    if (head[0] < 16 || static_cast<std::uint64_t>(head[0]) > room) {
      checks.refuse("extension",
                    fmt::format("one of {} bytes, {} before the voxels", head[0], room),
                    "extensions that end before vox_offset");
    }
    std::string part(static_cast<std::size_t>(head[0]) - 8, '\0');
    if (!read_bytes(file, part.data(), part.size())) break;
    text += part;
    room -= static_cast<std::uint64_t>(head[0]);
  }
  return text;
}

// The voxels of a pair lie in the .img beside the .hdr.
fs::path image_of_pair(const HeaderChecks& checks) {
  fs::path image = checks.path();
  image.replace_extension(".img");
  if (!fs::is_regular_file(image)) image += ".gz";
  if (!fs::is_regular_file(image))
    checks.refuse("magic", "a header alone: the .img beside it is absent", "both files of a pair");
  return image;
}

}  // namespace

ImageHeader read_nifti_header(const HeaderChecks& checks) {
  const GzFile file(gzopen(checks.path().c_str(), "rb"), gzclose);
  if (!file) checks.refuse("", "cannot be opened", "a file that may be read");
  bool swapped = false;
  const nifti_1_header h = read_struct(checks, file.get(), swapped);
  ImageHeader result{.path = checks.path(), .format = ImageFormat::nifti};
  if (h.dim[0] < 1 || h.dim[0] > 7) checks.refuse("dim", fmt::format("{} axes", h.dim[0]), "three");
  result.size = checks.size("dim", {h.dim + 1, h.dim + 1 + h.dim[0]}, 1);
  const auto type = std::find_if(std::begin(nifti_types), std::end(nifti_types),
                                 [&h](const NiftiType& t) { return t.code == h.datatype; });
  if (type == std::end(nifti_types) || h.bitpix != 8 * type->bytes) {
    checks.refuse("datatype", fmt::format("code {} of {} bits", h.datatype, h.bitpix),
                  "whole or floating numbers, one per voxel");
  }
  result.pixel_type = type->name;
  checks.finite("scl_slope", {h.scl_slope, h.scl_inter});
  check_orientation(checks, h);

  const bool single = h.magic[1] == '+';
  if (single != !checks.path().string().ends_with(".hdr"))
    checks.refuse("magic", h.magic, "n+1 in a .nii, ni1 in a .hdr with its .img");
  const auto offset = static_cast<double>(h.vox_offset);
  if (!(offset >= (single ? static_cast<double>(first_data) : 0.0) &&
        offset <= static_cast<double>(max_offset))) {
    checks.refuse("vox_offset", fmt::format("{}", offset),
                  fmt::format("{} to {}", first_data, max_offset));
  }
  const auto begin = static_cast<std::uint64_t>(h.vox_offset);
  if (single) result.extension = read_extensions(checks, file.get(), begin - header_bytes, swapped);
  StoredData data{.file = single ? checks.path() : image_of_pair(checks), .field = "dim"};
  data.values = result.voxels();
  data.bytes = data.values * static_cast<std::uint64_t>(type->bytes);
  if (data.file.extension() == ".gz") {  // expanded as a whole
    data.encoding = Encoding::deflated;
    data.bytes += begin;
  } else {
    data.offset = begin;
  }
  check_stored(checks, data);
  return result;
}

}  // namespace viscera
