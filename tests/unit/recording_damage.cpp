// Users write history files with scripts of their own, and on disks that may be full. The reader must refuse every kind
// of damage with one clear line.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <hdf5.h>

#include <fstream>
#include <functional>
#include <limits>
#include <map>

#include "proto/files/recording.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/status.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scratch.hpp"

// After damaged metadata HDF5 leaks the objects that it had half opened: a harmless fault of HDF5. The suppression hides
// no fault of ours: a handle that our code forgets to close is no leak to this checker.
// NOLINTNEXTLINE(bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp)
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libhdf5\n";
}

namespace shearbus::files {
namespace {

using test::Scratch;
using testing::AllOf;
using testing::HasSubstr;
namespace fs = std::filesystem;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

// Writes HDF5 files without HistoryWriter, as a user's script would.
class RawFile {
 public:
  explicit RawFile(const fs::path& path) : id_(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT)) {}
  ~RawFile() { H5Fclose(id_); }
  RawFile(const RawFile&) = delete;
  RawFile& operator=(const RawFile&) = delete;

  void put(const char* name, std::vector<hsize_t> shape, const std::vector<double>& values,
           hid_t type = H5T_NATIVE_DOUBLE) {
    const hid_t space =
        shape.empty() ? H5Screate(H5S_SCALAR) : H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr);
    const hid_t dataset = H5Dcreate2(id_, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    if (!values.empty()) H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
    H5Dclose(dataset);
    H5Sclose(space);
  }
  void put_text(const char* name, hsize_t count) {
    const hid_t type = H5Tcopy(H5T_C_S1);
    const hid_t space = H5Screate_simple(1, &count, nullptr);
    H5Dclose(H5Dcreate2(id_, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
    H5Sclose(space);
    H5Tclose(type);
  }
  void put_group(const char* name) { H5Gclose(H5Gcreate2(id_, name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)); }
  void put_start_time(double t0) {
    const hid_t dataset = H5Dopen2(id_, "time", H5P_DEFAULT);
    const hid_t space = H5Screate(H5S_SCALAR);
    const hid_t attribute = H5Acreate2(dataset, "t0", H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, H5P_DEFAULT);
    H5Awrite(attribute, H5T_NATIVE_DOUBLE, &t0);
    H5Aclose(attribute);
    H5Sclose(space);
    H5Dclose(dataset);
  }

 private:
  hid_t id_;
};

// The datasets of a valid history file of three steps and two nodes. Each test replaces some of them.
using Part = std::function<void(RawFile&)>;
using Parts = std::map<std::string, Part>;

// A dataset of this shape, with these values.
Parts::value_type dataset(const std::string& name, std::vector<hsize_t> shape, std::vector<double> values,
                          hid_t type = H5T_NATIVE_DOUBLE) {
  return {name, [=](RawFile& f) { f.put(name.c_str(), shape, values, type); }};
}

const Parts kWhole = {dataset("time", {3}, {1e-9, 2e-9, 3e-9}), dataset("node_id", {2}, {7, 8}, H5T_NATIVE_INT64),
                      dataset("pressure", {3, 2}, {1, 2, 3, 4, 5, 6}), dataset("mass_soft", {2}, {1, 2})};

std::string error_of_reading(const fs::path& path) {
  const wire::Status fault = support::fault_of([&] {
    HistoryReader reader(path);
    std::vector<double> row(reader.nodes());
    for (std::size_t step = 0; step < reader.steps(); ++step) reader.row("pressure", step, row);
    reader.per_node("mass_soft");
  });
  if (fault.ok()) return "no error";
  EXPECT_EQ(fault.code, wire::Code::kInvalidValue);
  const std::string text = describe(fault);
  EXPECT_EQ(text.find('\n'), std::string::npos) << text;
  EXPECT_THAT(text, HasSubstr(path.string()));
  return text;
}

std::string error_of(Parts parts) {
  const Scratch scratch;
  parts.insert(kWhole.begin(), kWhole.end());  // where the test gives none
  {
    RawFile file(scratch / "history.h5");
    for (const char* name : {"time", "node_id", "pressure", "mass_soft"}) parts[name](file);
  }
  return error_of_reading(scratch / "history.h5");
}
// Replaces one dataset by another of this shape, with these values.
std::string error_with(const char* name, std::vector<hsize_t> shape, std::vector<double> values,
                       hid_t type = H5T_NATIVE_DOUBLE) {
  return error_of({dataset(name, std::move(shape), std::move(values), type)});
}

TEST(RecordingDamage, WholeFileIsRead) {
  EXPECT_EQ(error_of({}), "no error");
}

TEST(RecordingDamage, AnyNumericTypeIsConverted) {
  for (const hid_t type : {H5T_IEEE_F32BE, H5T_STD_I16BE, H5T_STD_U8LE, H5T_IEEE_F64BE, H5T_NATIVE_LDOUBLE}) {
    EXPECT_EQ(error_of({dataset("time", {3}, {1, 2, 3}, type), dataset("pressure", {3, 2}, {1, 2, 3, 4, 5, 6}, type),
                        dataset("node_id", {2}, {7, 200}, H5T_STD_U8LE)}),
              "no error");
  }
}

TEST(RecordingDamage, MissingDatasetIsNamed) {
  for (const auto& [name, part] : kWhole)
    EXPECT_THAT(error_of({{name, [](RawFile&) {}}}), HasSubstr("has no dataset /" + name));
}

TEST(RecordingDamage, GroupInPlaceOfDatasetIsRefused) {
  for (const char* name : {"time", "pressure"})
    EXPECT_THAT(error_of({{name, [&](RawFile& f) { f.put_group(name); }}}),
                HasSubstr("/" + std::string(name) + " is not a dataset"));
}

TEST(RecordingDamage, WrongShapeIsToldWithTheRightOne) {
  EXPECT_THAT(error_with("time", {3, 1}, {1, 2, 3}), HasSubstr("/time has shape [3, 1]; expected one dimension, [T]"));
  EXPECT_THAT(error_with("time", {}, {1}), HasSubstr("/time has shape []"));
  EXPECT_THAT(error_with("node_id", {1, 2}, {7, 8}, H5T_NATIVE_INT), HasSubstr("expected one dimension, [N]"));
  EXPECT_THAT(error_with("pressure", {2, 3}, {1, 2, 3, 4, 5, 6}),
              HasSubstr("/pressure has shape [2, 3]; expected [T, N] = [3, 2]"));
  EXPECT_THAT(error_with("pressure", {3}, {1, 2, 3}), HasSubstr("has shape [3]; expected [T, N]"));
  EXPECT_THAT(error_with("pressure", {2, 2}, {1, 2, 3, 4}), HasSubstr("has shape [2, 2]"));
  EXPECT_THAT(error_with("mass_soft", {3}, {1, 2, 3}), HasSubstr("/mass_soft has shape [3]; expected [N] = [2]"));
}

TEST(RecordingDamage, WrongTypeIsRefused) {
  EXPECT_THAT(error_of({{"time", [](RawFile& f) { f.put_text("time", 3); }}}),
              HasSubstr("/time holds text values; expected numbers"));
  EXPECT_THAT(error_of({{"mass_soft", [](RawFile& f) { f.put_text("mass_soft", 2); }}}),
              HasSubstr("/mass_soft holds text"));
  EXPECT_THAT(error_with("node_id", {2}, {7, 8}), HasSubstr("/node_id holds float values; expected integers"));
}

TEST(RecordingDamage, NotFiniteIsNamedByPlace) {
  EXPECT_THAT(error_with("pressure", {3, 2}, {1, 2, 3, kNan, 5, 6}),
              AllOf(HasSubstr("/pressure[1, 1]"), HasSubstr("node 8"), HasSubstr("nan")));
  EXPECT_THAT(error_with("pressure", {3, 2}, {1, 2, 3, 4, -kInf, 6}),
              AllOf(HasSubstr("/pressure[2, 0]"), HasSubstr("node 7"), HasSubstr("-inf")));
  EXPECT_THAT(error_with("mass_soft", {2}, {1, kInf}), HasSubstr("/mass_soft[1] (node 8) is inf"));
  EXPECT_THAT(error_with("time", {3}, {1, kNan, 3}), HasSubstr("/time[1] is nan"));
}

TEST(RecordingDamage, TimesMustIncreaseFromTheStart) {
  const auto from = [](double t0, std::vector<double> time) {
    return error_of({{"time", [&](RawFile& f) { f.put("time", {3}, time), f.put_start_time(t0); }}});
  };
  EXPECT_THAT(error_with("time", {3}, {1, 3, 3}), HasSubstr("/time[2] is 3 s, not after [1] = 3 s"));
  EXPECT_THAT(error_with("time", {3}, {0, 1, 2}), HasSubstr("/time[0] is 0 s, not after the start 0 s"));
  EXPECT_EQ(from(-1, {0, 1, 2}), "no error");
  EXPECT_THAT(from(1, {1, 2, 3}), HasSubstr("not after the start 1 s"));
  EXPECT_THAT(from(kNan, {1, 2, 3}), HasSubstr("t0 = nan"));
}

TEST(RecordingDamage, StepLengthsMustAgreeWithTimes) {
  const auto with_dt = [](const std::vector<double>& dt) {
    return error_of({{"time", [&](RawFile& f) { f.put("time", {3}, {1, 2, 3}), f.put("dt", {dt.size()}, dt); }}});
  };
  EXPECT_EQ(with_dt({1, 1, 1}), "no error");
  EXPECT_THAT(with_dt({1, 1}), HasSubstr("/dt has 2 values, /time 3"));
  EXPECT_THAT(with_dt({1, 1.1, 1}), HasSubstr("/dt[1] is 1.1 s; the step from 1 to 2 s takes 1 s"));
  EXPECT_THAT(with_dt({1, kNan, 1}), HasSubstr("/dt[1] is nan"));
}

TEST(RecordingDamage, NoStepsOrNoNodesIsRefused) {
  EXPECT_THAT(error_with("time", {0}, {}), HasSubstr("/time has no values"));
  EXPECT_THAT(error_with("node_id", {0}, {}, H5T_NATIVE_INT), HasSubstr("/node_id has no values"));
}

TEST(RecordingDamage, NodeIdsAreUniqueAndNotNegative) {
  EXPECT_THAT(error_with("node_id", {2}, {7, -8}, H5T_NATIVE_INT), HasSubstr("/node_id[1] is -8"));
  EXPECT_THAT(error_with("node_id", {2}, {7, 7}, H5T_NATIVE_INT), HasSubstr("/node_id[1] repeats node 7 of [0]"));
}

// A file may state a huge size without storing the data: the reader must check the size before it allocates memory.
TEST(RecordingDamage, AbsurdSizesAreRefusedBeforeTheyAreAllocated) {
  const hsize_t huge = 1'000'000'000'000'000;
  EXPECT_THAT(error_with("node_id", {wire::kMaxNodesPerSession + 1}, {}, H5T_NATIVE_INT), HasSubstr("at most 200000"));
  const Scratch scratch;
  {
    const hid_t file = H5Fcreate((scratch / "h.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    const hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    const hsize_t chunk = 1024;
    H5Pset_chunk(creation, 1, &chunk);
    const hid_t space = H5Screate_simple(1, &huge, nullptr);
    H5Dclose(H5Dcreate2(file, "time", H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, creation, H5P_DEFAULT));
    H5Sclose(space);
    H5Pclose(creation);
    H5Fclose(file);
  }
  EXPECT_THAT(error_of_reading(scratch / "h.h5"), HasSubstr("/time has 1000000000000000 values; at most"));
}

TEST(RecordingDamage, WhatIsNotAHistoryFileIsRefused) {
  const Scratch scratch;
  EXPECT_THAT(error_of_reading(scratch / "absent.h5"), HasSubstr("no such file"));
  EXPECT_THAT(error_of_reading(scratch.path()), HasSubstr("is not a file"));
  std::ofstream(scratch / "empty.h5").close();
  EXPECT_THAT(error_of_reading(scratch / "empty.h5"), HasSubstr("is empty"));
  std::ofstream(scratch / "text.h5") << "time,pressure\n1e-9,1e9\n";
  EXPECT_THAT(error_of_reading(scratch / "text.h5"), HasSubstr("is not an HDF5 file"));
}

fs::path written(const Scratch& scratch, std::size_t steps) {
  fs::path path = scratch / "written.h5";
  const std::vector<std::uint64_t> ids = {7, 8};
  HistoryWriter writer(path, ids, {{.name = "pressure", .units = "Pa", .long_name = "pressure"}}, {});
  writer.add_static({.name = "mass_soft", .units = "kg m-2", .long_name = "mass"}, std::vector{1.0, 2.0});
  for (std::size_t step = 0; step < steps; ++step) {
    writer.begin_row(static_cast<double>(step + 1));
    writer.set(0, std::vector{1e9 + static_cast<double>(step), 2e9});
    writer.end_row();
  }
  writer.close();
  return path;
}

TEST(RecordingDamage, TruncatedFileIsRefused) {
  const Scratch scratch;
  const fs::path path = written(scratch, 100);
  ASSERT_EQ(error_of_reading(path), "no error");
  for (std::uintmax_t size = fs::file_size(path) - 1; size > 0; size = size * 2 / 3) {
    fs::resize_file(path, size);
    EXPECT_NE(error_of_reading(path), "no error") << size << " bytes";
  }
}

// Flips one bit of the stored bytes of a dataset that has a single chunk.
void flip_bit_of_chunk(const fs::path& path, const char* name) {
  haddr_t address = 0;
  hsize_t size = 0;
  std::array<hsize_t, 2> offset{};
  unsigned mask = 0;
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  const hid_t dataset = H5Dopen2(file, name, H5P_DEFAULT);
  const hid_t space = H5Dget_space(dataset);
  ASSERT_GE(H5Dget_chunk_info(dataset, space, 0, offset.data(), &mask, &address, &size), 0);
  H5Sclose(space);
  H5Dclose(dataset);
  H5Fclose(file);
  std::fstream stream(path, std::ios::in | std::ios::out | std::ios::binary);
  stream.seekg(static_cast<std::streamoff>(address + size / 2));
  const int byte = stream.get();
  stream.seekp(static_cast<std::streamoff>(address + size / 2));
  stream.put(static_cast<char>(byte ^ 0x10));
}

TEST(RecordingDamage, FlippedBitOfDataIsCaughtByItsChecksum) {
  const Scratch scratch;
  const fs::path path = written(scratch, 1000);
  flip_bit_of_chunk(path, "pressure");
  EXPECT_THAT(error_of_reading(path), AllOf(HasSubstr("/pressure rows 0 to 999 cannot be read"), HasSubstr("damaged")));
}

TEST(RecordingDamage, FlippedBitOfTimesIsCaughtByItsChecksum) {
  const Scratch scratch;
  const fs::path path = written(scratch, 1000);
  flip_bit_of_chunk(path, "time");
  EXPECT_THAT(error_of_reading(path), HasSubstr("/time cannot be read"));
}

// The test flips one bit at a time, in every seventh byte of a small file. A flipped bit either causes an error or is
// in a byte that the reader does not use: no flip may change a number that is read.
TEST(RecordingDamage, NoFlippedBitGivesOtherNumbers) {
  const Scratch scratch;
  const fs::path path = written(scratch, 3);
  std::ifstream in(path, std::ios::binary);
  const std::string whole((std::istreambuf_iterator<char>(in)), {});
  std::size_t refused = 0, wrong = 0;
  // 7 does not divide the size of any record of the file, so the flips hit all kinds of bytes
  for (std::size_t byte = 0; byte < whole.size(); byte += 7) {
    std::string damaged = whole;
    damaged[byte] = static_cast<char>(damaged[byte] ^ (1 << (byte % 8)));
    std::ofstream(path, std::ios::binary).write(damaged.data(), static_cast<std::streamsize>(damaged.size()));
    try {
      HistoryReader reader(path);
      std::array<double, 2> row{};
      for (std::size_t step = 0; step < 3; ++step) {
        reader.row("pressure", step, row);
        wrong += reader.steps() != 3 || row[0] != 1e9 + static_cast<double>(step) || row[1] != 2e9;
      }
      const std::vector<double> masses = reader.per_node("mass_soft");
      wrong += masses[0] != 1.0 || masses[1] != 2.0;
    } catch (const wire::Error&) {
      ++refused;
    }
  }
  EXPECT_EQ(wrong, 0u);
  EXPECT_GT(refused, 0u);
}

}  // namespace
}  // namespace shearbus::files
