#include "tests/images/malformed.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>

#include "pipeline/base/atomic_file.hpp"
#include "tests/images/image_bytes.hpp"

namespace viscera::testing {
namespace fs = std::filesystem;
namespace {

constexpr float nan_f = std::numeric_limits<float>::quiet_NaN();

class Corpus {
 public:
  explicit Corpus(fs::path folder) : folder_(std::move(folder)) {}
  std::vector<Malformed> list;

  void add(const std::string& name, const std::string& says, const std::string& bytes) {
    companion(name, bytes);
    list.push_back({name, says});
  }
  // A file beside those of the list.
  void companion(const std::string& name, const std::string& bytes) const {
    fs::create_directories((folder_ / name).parent_path());
    write_atomically(folder_ / name, bytes);
  }

 private:
  fs::path folder_;
};

// Gzip members of 16 MiB of zeros, `count` of them: 16 kB each.
std::string bomb(int count) {
  const std::string member = gzip(std::string(1 << 24, '\0'));
  std::string bytes;
  for (int m = 0; m < count; ++m) bytes += member;
  return bytes;
}

void add_nifti(Corpus& corpus) {
  const auto spoilt = [&](const std::string& name, const std::string& says,
                          const std::function<void(NiftiFile&)>& spoil) {
    NiftiFile file;
    spoil(file);
    corpus.add("nifti_" + name, says, file.bytes());
  };
  const auto header = [&](const std::string& name, const std::string& says,
                          const std::function<void(nifti_1_header&)>& spoil) {
    spoilt(name + ".nii", says, [&](NiftiFile& file) { spoil(file.header); });
  };
  header("asks_for_18_gb", "dim", [](auto& h) {
    h.dim[1] = h.dim[2] = h.dim[3] = 2100;
    h.datatype = 16, h.bitpix = 32;
  });
  header("product_beyond_64_bits", "dim", [](auto& h) {
    h.dim[0] = 7;
    std::fill(h.dim + 1, h.dim + 8, short{32767});
  });
  header("zero_dim", "dim", [](auto& h) { h.dim[2] = 0; });
  header("negative_dim", "dim", [](auto& h) { h.dim[2] = -5; });
  header("four_axes", "dim", [](auto& h) { h.dim[0] = 4, h.dim[4] = 3; });
  header("two_axes", "dim", [](auto& h) { h.dim[0] = 2; });
  header("more_than_there_is", "dim", [](auto& h) { h.dim[3] = 400; });
  header("bits_disagree", "datatype", [](auto& h) { h.bitpix = 64; });
  header("rgb", "datatype", [](auto& h) { h.datatype = 128, h.bitpix = 24; });
  header("nan_spacing", "pixdim", [](auto& h) { h.pixdim[2] = nan_f, h.sform_code = 0; });
  header("zero_spacing", "pixdim", [](auto& h) { h.pixdim[2] = 0.0f, h.sform_code = 0; });
  header("negative_spacing", "pixdim",
         [](auto& h) { h.pixdim[3] = -2.0f, h.sform_code = 0, h.qform_code = 1; });
  header("singular_sform", "srow", [](auto& h) { std::copy_n(h.srow_x, 4, h.srow_y); });
  header("nan_sform", "srow", [](auto& h) { h.srow_y[1] = nan_f; });
  header("infinite_sform", "srow", [](auto& h) { h.srow_y[3] = INFINITY; });
  header("sheared_sform", "direction", [](auto& h) { h.srow_x[1] = 1.5f; });
  header("long_quaternion", "quatern", [](auto& h) {
    h.sform_code = 0, h.qform_code = 1;
    h.quatern_b = h.quatern_c = h.quatern_d = 1.0f;
  });
  header("nan_slope", "scl_slope", [](auto& h) { h.scl_slope = nan_f; });
  header("no_magic", "magic", [](auto& h) { h.magic[0] = 0; });
  header("pair_without_image", "magic", [](auto& h) { std::memcpy(h.magic, "ni1", 4); });
  header("nifti2", "sizeof_hdr", [](auto& h) { h.sizeof_hdr = 540; });
  header("odd_header_size", "sizeof_hdr", [](auto& h) { h.sizeof_hdr = 1 << 30; });
  spoilt("offset_into_header.nii", "vox_offset",
         [](auto& f) { f.own_offset = true, f.header.vox_offset = 20.0f; });
  spoilt("offset_beyond_file.nii", "dim",
         [](auto& f) { f.own_offset = true, f.header.vox_offset = 1e6f; });
  spoilt("nan_offset.nii", "vox_offset",
         [](auto& f) { f.own_offset = true, f.header.vox_offset = nan_f; });
  spoilt("extension_lies.nii", "extension", [](auto& f) {
    f.extensions = nifti_extension("<Label Key=\"1\">");
    f.extensions[3] = '\x7f';
  });
  spoilt("ids_below_zero.nii", "voxel values", [](auto& f) {
    f = NiftiFile({2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0}, -7);
  });
  spoilt("probabilities.nii", "voxel values", [](auto& f) { f.header.scl_slope = 0.4f; });
  spoilt("all_zero.nii", "voxel values", [](auto& f) { f.voxels.assign(f.voxels.size(), '\0'); });
  spoilt("far_too_long.nii", "dim", [](auto& f) { f.voxels += std::string(1 << 20, '\0'); });

  const std::string whole = NiftiFile().bytes();
  corpus.add("nifti_cut_header.nii", "header", whole.substr(0, 100));
  corpus.add("nifti_cut_voxels.nii", "dim", whole.substr(0, 500));
  corpus.add("nifti_empty.nii", "header", "");
  corpus.add("nifti_text.nii.gz", "sizeof_hdr", std::string(400, 'x'));
  const std::string zipped = gzip(whole);
  corpus.add("nifti_cut.nii.gz", "dim", zipped.substr(0, zipped.size() - 12));
  std::string damaged = zipped;
  damaged[damaged.size() - 6] ^= 0x55;  // the checksum
  corpus.add("nifti_bad_checksum.nii.gz", "header", damaged);
  corpus.add("nifti_bomb.nii.gz", "dim", zipped + bomb(64));
  NiftiFile lying;
  lying.header.dim[1] = lying.header.dim[2] = 20000;
  corpus.add("nifti_lying.nii.gz", "dim", gzip(lying.bytes()));
  NiftiFile alone;
  std::memcpy(alone.header.magic, "ni1", 4);
  corpus.add("nifti_alone.hdr", "magic", alone.bytes().substr(0, 348));
}

// Fields replaced, or dropped where the new value is "-".
std::string with(const std::string& header, const std::string& field, const std::string& value) {
  const auto at = header.find(field);
  const auto end = header.find('\n', at) + 1;
  const std::string line = value == "-" ? "" : field + value + "\n";
  return header.substr(0, at) + line + header.substr(end);
}

void add_nrrd(Corpus& corpus) {
  const std::string head =
      "NRRD0004\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\nsizes: 5 4 3\n"
      "space directions: (1,0,0) (0,1,0) (0,0,2)\nspace origin: (0,0,0)\nencoding: raw\n";
  const std::string data(60, '\1');
  const auto spoilt = [&](const std::string& name, const std::string& field,
                          const std::string& value, const std::string& says) {
    corpus.add("nrrd_" + name, says, with(head, field + ": ", value) + "\n" + data);
  };
  spoilt("huge.nrrd", "sizes", "60000 60000 60000", "sizes");
  spoilt("beyond_64_bits.nrrd", "sizes", "4294967296 4294967296 4294967296", "sizes");
  spoilt("more_than_there_is.nrrd", "sizes", "50 40 30", "sizes");
  spoilt("zero_size.nrrd", "sizes", "5 0 3", "sizes");
  spoilt("negative_size.nrrd", "sizes", "5 -4 3", "sizes");
  spoilt("sizes_in_words.nrrd", "sizes", "five 4 3", "sizes");
  spoilt("too_few_sizes.nrrd", "sizes", "5 4", "sizes");
  spoilt("no_sizes.nrrd", "sizes", "-", "sizes");
  spoilt("odd_dimension.nrrd", "dimension", "99999", "sizes");
  spoilt("unknown_type.nrrd", "type", "block", "type");
  spoilt("bzip2.nrrd", "encoding", "bzip2", "encoding");
  spoilt("centimetres.nrrd", "encoding", "raw\nspace units: \"cm\" \"cm\" \"cm\"", "space units");
  spoilt("las.nrrd", "space", "left-anterior-superior", "space");
  spoilt("singular.nrrd", "space directions", "(1,0,0) (2,0,0) (0,0,2)", "space directions");
  spoilt("nan_axis.nrrd", "space directions", "(1,0,0) (0,nan,0) (0,0,2)", "space directions");
  spoilt("two_axes.nrrd", "space directions", "(1,0,0) (0,1,0)", "space directions");
  spoilt("infinite_origin.nrrd", "space origin", "(inf,0,0)", "space origin");
  spoilt("skips_lines.nrrd", "encoding", "raw\nline skip: 1000000", "line skip");
  spoilt("skips_beyond.nrrd", "encoding", "raw\nbyte skip: 100000", "sizes");
  spoilt("skips_backwards.nrrd", "encoding", "raw\nbyte skip: -7", "byte skip");
  spoilt("twice.nrrd", "encoding", "raw\nsizes: 1 1 1", "sizes");
  spoilt("no_ascii.nrrd", "encoding", "ascii", "sizes");
  const std::string plain =
      with(with(with(head, "space directions: ", "-"), "space: ", "-"), "space origin: ", "-");
  for (const auto& [name, value] :
       {std::pair("nan", "1 nan 1"), std::pair("zero", "1 0 1"), std::pair("infinite", "1 inf 1")})
    corpus.add(fmt::format("nrrd_{}_spacing.nrrd", name), "spacings",
               plain + "spacings: " + value + "\n\n" + data);
  const auto detached = [&](const std::string& name, const std::string& file,
                            const std::string& says) {
    corpus.add("nrrd_" + name, says, head + "data file: " + file + "\n");
  };
  corpus.companion("outside.raw", data);
  detached("detached/climbs_out.nhdr", "../outside.raw", "data file");
  detached("detached/climbs_within.nhdr", "below/../../outside.raw", "data file");
  detached("absolute.nhdr", "/etc/passwd", "data file");
  detached("absent.nhdr", "absent.raw", "data file");
  detached("folder.nhdr", ".", "data file");
  detached("list.nhdr", "LIST\n/etc/passwd", "data file");
  detached("pattern.nhdr", "../s%03d.raw 1 3 1", "data file");
  corpus.companion("short.raw", "1234");
  detached("short.nhdr", "short.raw", "sizes");

  const std::string packed = with(head, "encoding: ", "gzip") + "\n";
  corpus.add("nrrd_cut_gzip.nrrd", "sizes", packed + gzip(data).substr(0, 20));
  corpus.add("nrrd_bomb.nrrd", "sizes", packed + bomb(64));
  corpus.add("nrrd_no_gzip.nrrd", "sizes", packed + data);
  corpus.add("nrrd_cut.nrrd", "sizes", head + "\n" + data.substr(0, 30));
  corpus.add("nrrd_endless_line.nrrd", "header", "NRRD0004\n" + std::string(1 << 21, 'x'));
  corpus.add("nrrd_no_magic.nrrd", "header", "NRRD\n" + head);
  std::string layers = with(with(head, "sizes: ", "900 5 4 3"), "dimension: ", "4");
  layers = with(layers, "space directions: ", "none (1,0,0) (0,1,0) (0,0,2)");
  corpus.add("nrrd_layers_lie.seg.nrrd", "sizes",
             layers + "kinds: list domain domain domain\n\n" + data);
  corpus.add("nrrd_segment_lies.seg.nrrd", "Segment0_Layer",
             head + "Segment0_Name:=liver\nSegment0_Layer:=9\nSegment0_LabelValue:=1\n\n" + data);
}

void add_meta(Corpus& corpus) {
  const std::string head =
      "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
      "CompressedData = False\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\n"
      "ElementSpacing = 1 1 2\nDimSize = 5 4 3\nElementType = MET_UCHAR\n"
      "ElementDataFile = LOCAL\n";
  const std::string data(60, '\1');
  const auto spoilt = [&](const std::string& name, const std::string& field,
                          const std::string& value, const std::string& says) {
    corpus.add("meta_" + name + ".mha", says, with(head, field + " = ", value) + data);
  };
  spoilt("huge", "DimSize", "60000 60000 60000", "DimSize");
  spoilt("beyond_64_bits", "DimSize", "4294967296 4294967296 4294967296", "DimSize");
  spoilt("more_than_there_is", "DimSize", "50 40 30", "DimSize");
  spoilt("zero_size", "DimSize", "5 0 3", "DimSize");
  spoilt("negative_size", "DimSize", "5 -4 3", "DimSize");
  spoilt("too_few_sizes", "DimSize", "5 4", "DimSize");
  spoilt("many_axes", "NDims", "100", "NDims");
  spoilt("no_axes", "NDims", "-", "NDims");
  spoilt("channels", "ElementType", "MET_UCHAR\nElementNumberOfChannels = 1000000000",
         "ElementNumberOfChannels");
  spoilt("unknown_type", "ElementType", "MET_STRING", "ElementType");
  spoilt("nan_spacing", "ElementSpacing", "1 nan 2", "ElementSpacing");
  spoilt("zero_spacing", "ElementSpacing", "1 0 2", "ElementSpacing");
  spoilt("negative_spacing", "ElementSpacing", "1 -1 2", "ElementSpacing");
  spoilt("infinite_offset", "Offset", "0 inf 0", "Offset");
  spoilt("singular", "TransformMatrix", "1 0 0 1 0 0 0 0 1", "TransformMatrix");
  spoilt("nan_matrix", "TransformMatrix", "1 0 0 0 nan 0 0 0 1", "TransformMatrix");
  spoilt("skips_beyond", "DimSize", "5 4 3\nHeaderSize = 1000000", "HeaderSize");
  spoilt("packed_size_lies", "CompressedData", "True\nCompressedDataSize = 99999999999",
         "CompressedDataSize");
  spoilt("not_packed", "CompressedData", "True", "DimSize");
  spoilt("twice", "ElementType", "MET_UCHAR\nDimSize = 1 1 1", "DimSize");
  // MetaIO tells fields by their exact spelling, ends names at colons too and lines at a return.
  const std::string last = "ElementDataFile = LOCAL\n";
  corpus.add("meta_last_field_spelled_otherwise.mha", "ElementDatafile",
             head.substr(0, head.size() - last.size()) + "ElementDatafile = LOCAL\n" + data +
                 "\nDimSize = 2 1 1\n" + last);
  corpus.add("meta_long_type.mha", "ObjectType",
             with(head, "ObjectType = ", std::string(270, 'I')) + data);
  spoilt("long_comment", "ElementType", "MET_UCHAR\nComment = " + std::string(300, 'c'), "Comment");
  spoilt("colon", "ElementType", "MET_UCHAR\nDimSize: 2 1 1 = 3", "DimSize");
  spoilt("return_in_a_line", "ElementType", "MET_UCHAR\rDimSize = 2 1 1", "ElementType");
  corpus.add("meta_no_data_file.mha", "ElementDataFile", with(head, "ElementDataFile = ", "-"));
  const auto detached = [&](const std::string& name, const std::string& file,
                            const std::string& says) {
    corpus.add("meta_" + name + ".mhd", says, with(head, "ElementDataFile = ", file));
  };
  detached("detached/climbs_out", "../outside.raw", "ElementDataFile");
  detached("absolute", "/etc/passwd", "ElementDataFile");
  detached("absent", "absent.raw", "ElementDataFile");
  detached("list", "LIST\n/etc/passwd", "ElementDataFile");
  detached("pattern", "../s%03d.raw 1 3 1", "ElementDataFile");
  detached("short", "short.raw", "DimSize");
  corpus.add("meta_bomb.mha", "DimSize", with(head, "CompressedData = ", "True") + bomb(64));
  corpus.add("meta_cut.mha", "DimSize", head + data.substr(0, 30));
  corpus.add("meta_endless_line.mha", "header", "NDims = " + std::string(1 << 20, '3'));
  corpus.add("meta_endless_file.mha", "ElementDataFile",
             with(head, "ElementDataFile = ", std::string(300, 'f')) + data);
  corpus.add("meta_endless_name.mha", "header", std::string(300, 'N') + " = 3\n" + head + data);
  corpus.add("meta_binary.mha", "header", std::string(400, '\0'));
}

void add_dicom_series(Corpus& corpus) {
  using Spoil = std::function<void(std::vector<DicomSet>&)>;
  const auto series = [&](const std::string& name, const std::string& says, const Spoil& spoil) {
    std::vector<DicomSet> planes;
    for (int k = 0; k < 4; ++k) planes.push_back(dicom_plane(k));
    spoil(planes);
    for (std::size_t k = 0; k < planes.size(); ++k)
      corpus.companion(fmt::format("dicom_{}/{}.dcm", name, k), dicom_file(planes[k]));
    corpus.list.push_back({"dicom_" + name, says});
  };
  series("missing_plane", "ImagePositionPatient", [](auto& p) { p.erase(p.begin() + 1); });
  series("plane_twice", "ImagePositionPatient", [](auto& p) { p[2] = p[1]; });
  series("single_plane", "ImagePositionPatient", [](auto& p) { p.resize(1); });
  series("sheared", "ImagePositionPatient",
         [](auto& p) { p[3][0x00200032] = text_element("DS", "-5\\-20\\106"); });
  series("no_position", "ImagePositionPatient", [](auto& p) { p[1].erase(0x00200032); });
  series("nan_position", "ImagePositionPatient",
         [](auto& p) { p[1][0x00200032] = text_element("DS", "0\\nan\\102"); });
  series("mixed_series", "SeriesInstanceUID",
         [](auto& p) { p[2][0x0020000E] = text_element("UI", "1.2.3.99"); });
  series("mixed_size", "Rows", [](auto& p) {
    p[2][0x00280010] = number_element(dicom_columns);
    p[2][0x00280011] = number_element(dicom_rows);
  });
  series("mixed_spacing", "PixelSpacing",
         [](auto& p) { p[2][0x00280030] = text_element("DS", "2\\2"); });
  series("mixed_orientation", "ImageOrientationPatient",
         [](auto& p) { p[2][0x00200037] = text_element("DS", "0\\1\\0\\1\\0\\0"); });
  series("zero_orientation", "ImageOrientationPatient",
         [](auto& p) { p[2][0x00200037] = text_element("DS", "0\\0\\0\\0\\0\\0"); });
  series("zero_spacing", "PixelSpacing",
         [](auto& p) { p[0][0x00280030] = text_element("DS", "0\\1"); });
  series("no_rows", "Rows", [](auto& p) { p[0].erase(0x00280010); });
  series("huge_rows", "PixelData", [](auto& p) {
    p[0][0x00280010] = number_element(65535);
    p[0][0x00280011] = number_element(65535);
  });
  series("ct_instead_of_mask", "PixelData", [](auto& p) { p[1][0x7FE00010].value[7] = 9; });
  series("colour", "SamplesPerPixel", [](auto& p) { p[1][0x00280002] = number_element(3); });
  series("no_pixels", "PixelData", [](auto& p) { p[1].erase(0x7FE00010); });
  series("all_zero", "voxel values", [](auto& p) {
    for (auto& plane : p) plane[0x7FE00010].value.assign(dicom_columns * dicom_rows, '\0');
  });
  corpus.companion("dicom_with_text/a.dcm", dicom_file(dicom_plane(0)));
  corpus.companion("dicom_with_text/notes.txt", "certainly no image");
  corpus.list.push_back({"dicom_with_text", "notes.txt"});
}

// Compressed pixels whose pieces are no such thing.
void add_fragments(Corpus& corpus) {
  const auto item = [](const std::string& value) {
    const auto size = static_cast<std::uint32_t>(value.size());
    std::string head("\xfe\xff\x00\xe0\0\0\0\0", 8);
    std::memcpy(&head[4], &size, sizeof size);
    return head + value;
  };
  const std::string end("\xfe\xff\xdd\xe0\0\0\0\0", 8);
  const std::map<std::string, std::string> contents{
      {"garbage", item("") + item(std::string(64, '\x5a')) + end},
      {"no_piece", item("") + end},
      {"endless", item("") + item(std::string(64, '\0'))},
      {"huge_piece", std::string("\xfe\xff\x00\xe0\xf0\xff\xff\x7f", 8)}};
  DicomSet plain = dicom_plane(0);
  plain.erase(0x7FE00010);
  for (const char* syntax :
       {"1.2.840.10008.1.2.4.70", "1.2.840.10008.1.2.4.80", "1.2.840.10008.1.2.5"}) {
    for (const auto& [name, pieces] : contents) {
      const std::string folder = fmt::format("dicom_{}_{}", name, std::string(syntax).substr(18));
      corpus.companion(folder + "/0.dcm",
                       dicom_file(plain, syntax) +
                           std::string("\xe0\x7f\x10\0OB\0\0\xff\xff\xff\xff", 12) + pieces);
      corpus.list.push_back({folder, name == "huge_piece" ? "(fffe,e000)" : "PixelData"});
    }
  }
}

void add_dicom_files(Corpus& corpus) {
  const std::string plane = dicom_file(dicom_plane(0));
  const auto folder = [&](const std::string& name, const std::string& says,
                          const std::string& bytes) {
    corpus.companion("dicom_" + name + "/0.dcm", bytes);
    corpus.list.push_back({"dicom_" + name, says});
  };
  folder("cut_pixels", "0.dcm", plane.substr(0, plane.size() - 10));
  folder("cut_header", "0.dcm", plane.substr(0, 200));
  folder("deflated", "TransferSyntaxUID", dicom_file(dicom_plane(0), "1.2.840.10008.1.2.1.99"));
  folder("jpeg2000", "TransferSyntaxUID", dicom_file(dicom_plane(0), "1.2.840.10008.1.2.4.90"));
  folder("lossy", "TransferSyntaxUID", dicom_file(dicom_plane(0), "1.2.840.10008.1.2.4.50"));
  folder("jpeg_of_plain", "PixelData", dicom_file(dicom_plane(0), "1.2.840.10008.1.2.4.70"));
  add_fragments(corpus);
  std::string lying = plane;
  const std::size_t length = plane.size() - dicom_columns * dicom_rows - 4;
  lying.replace(length, 4, "\xf0\xff\xff\xff");
  folder("pixel_length_lies", "0.dcm", lying);
  DicomSet text = dicom_plane(0);
  text[0x00081030] = {"OB", std::string(8, 'x')};
  std::string early = dicom_file(text);
  early.replace(early.find("xxxxxxxx") - 4, 4, "\xf0\xff\xff\x7f");
  folder("element_length_lies", "0.dcm", early);
  std::string nested;
  const std::string open{'\x08', '\0',   '\x40', '\x11', 'S',    'Q',    '\0',
                         '\0',   '\xff', '\xff', '\xff', '\xff', '\xfe', '\xff',
                         '\0',   '\xe0', '\xff', '\xff', '\xff', '\xff'};
  for (int level = 0; level < 200000; ++level) nested += open;
  folder("nested_deep", "0.dcm", dicom_file({}) + nested);

  const auto object = [&](const std::string& name, const std::string& says,
                          const std::function<void(DicomSet&)>& spoil) {
    DicomSet set = dicom_segmentation();
    spoil(set);
    corpus.add("dicomseg_" + name + ".dcm", says, dicom_file(set));
  };
  object("more_frames", "PixelData", [](auto& s) { s[0x00280008] = text_element("IS", "9"); });
  object("many_frames", "NumberOfFrames",
         [](auto& s) { s[0x00280008] = text_element("IS", "2000000000"); });
  object("huge_rows", "PixelData", [](auto& s) {
    s[0x00280010] = number_element(65535);
    s[0x00280011] = number_element(65535);
  });
  object("no_groups", "PerFrameFunctionalGroupsSequence", [](auto& s) { s.erase(0x52009230); });
  object("no_segments", "SegmentSequence", [](auto& s) { s.erase(0x00620002); });
  object("unknown_segment", "ReferencedSegmentNumber", [](auto& s) {
    const DicomSet only{{0x00620004, number_element(1)}};
    s[0x00620002] = sequence_element({only});
  });
  object("no_spacing", "SharedFunctionalGroupsSequence", [](auto& s) { s.erase(0x52009229); });
  object("label_map", "SegmentationType",
         [](auto& s) { s[0x00620001] = text_element("CS", "LABELMAP"); });
  corpus.add("dicom_lone_plane.dcm", "SOPClassUID", plane);
}

}  // namespace

std::vector<Malformed> write_malformed(const fs::path& folder) {
  Corpus corpus(folder);
  add_nifti(corpus);
  add_nrrd(corpus);
  add_meta(corpus);
  add_dicom_series(corpus);
  add_dicom_files(corpus);
  return corpus.list;
}

}  // namespace viscera::testing
