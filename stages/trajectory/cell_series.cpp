#include "stages/trajectory/cell_series.hpp"

#include <fmt/format.h>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "stages/trajectory/hdf5_file.hpp"
#include "stages/trajectory/xdmf.hpp"

namespace viscera {
namespace fs = std::filesystem;
using namespace hdf5;

struct CellSeriesWriter::File {
  fs::path folder;
  std::string name;
  std::vector<std::string> fields;
  std::size_t points, tets;
  fs::path path;
  Handle file;
  std::vector<double> times_s;
};

CellSeriesWriter::CellSeriesWriter(const fs::path& folder, const std::string& name,
                                   std::vector<std::string> fields, std::size_t points,
                                   std::size_t tets) {
  const QuietHdf5 quiet;
  const fs::path path = folder / (name + ".h5");
  Handle file = create_hdf5(path);
  for (const std::string& field : fields) {
    const Handle creation(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
    H5Pset_obj_track_times(creation.id(), false);
    const Handle group(
        H5Gcreate2(file.id(), field.c_str(), H5P_DEFAULT, creation.id(), H5P_DEFAULT), H5Gclose);
    if (!group.valid()) throw write_error(path, field);
  }
  file_ = std::make_unique<File>(
      File{folder, name, std::move(fields), points, tets, path, std::move(file), {}});
}

CellSeriesWriter::~CellSeriesWriter() = default;

void CellSeriesWriter::append(double time_s, std::span<const std::vector<float>> values) {
  const QuietHdf5 quiet;
  File& f = *file_;
  const hsize_t tets = f.tets;
  const Handle space(H5Screate_simple(1, &tets, nullptr), H5Sclose);
  const Handle creation = deflated_dataset({tets});
  for (std::size_t k = 0; k < f.fields.size(); ++k) {
    const std::string name = fmt::format("/{}/{}", f.fields[k], f.times_s.size());
    if (values[k].size() != f.tets) {
      throw Error(ExitCode::internal, {.where = f.path.string(),
                                       .field = name,
                                       .found = fmt::format("{} values", values[k].size()),
                                       .allowed = fmt::format("{}, one a tet", f.tets)});
    }
    const Handle set(H5Dcreate2(f.file.id(), name.c_str(), H5T_IEEE_F32LE, space.id(), H5P_DEFAULT,
                                creation.id(), H5P_DEFAULT),
                     H5Dclose);
    if (!set.valid() ||
        H5Dwrite(set.id(), H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, values[k].data()) < 0) {
      throw write_error(f.path, name);
    }
  }
  f.times_s.push_back(time_s);
}

void CellSeriesWriter::finish() {
  File& f = *file_;
  if (!f.file.reset()) throw write_error(f.path, "file");
  write_atomically(f.folder / (f.name + ".xdmf"),
                   xdmf(f.points, f.tets, f.times_s, f.name + ".h5", f.fields));
}

}  // namespace viscera
