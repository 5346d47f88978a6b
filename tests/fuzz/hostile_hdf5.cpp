#include "tests/fuzz/hostile_hdf5.hpp"

#include <algorithm>
#include <limits>

#include "stages/trajectory/hdf5_file.hpp"

namespace viscera::fuzz {
namespace {

using hdf5::Handle;

constexpr double max_bytes = 1 << 16;  // of values that are written

// Around 2^31, 2^32 and 2^63 sizes wrap.
constexpr hsize_t extents[] = {0,
                               1,
                               2,
                               3,
                               4,
                               5,
                               100,
                               1 << 16,
                               hsize_t{1} << 30,
                               (hsize_t{1} << 31) + 1,
                               (hsize_t{1} << 32) + 1,
                               hsize_t{1} << 61,
                               (hsize_t{1} << 62) + 1};

constexpr double odd_values[] = {-1.0,
                                 0.0,
                                 5.0,
                                 65536.0,
                                 2147483647.0,
                                 4294967297.0,
                                 1e39,
                                 -1e300,
                                 std::numeric_limits<double>::infinity(),
                                 std::numeric_limits<double>::quiet_NaN()};

Handle text_type(std::size_t bytes) {
  Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type.id(), bytes);
  return type;
}

Handle copy(hid_t type) {
  return Handle(H5Tcopy(type), H5Tclose);
}

Handle compound() {
  Handle type(H5Tcreate(H5T_COMPOUND, 16), H5Tclose);
  H5Tinsert(type.id(), "a", 0, H5T_NATIVE_DOUBLE);
  H5Tinsert(type.id(), "b", 8, H5T_NATIVE_INT);
  return type;
}

// A real of few bits, its exponent where it likes.
Handle small_real(Choices& choices) {
  Handle type = copy(H5T_IEEE_F32LE);
  H5Tset_fields(type.id(), 15, 10, 5, 0, 10);
  H5Tset_precision(type.id(), 16);
  H5Tset_ebias(type.id(), choices.byte());
  return type;
}

Handle any_type(Choices& choices) {
  switch (choices.byte() % 14) {
    case 0:
      return copy(H5T_IEEE_F32BE);
    case 1:
      return copy(H5T_IEEE_F64LE);
    case 2:
      return copy(H5T_STD_I8LE);
    case 3:
      return copy(H5T_STD_U64BE);
    case 4:
      return copy(H5T_STD_I64LE);
    case 5:
      return copy(H5T_STD_B32LE);
    case 6:
      return text_type(1 + choices.byte());
    case 7:
      return text_type(H5T_VARIABLE);
    case 8:
      return compound();
    case 9:
      return Handle(H5Tcreate(H5T_OPAQUE, 1 + choices.byte()), H5Tclose);
    case 10:
      return Handle(H5Tenum_create(H5T_NATIVE_INT), H5Tclose);
    case 11:
      return Handle(H5Tvlen_create(H5T_NATIVE_DOUBLE), H5Tclose);
    case 12:
      return copy(H5T_STD_REF_OBJ);
    default:
      return small_real(choices);
  }
}

void change_shape(std::vector<hsize_t>& shape, Choices& choices) {
  if (choices.byte() % 2 == 0) shape.assign(choices.byte() % 5, 1);
  for (hsize_t& n : shape)
    if (choices.byte() % 2 == 0) n = choices.one_of(extents);
}

Handle space_of(std::vector<hsize_t>& shape, bool grows, Choices& choices) {
  if (choices.rarely()) return Handle(H5Screate(H5S_NULL), H5Sclose);
  std::vector<hsize_t> limit = shape;
  if (grows && !limit.empty()) limit[0] = H5S_UNLIMITED;
  return Handle(H5Screate_simple(static_cast<int>(shape.size()), shape.data(), limit.data()),
                H5Sclose);
}

// How the values are stored: in chunks, packed, within the header, or not in this file.
void choose_storage(hid_t creation, const std::vector<hsize_t>& shape, Choices& choices) {
  switch (choices.byte() % 8) {
    case 0:
      H5Pset_layout(creation, H5D_COMPACT);
      break;
    case 1:
      H5Pset_external(creation, "/dev/zero", 0, H5F_UNLIMITED);
      break;
    case 2: {
      Handle source(H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr),
                    H5Sclose);
      H5Pset_virtual(creation, source.id(), ".", choices.rarely() ? "/points" : "/u", source.id());
      break;
    }
    default: {
      std::vector<hsize_t> chunk = shape;
      for (hsize_t& n : chunk) n = std::clamp<hsize_t>(n, 1, 1 + choices.byte());
      H5Pset_chunk(creation, static_cast<int>(chunk.size()), chunk.data());
      if (choices.byte() % 2 == 0) H5Pset_shuffle(creation);
      if (choices.byte() % 2 == 0) H5Pset_deflate(creation, 1);
      if (choices.byte() % 2 == 0) H5Pset_fletcher32(creation);
    }
  }
}

