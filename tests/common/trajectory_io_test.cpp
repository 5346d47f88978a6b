#include "stages/trajectory/trajectory_io.hpp"

#include <gtest/gtest.h>
#include <hdf5.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <functional>
#include <limits>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "stages/trajectory/hdf5_file.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

// Two tets that share a face, of two materials; the second name is longer and not ASCII.
TetMesh two_tets() {
  TetMesh mesh;
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}};
  mesh.tets = {{0, 1, 2, 3}, {1, 4, 2, 3}};
  mesh.labels = {1, 7};
  mesh.label_names = {{1, "liver"}, {7, "größter Tumor"}};
  return mesh;
}

std::vector<float> frame_of(const TetMesh& mesh, double time) {
  std::vector<float> positions;
  for (const auto& p : mesh.points) {
    for (const double x : p) positions.push_back(static_cast<float>(x + 0.25 * time));
  }
  return positions;
}

void write_frames(const fs::path& folder, const TetMesh& mesh, int frames) {
  TrajectoryWriter writer(folder, mesh);
  for (int i = 0; i < frames; ++i) writer.append(0.04 * i, frame_of(mesh, 0.04 * i));
  writer.finish();
}

void expect_bad_input(const fs::path& path) {
  try {
    const TrajectoryReader reader(path);
    for (std::size_t i = 0; i < reader.times_s().size(); ++i) reader.positions_mm(i);
    FAIL() << path << " was accepted";
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::bad_input);
    EXPECT_NE(std::string(e.what()).find(path.string()), std::string::npos) << e.what();
  }
}

class TrajectoryIo : public testing::Test {
 protected:
  TemporaryFolder folder_{fs::temp_directory_path()};
  fs::path h5_ = folder_.path() / "trajectory.h5";
};

TEST_F(TrajectoryIo, WhatWasWrittenIsRead) {
  const TetMesh mesh = two_tets();
  write_frames(folder_.path(), mesh, 3);
  const TrajectoryReader reader(h5_);
  EXPECT_EQ(reader.mesh().points, mesh.points);
  EXPECT_EQ(reader.mesh().tets, mesh.tets);
  EXPECT_EQ(reader.mesh().labels, mesh.labels);
  EXPECT_EQ(reader.mesh().label_names, mesh.label_names);
  EXPECT_EQ(reader.times_s(), (std::vector<double>{0.0, 0.04, 0.08}));
  EXPECT_EQ(reader.positions_mm(2), frame_of(mesh, 0.08));
  EXPECT_EQ(reader.positions_mm(0), frame_of(mesh, 0.0));
}

TEST_F(TrajectoryIo, EqualContentGivesEqualBytes) {
  write_frames(folder_.path(), two_tets(), 4);
  const std::string first = read_file(h5_);
  sleep(1);  // HDF5 stamps whole seconds where it stamps
  write_frames(folder_.path(), two_tets(), 4);
  EXPECT_EQ(read_file(h5_), first);
}

TEST_F(TrajectoryIo, XdmfNamesTheH5BesideItOncePerFrame) {
  write_frames(folder_.path(), two_tets(), 2);
  const std::string text = read_file(folder_.path() / "trajectory.xdmf");
  EXPECT_NE(text.find(">trajectory.h5:/frames/0<"), std::string::npos);
  EXPECT_NE(text.find(">trajectory.h5:/frames/1<"), std::string::npos);
  EXPECT_NE(text.find("<Time Value=\"0.04\"/>"), std::string::npos);
  EXPECT_EQ(text.find(folder_.path().string()), std::string::npos);
}

TEST_F(TrajectoryIo, TheViewThatXdmfNamesIsTheFrame) {
  const TetMesh mesh = two_tets();
  write_frames(folder_.path(), mesh, 3);
  const hid_t file = H5Fopen(h5_.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  const hid_t view = H5Dopen2(file, "/frames/2", H5P_DEFAULT);
  ASSERT_GE(view, 0);
  std::vector<float> positions(3 * mesh.points.size());
  EXPECT_GE(H5Dread(view, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, positions.data()), 0);
  EXPECT_EQ(positions, frame_of(mesh, 0.08));
  H5Dclose(view);
  H5Fclose(file);
}

// A limit on the file's size stands in for a full disk. Frames are written while the run goes on.
TEST_F(TrajectoryIo, AFrameForWhichThereIsNoRoomIsSaidBeforeTheRunEnds) {
  const auto ignored = std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const TetMesh mesh = two_tets();
  {
    TrajectoryWriter writer(folder_.path(), mesh);
    writer.append(0.0, frame_of(mesh, 0.0));
    writer.append(0.04, frame_of(mesh, 0.04));
    rlimit limit = before;
    limit.rlim_cur = fs::file_size(h5_);
    setrlimit(RLIMIT_FSIZE, &limit);
    try {
      for (int i = 2; i < 2000; ++i) writer.append(0.04 * i, frame_of(mesh, 0.04 * i));
      writer.finish();
      ADD_FAILURE() << "no frame was refused";
    } catch (const Error& e) {
      EXPECT_NE(std::string(e.what()).find(h5_.string()), std::string::npos) << e.what();
    }
  }
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, ignored);
}

