// One plane in every transfer syntax that is read gives the same mask; others are refused by name.
// clang-format off: DCMTK's configuration comes first
#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dcrleerg.h>
#include <dcmtk/dcmdata/dcrlerp.h>
#include <dcmtk/dcmdata/dctk.h>
#include <dcmtk/dcmjpeg/djencode.h>
#include <dcmtk/dcmjpeg/djrplol.h>
#include <dcmtk/dcmjpls/djencode.h>
#include <dcmtk/dcmjpls/djrparam.h>
// clang-format on
#include <gtest/gtest.h>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "stages/labels/dicom_planes.hpp"
#include "tests/images/image_bytes.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

class DicomSyntax : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    DcmRLEEncoderRegistration::registerCodecs();
    DJEncoderRegistration::registerCodecs();
    DJLSEncoderRegistration::registerCodecs();
  }
  fs::path write(const std::string& name, const std::string& bytes) {
    write_atomically(folder_.path() / name, bytes);
    return folder_.path() / name;
  }
  fs::path write_as(const testing::DicomSet& set, E_TransferSyntax syntax) {
    const fs::path plain = write("plain.dcm", testing::dicom_file(set));
    DcmFileFormat file;
    EXPECT_TRUE(file.loadFile(plain.c_str()).good());
    const DJ_RPLossless jpeg;
    const DJLSRepresentationParameter jpeg_ls(0, OFTrue);
    const DcmRepresentationParameter* how = nullptr;
    if (syntax == EXS_JPEGProcess14SV1 || syntax == EXS_JPEGProcess14) how = &jpeg;
    if (syntax == EXS_JPEGLSLossless) how = &jpeg_ls;
    EXPECT_TRUE(file.getDataset()->chooseRepresentation(syntax, how).good());
    const fs::path path = folder_.path() / "other.dcm";
    EXPECT_TRUE(file.saveFile(path.c_str(), syntax).good());
    return path;
  }
  std::string words(const fs::path& path) {
    try {
      read_dicom(path);
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::bad_input);
      return e.what();
    }
    return "read";
  }
  TemporaryFolder folder_{fs::temp_directory_path()};
};

constexpr E_TransferSyntax read_ones[] = {EXS_LittleEndianImplicit, EXS_BigEndianExplicit,
                                          EXS_RLELossless,          EXS_JPEGProcess14,
                                          EXS_JPEGProcess14SV1,     EXS_JPEGLSLossless};

TEST_F(DicomSyntax, AMaskIsTheSameInEachThatIsRead) {
  const DicomPlane plain =
      read_dicom(write("a.dcm", testing::dicom_file(testing::dicom_plane(1)))).planes.at(0);
  for (const auto syntax : read_ones) {
    const std::string name = DcmXfer(syntax).getXferName();
    const DicomPlane plane = read_dicom(write_as(testing::dicom_plane(1), syntax)).planes.at(0);
    EXPECT_EQ(plane.value, plain.value) << name;
    EXPECT_EQ(plane.position, plain.position) << name;
    ASSERT_EQ(plane.runs.size(), plain.runs.size()) << name;
    for (std::size_t r = 0; r < plain.runs.size(); ++r) {
      EXPECT_EQ(plane.runs[r].begin, plain.runs[r].begin) << name;
      EXPECT_EQ(plane.runs[r].count, plain.runs[r].count) << name;
    }
  }
}

TEST_F(DicomSyntax, ACtHasItsHounsfieldUnitsInEachThatIsRead) {
  testing::DicomSet set = testing::dicom_ct_plane(0, -874);
  for (const auto syntax : read_ones) {
    const DicomPlane plane = read_dicom_values(write_as(set, syntax));
    EXPECT_EQ(plane.values.size(), 30u);
    for (const float value : plane.values)
      ASSERT_EQ(value, -874.0f) << DcmXfer(syntax).getXferName();
  }
}

TEST_F(DicomSyntax, StoredNumbersWithASignKeepIt) {
  testing::DicomSet set = testing::dicom_ct_plane(0, -1000 + 2 * 0xff0);
  set[0x00280103] = testing::number_element(1);  // 0xff0 of 12 bits is -16
  EXPECT_EQ(read_dicom_values(write("a.dcm", testing::dicom_file(set))).values.at(7), -1032.0f);
}

TEST_F(DicomSyntax, OthersAreRefusedByName) {
  const auto file = [this](const char* uid) {
    return write("b.dcm", testing::dicom_file(testing::dicom_plane(0), uid));
  };
  EXPECT_NE(words(file("1.2.840.10008.1.2.4.50")).find("JPEGBaseline"), std::string::npos)
      << words(file("1.2.840.10008.1.2.4.50"));
  EXPECT_NE(words(file("1.2.840.10008.1.2.4.90")).find("JPEG2000"), std::string::npos);
  EXPECT_NE(words(file("1.2.3")), "read");
}

TEST_F(DicomSyntax, ACompressedPlaneThatPromisesGigabytesIsRefusedBeforeItIsExpanded) {
  const fs::path path = write_as(testing::dicom_plane(0), EXS_RLELossless);
  std::string bytes = read_file(path);
  for (const char element : {'\x10', '\x11'}) {  // Rows, Columns
    const auto at = bytes.find(std::string{'\x28', '\0', element, '\0', 'U', 'S', '\2', '\0'});
    ASSERT_NE(at, std::string::npos);
    bytes.replace(at + 8, 2, "\xff\xff");
  }
  EXPECT_NE(words(write("c.dcm", bytes)).find("Rows"), std::string::npos);
}

}  // namespace
}  // namespace viscera