// What stands under the name is no dataset of this file.
void link_instead(hid_t file, const char* name, Choices& choices) {
  switch (choices.byte() % 4) {
    case 0:
      H5Lcreate_soft(name, file, name, H5P_DEFAULT, H5P_DEFAULT);
      break;
    case 1:
      H5Lcreate_external("/dev/zero", "/u", file, name, H5P_DEFAULT, H5P_DEFAULT);
      break;
    case 2:
      H5Gclose(H5Gcreate2(file, name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
      break;
    default:
      break;  // nothing
  }
}

void write_values(hid_t set, const Expected& expected, const std::vector<hsize_t>& shape,
                  Choices& choices) {
  const Handle type(H5Dget_type(set), H5Tclose);
  const Handle space(H5Dget_space(set), H5Sclose);
  const hssize_t count = H5Sget_simple_extent_npoints(space.id());
  const std::size_t bytes = H5Tget_size(type.id());
  const auto kind = H5Tget_class(type.id());
  // The library's count wraps around: extents of 2^62 and 4 are none to it.
  double claimed = static_cast<double>(std::max<std::size_t>(bytes, 8));
  for (const hsize_t n : shape) claimed *= static_cast<double>(n);
  if (count <= 0 || claimed > max_bytes) return;
  if (kind == H5T_INTEGER || kind == H5T_FLOAT) {
    std::vector<double> values = expected.values;
    values.resize(static_cast<std::size_t>(count));
    for (int change = choices.byte() % 16 - 12; change > 0; --change)
      values[choices.byte() % values.size()] = choices.one_of(odd_values);
    H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  } else if (kind == H5T_STRING && H5Tis_variable_str(type.id()) <= 0) {
    std::string text = expected.text;
    text.resize(static_cast<std::size_t>(count) * bytes);
    for (int change = choices.byte() % 16 - 12; change > 0; --change)
      text[choices.byte() % text.size()] = static_cast<char>(choices.byte());
    H5Dwrite(set, type.id(), H5S_ALL, H5S_ALL, H5P_DEFAULT, text.data());
  }
}

void write_dataset(hid_t file, const Expected& expected, Choices& choices) {
  if (choices.rarely()) return link_instead(file, expected.name, choices);
  std::vector<hsize_t> shape = expected.shape;
  if (choices.rarely()) change_shape(shape, choices);
  const Handle type = choices.rarely() ? any_type(choices)
                      : expected.text_bytes > 0
                          ? text_type(expected.text_bytes)
                          : copy(expected.real ? H5T_IEEE_F64LE : H5T_STD_I32LE);
  const Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  const bool stored_otherwise = choices.rarely();
  if (stored_otherwise) choose_storage(creation.id(), shape, choices);
  const bool grows = stored_otherwise && H5Pget_layout(creation.id()) == H5D_CHUNKED;
  const Handle space = space_of(shape, grows, choices);
  const Handle set(H5Dcreate2(file, expected.name, type.id(), space.id(), H5P_DEFAULT,
                              creation.id(), H5P_DEFAULT),
                   H5Dclose);
  if (!set.valid() || choices.rarely()) return;  // nothing is written
  if (H5Pget_external_count(creation.id()) == 0 && H5Pget_layout(creation.id()) != H5D_VIRTUAL)
    write_values(set.id(), expected, shape, choices);
  if (!grows || shape.empty() || !choices.rarely()) return;
  shape[0] = choices.one_of(extents);
  H5Dset_extent(set.id(), shape.data());
}

}  // namespace

void write_hostile_hdf5(const std::filesystem::path& path, hsize_t user_bytes,
                        const std::vector<Expected>& datasets, Choices& choices) {
  const hdf5::QuietHdf5 quiet;
  const Handle file = hdf5::create_hdf5(path, user_bytes);
  for (const Expected& expected : datasets) write_dataset(file.id(), expected, choices);
}

}  // namespace viscera::fuzz