TEST_F(TrajectoryIo, ATrajectoryMayHaveNoFramesYet) {
  write_frames(folder_.path(), two_tets(), 0);
  EXPECT_TRUE(TrajectoryReader(h5_).times_s().empty());
}

TEST_F(TrajectoryIo, AbsentForeignAndTruncatedFilesAreBadInput) {
  expect_bad_input(folder_.path() / "absent.h5");
  write_atomically(folder_.path() / "foreign.h5", "solid liver\n");
  expect_bad_input(folder_.path() / "foreign.h5");
  write_frames(folder_.path(), two_tets(), 20);
  const std::string whole = read_file(h5_);
  for (const double part : {0.0, 0.1, 0.5, 0.9, 0.999}) {
    const auto size = static_cast<std::size_t>(part * static_cast<double>(whole.size()));
    write_atomically(folder_.path() / "cut.h5", whole.substr(0, size));
    expect_bad_input(folder_.path() / "cut.h5");
  }
}

TEST_F(TrajectoryIo, MoreRowsThanAreStoredAreBadInputAtOnce) {
  for (const hsize_t rows : {hsize_t{1} << 30, hsize_t{1} << 62}) {
    write_frames(folder_.path(), two_tets(), 3);
    const hid_t file = H5Fopen(h5_.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t times = H5Dopen2(file, "/times", H5P_DEFAULT);
    EXPECT_GE(H5Dset_extent(times, &rows), 0);
    H5Dclose(times);
    H5Fclose(file);
    expect_bad_input(h5_);
  }
}

// HDF5 unpacks a whole chunk to read one value of it.
TEST_F(TrajectoryIo, ChunksFarLargerThanWhatIsReadAreBadInput) {
  const auto with_chunks_of = [this](hsize_t values) {
    write_frames(folder_.path(), two_tets(), 2);
    const hid_t file = H5Fopen(h5_.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(creation, 1, &values);
    H5Pset_deflate(creation, 1);
    const hsize_t count = 2, any = H5S_UNLIMITED;
    const hid_t space = H5Screate_simple(1, &count, &any);
    H5Ldelete(file, "/times", H5P_DEFAULT);
    const hid_t times =
        H5Dcreate2(file, "/times", H5T_IEEE_F64LE, space, H5P_DEFAULT, creation, H5P_DEFAULT);
    const double seconds[] = {0.0, 0.04};
    EXPECT_GE(H5Dwrite(times, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, seconds), 0);
    H5Dclose(times);
    H5Sclose(space);
    H5Pclose(creation);
    H5Fclose(file);
  };
  constexpr hsize_t most = 32 * 1024 * 1024 / sizeof(double);
  with_chunks_of(most);  // as h5repack makes them
  EXPECT_EQ(TrajectoryReader(h5_).times_s(), (std::vector<double>{0.0, 0.04}));
  with_chunks_of(most + 1);
  try {
    const TrajectoryReader reader(h5_);
    FAIL() << "was accepted";
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::bad_input);
    EXPECT_EQ(e.problem().where, h5_.string());
    EXPECT_EQ(e.problem().field, "/times");
    EXPECT_EQ(e.problem().found, "chunks [4194305] of 33554440 bytes");
    EXPECT_EQ(e.problem().allowed, "chunks of at most 33554432 bytes");
  }
}

// Bodies of three million points have frames of more than 32 MiB. Nothing is written here, so it
// takes no memory.
TEST_F(TrajectoryIo, AChunkHoldsOneFrameHoweverLarge) {
  const hsize_t points = 3'000'000, none[] = {0, points, 3}, any[] = {H5S_UNLIMITED, points, 3};
  for (const hsize_t frames : {1, 2}) {
    const hdf5::Handle file = hdf5::create_hdf5(h5_);
    const hdf5::Handle space(H5Screate_simple(3, none, any), H5Sclose);
    const hdf5::Handle creation = hdf5::untimed_dataset();
    const hsize_t chunk[] = {frames, points, 3};
    H5Pset_chunk(creation.id(), 3, chunk);
    H5Dclose(H5Dcreate2(file.id(), "/positions", H5T_IEEE_F32LE, space.id(), H5P_DEFAULT,
                        creation.id(), H5P_DEFAULT));
    const auto open = [&] {
      hdf5::open_dataset(file, h5_, "/positions", H5T_FLOAT, {0, points, 3});
    };
    if (frames == 1) {
      EXPECT_NO_THROW(open());
    } else {
      EXPECT_THROW(open(), Error);
    }
  }
}

// HDF5 1.10 itself crashes on some of these, such as a chunk of which one side is 0.
TEST_F(TrajectoryIo, DamagedHeadersOfDatasetsCrashNobody) {
  write_frames(folder_.path(), two_tets(), 8);
  const std::string whole = read_file(h5_);
  const fs::path damaged = folder_.path() / "damaged.h5";
  int refused = 0;
  for (std::size_t i = 4096; i < 5600; ++i) {
    if (whole.at(i) == 0) continue;
    std::string bytes = whole;
    bytes[i] = 0;
    write_atomically(damaged, bytes);
    try {
      const TrajectoryReader reader(damaged);
      for (std::size_t f = 0; f < reader.times_s().size(); ++f) reader.positions_mm(f);
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::bad_input) << e.what();
      ++refused;
    }
  }
  EXPECT_GT(refused, 50);
}

