#include "tests/images/image_bytes.hpp"

#include <fmt/format.h>
#include <zlib.h>

#include <cstring>

namespace viscera::testing {

NiftiFile::NiftiFile(const std::array<float, 12>& sform, std::int16_t value) {
  const short dimensions[] = {3, 8, 6, 4, 1, 1, 1, 1};
  std::copy(std::begin(dimensions), std::end(dimensions), header.dim);
  header.sizeof_hdr = 348;
  header.datatype = 4;
  header.bitpix = 16;
  std::fill(header.pixdim, header.pixdim + 4, 1.0f);
  header.scl_slope = 1.0f;
  header.xyzt_units = 2;  // mm
  header.sform_code = 1;
  std::copy(sform.begin(), sform.begin() + 4, header.srow_x);
  std::copy(sform.begin() + 4, sform.begin() + 8, header.srow_y);
  std::copy(sform.begin() + 8, sform.end(), header.srow_z);
  std::memcpy(header.magic, "n+1", 4);
  std::vector<std::int16_t> ids(8 * 6 * 4, 0);
  for (int k = 1; k < 3; ++k)
    for (int j = 2; j < 4; ++j)
      for (int i = 2; i < 6; ++i) ids[(k * 6 + j) * 8 + i] = value;
  voxels.assign(reinterpret_cast<const char*>(ids.data()), ids.size() * 2);
}

std::string NiftiFile::bytes() const {
  nifti_1_header written = header;
  if (!own_offset) written.vox_offset = static_cast<float>(352 + extensions.size());
  std::string bytes(reinterpret_cast<const char*>(&written), sizeof written);
  const std::string flag{extensions.empty() ? '\0' : '\1', '\0', '\0', '\0'};
  return bytes + flag + extensions + voxels;
}

std::string nifti_extension(const std::string& text) {
  std::string padded = text;
  padded.resize((text.size() + 8 + 15) / 16 * 16 - 8, '\0');
  const std::int32_t head[2] = {static_cast<std::int32_t>(padded.size() + 8), 30};
  return std::string(reinterpret_cast<const char*>(head), 8) + padded;
}

std::string gzip(const std::string& bytes) {
  z_stream stream{};
  deflateInit2(&stream, 9, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
  std::string packed(deflateBound(&stream, bytes.size()) + 32, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

namespace {

template <class Number>
std::string raw(Number number) {
  return {reinterpret_cast<const char*>(&number), sizeof number};
}

std::string tag_bytes(std::uint32_t tag) {
  return raw(static_cast<std::uint16_t>(tag >> 16)) + raw(static_cast<std::uint16_t>(tag));
}

}  // namespace

std::string dicom_bytes(const DicomSet& set) {
  std::string bytes;
  for (const auto& [tag, element] : set) {
    bytes += tag_bytes(tag) + element.vr;
    const auto length = element.value.size();
    const bool wide = element.vr == "OB" || element.vr == "OW" || element.vr == "SQ";
    bytes += wide ? std::string(2, '\0') + raw(static_cast<std::uint32_t>(length))
                  : raw(static_cast<std::uint16_t>(length));
    bytes += element.value;
  }
  return bytes;
}

std::string dicom_file(const DicomSet& set, const std::string& syntax) {
  DicomSet meta{{0x00020001, {"OB", std::string{'\0', '\1'}}},
                {0x00020002, set.count(0x00080016) ? set.at(0x00080016) : text_element("UI", "1")},
                {0x00020003, text_element("UI", "1.2.3.4")},
                {0x00020010, text_element("UI", syntax)},
                {0x00020012, text_element("UI", "1.2.3")}};
  const std::string rest = dicom_bytes(meta);
  const DicomSet length{{0x00020000, {"UL", raw(static_cast<std::uint32_t>(rest.size()))}}};
  return std::string(128, '\0') + "DICM" + dicom_bytes(length) + rest + dicom_bytes(set);
}

DicomElement text_element(const char* vr, std::string value) {
  if (value.size() % 2) value += std::string(vr) == "UI" ? '\0' : ' ';
  return {vr, value};
}

DicomElement number_element(std::uint16_t value) {
  return {"US", raw(value)};
}

DicomElement sequence_element(const std::vector<DicomSet>& items) {
  std::string value;
  for (const auto& item : items) {
    const std::string bytes = dicom_bytes(item);
    value += tag_bytes(0xFFFEE000) + raw(static_cast<std::uint32_t>(bytes.size())) + bytes;
  }
  return {"SQ", value};
}

DicomSet dicom_plane(int k) {
  std::string pixels(dicom_columns * dicom_rows, '\0');
  for (int j = 1; j <= 2; ++j)
    for (int i = 1; i <= 3; ++i) pixels[j * dicom_columns + i] = '\xff';
  return {{0x00080016, text_element("UI", "1.2.840.10008.5.1.4.1.1.2")},
          {0x00080060, text_element("CS", "CT")},
          {0x0020000D, text_element("UI", "1.2.3.5")},
          {0x0020000E, text_element("UI", "1.2.3.6")},
          {0x00200013, text_element("IS", std::to_string(k + 1))},
          {0x00200032, text_element("DS", fmt::format("-10\\-20\\{}", 100 + 2 * k))},
          {0x00200037, text_element("DS", "1\\0\\0\\0\\1\\0")},
          {0x00280002, number_element(1)},
          {0x00280004, text_element("CS", "MONOCHROME2")},
          {0x00280010, number_element(dicom_rows)},
          {0x00280011, number_element(dicom_columns)},
          {0x00280030, text_element("DS", "1.25\\1.5")},
          {0x00280100, number_element(8)},
          {0x00280101, number_element(8)},
          {0x00280102, number_element(7)},
          {0x00280103, number_element(0)},
          {0x7FE00010, {"OW", pixels}}};
}

DicomSet dicom_ct_plane(int k, int hu) {
  DicomSet set = dicom_plane(k);
  std::string pixels;
  for (int p = 0; p < dicom_columns * dicom_rows; ++p)
    pixels += raw(static_cast<std::uint16_t>(((hu + 1000) / 2 & 0xfff) | 0x5000));
  set[0x00280100] = number_element(16);
  set[0x00280101] = number_element(12);  // what stands in the upper four bits is no part of it
  set[0x00280102] = number_element(11);
  set[0x00281052] = text_element("DS", "-1000");
  set[0x00281053] = text_element("DS", "2");
  set[0x7FE00010] = {"OW", pixels};
  return set;
}

DicomSet dicom_segmentation() {
  const auto segment = [](std::uint16_t number, const char* name) {
    return DicomSet{{0x00620004, number_element(number)}, {0x00620005, text_element("LO", name)}};
  };
  const auto frame = [](std::uint16_t segment_number, int k) {
    const DicomSet place{
        {0x00200032, text_element("DS", fmt::format("-10\\-20\\{}", 100 + 2 * k))}};
    const DicomSet of{{0x0062000B, number_element(segment_number)}};
    return DicomSet{{0x00209113, sequence_element({place})}, {0x0062000A, sequence_element({of})}};
  };
  const DicomSet axes{{0x00200037, text_element("DS", "1\\0\\0\\0\\1\\0")}};
  const DicomSet measures{{0x00180088, text_element("DS", "2")},
                          {0x00280030, text_element("DS", "1.25\\1.5")}};
  const std::string liver{'\0', '\x7e', '\x7e', '\0'}, tumour{'\0', '\x0c', '\0', '\0'};
  return {{0x00080016, text_element("UI", "1.2.840.10008.5.1.4.1.1.66.4")},
          {0x0020000E, text_element("UI", "1.2.3.6")},
          {0x00280002, number_element(1)},
          {0x00280008, text_element("IS", "4")},
          {0x00280010, number_element(4)},
          {0x00280011, number_element(8)},
          {0x00280100, number_element(1)},
          {0x00280101, number_element(1)},
          {0x00280102, number_element(0)},
          {0x00280103, number_element(0)},
          {0x00620001, text_element("CS", "BINARY")},
          {0x00620002, sequence_element({segment(1, "liver"), segment(2, "tumour")})},
          {0x52009229, sequence_element({{{0x00209116, sequence_element({axes})},
                                          {0x00289110, sequence_element({measures})}}})},
          {0x52009230, sequence_element({frame(1, 0), frame(1, 1), frame(1, 2), frame(2, 1)})},
          {0x7FE00010, {"OB", liver + liver + liver + tumour}}};
}

}  // namespace viscera::testing