TEST_F(TrajectoryIo, CoordinatesThatAreNotFiniteAreBadInput) {
  TetMesh mesh = two_tets();
  mesh.points[3][1] = std::numeric_limits<double>::quiet_NaN();
  write_frames(folder_.path(), mesh, 1);
  expect_bad_input(h5_);
}

TEST_F(TrajectoryIo, TetsThatNameAbsentPointsAreBadInput) {
  TetMesh mesh = two_tets();
  mesh.tets[1][2] = 5;
  write_frames(folder_.path(), mesh, 1);
  expect_bad_input(h5_);
}

// HDF5 follows them into other files, and one that shows itself without end.
TEST_F(TrajectoryIo, DatasetsWhoseValuesAreElsewhereAreBadInput) {
  const hsize_t count = 2, five = 5;
  const auto replace_times = [&](const std::function<void(hid_t file, hid_t creation)>& by) {
    write_frames(folder_.path(), two_tets(), 2);
    const hid_t file = H5Fopen(h5_.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    H5Ldelete(file, "/times", H5P_DEFAULT);
    by(file, creation);
    H5Pclose(creation);
    H5Fclose(file);
    expect_bad_input(h5_);
  };
  const auto create = [](hid_t file, hid_t creation, hid_t space) {
    H5Dclose(H5Dcreate2(file, "/times", H5T_IEEE_F64LE, space, H5P_DEFAULT, creation, H5P_DEFAULT));
    H5Sclose(space);
  };
  write_atomically(folder_.path() / "sixteen", "16 bytes to read");
  replace_times([&](hid_t file, hid_t creation) {
    H5Pset_external(creation, (folder_.path() / "sixteen").c_str(), 0, 16);
    create(file, creation, H5Screate_simple(1, &count, nullptr));
  });
  replace_times([&](hid_t file, hid_t creation) {
    const hid_t space = H5Screate_simple(1, &five, nullptr);
    H5Pset_virtual(creation, space, ".", "/times", space);
    create(file, creation, space);
  });
  fs::copy_file(h5_, folder_.path() / "other.h5");
  replace_times([&](hid_t file, hid_t) {
    H5Lcreate_external("other.h5", "/labels", file, "/times", H5P_DEFAULT, H5P_DEFAULT);
  });
  replace_times([&](hid_t file, hid_t) {
    H5Lcreate_soft("/times", file, "/times", H5P_DEFAULT, H5P_DEFAULT);
  });
}

TEST_F(TrajectoryIo, AMeshWithoutPointsOrTetsIsBadInput) {
  for (const auto& [name, width] : {std::pair("/points", 3), {"/tets", 4}}) {
    write_frames(folder_.path(), two_tets(), 1);
    const hid_t file = H5Fopen(h5_.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t type = width == 3 ? H5T_IEEE_F64LE : H5T_STD_I32LE;
    const hsize_t none[] = {0, static_cast<hsize_t>(width)};
    const hid_t space = H5Screate_simple(2, none, nullptr);
    H5Ldelete(file, name, H5P_DEFAULT);
    H5Dclose(H5Dcreate2(file, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
    H5Sclose(space);
    H5Fclose(file);
    try {
      const TrajectoryReader reader(h5_);
      FAIL() << name << " was accepted";
    } catch (const Error& e) {
      EXPECT_EQ(e.problem().field, name);
      EXPECT_EQ(e.problem().found.substr(0, 3), "no ");
    }
  }
}

TEST_F(TrajectoryIo, AnUnwritableFolderIsRefusedByName) {
  try {
    TrajectoryWriter writer("/proc/nowhere", two_tets());
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::usage);
    EXPECT_NE(std::string(e.what()).find("/proc/nowhere"), std::string::npos);
  }
}

// All but the frame at hand, which may be there too.
TEST_F(TrajectoryIo, AKilledWriterLeavesItsFramesReadable) {
  const TetMesh mesh = two_tets();
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    TrajectoryWriter writer(folder_.path(), mesh);
    for (int i = 0; i < 6; ++i) writer.append(0.04 * i, frame_of(mesh, 0.04 * i));
    raise(SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  const TrajectoryReader reader(h5_);
  ASSERT_GE(reader.times_s().size(), 5u);
  EXPECT_EQ(reader.positions_mm(4), frame_of(mesh, 0.16));
  EXPECT_FALSE(fs::exists(folder_.path() / "trajectory.xdmf"));
}

}  // namespace
}  // namespace viscera
