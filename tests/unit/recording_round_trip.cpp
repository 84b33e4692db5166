// A history reader gets exactly what the writer was given. A run that does not finish leaves no file that looks
// complete.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <hdf5.h>

#include <fstream>
#include <limits>
#include <map>
#include <numeric>

#include "proto/files/recording.hpp"
#include "proto/wire/messages.hpp"
#include "proto/wire/status.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scratch.hpp"

namespace shearbus::files {
namespace {

using support::said_by;
using test::Scratch;
using testing::ElementsAre;
using testing::HasSubstr;

const std::vector<Quantity> kQuantities = {
    {.name = "shear_stress", .units = "Pa", .long_name = "shear stress"},
    {.name = "regime", .units = "1", .long_name = "what held the stress", .is_regime = true},
    {.name = "outcome", .units = "1", .long_name = "flags", .is_outcome = true},
};

double value_at(std::size_t step, std::size_t node) {
  return 1.0 / (1.0 + static_cast<double>(step)) + 1e3 * static_cast<double>(node);
}

void write_rows(HistoryWriter& writer, std::size_t steps, std::size_t nodes) {
  std::vector<double> stress(nodes);
  std::vector<std::uint8_t> regime(nodes);
  const std::vector<std::uint8_t> outcome(nodes, wire::kSubstepped);
  for (std::size_t step = 0; step < steps; ++step) {
    for (std::size_t node = 0; node < nodes; ++node) {
      stress[node] = value_at(step, node);
      regime[node] = static_cast<std::uint8_t>((step + node) % 5);
    }
    writer.begin_row(1e-9 * static_cast<double>(step + 1));
    writer.set(0, stress);
    writer.set(1, regime);
    writer.set(2, outcome);
    writer.end_row();
  }
}

std::vector<std::uint64_t> some_ids(std::size_t nodes) {
  std::vector<std::uint64_t> ids(nodes);
  std::iota(ids.begin(), ids.end(), std::uint64_t{1} << 60);
  return ids;
}

void write_file(const Scratch& scratch, std::size_t steps, std::size_t nodes,
                const std::map<std::string, std::string>& meta = {}) {
  HistoryWriter writer(scratch / "history.h5", some_ids(nodes), kQuantities, meta);
  write_rows(writer, steps, nodes);
  writer.close();
}

// Numbers of steps and of nodes just within and beyond the limits of an HDF5 chunk: 8192 values, or a row of up to 65536.
class RecordingSizes : public testing::TestWithParam<std::pair<std::size_t, std::size_t>> {};

TEST_P(RecordingSizes, WhatIsWrittenIsReadToTheLastBit) {
  const auto [steps, nodes] = GetParam();
  const Scratch scratch;
  write_file(scratch, steps, nodes);
  HistoryReader reader(scratch / "history.h5");
  ASSERT_EQ(reader.steps(), steps);
  EXPECT_EQ(reader.node_ids(), some_ids(nodes));
  std::vector<double> row(nodes);
  std::size_t different = 0;
  for (std::size_t step = 0; step < steps; ++step) {
    ASSERT_EQ(reader.times_s()[step], 1e-9 * static_cast<double>(step + 1));
    reader.row("shear_stress", step, row);
    for (std::size_t node = 0; node < nodes; ++node) different += row[node] != value_at(step, node);
  }
  EXPECT_EQ(different, 0u);
  reader.row("shear_stress", 0, row);  // rows can be read in any order, here the first row last
  EXPECT_EQ(row[0], value_at(0, 0));
}

INSTANTIATE_TEST_SUITE_P(AroundChunkEdges, RecordingSizes,
                         testing::Values(std::pair{1, 1}, std::pair{8192, 1}, std::pair{8193, 1}, std::pair{20001, 7},
                                         std::pair{2, 8192}, std::pair{2, 8193}, std::pair{3, 65536},
                                         std::pair{3, 65537}, std::pair{2, 200000}));

// A dataset's values as they are, with a checksum of 4 bytes a chunk, and at most the unused end of one chunk of 64 KiB.
TEST(Recording, AFileIsAsLargeAsItsValues) {
  for (const auto& [steps, nodes] : {std::pair<std::size_t, std::size_t>{3, 2}, {8191, 1}, {700, 30}, {5, 70'000}}) {
    const Scratch scratch;
    write_file(scratch, steps, nodes);
    const hid_t file = H5Fopen((scratch / "history.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
    for (const char* name : {"shear_stress", "regime", "time"}) {
      const hid_t dataset = H5Dopen2(file, name, H5P_DEFAULT);
      const hid_t creation = H5Dget_create_plist(dataset);
      ASSERT_EQ(H5Pget_nfilters(creation), 1) << name;
      EXPECT_GE(H5Pget_filter_by_id2(creation, H5Z_FILTER_FLETCHER32, nullptr, nullptr, nullptr, 0, nullptr, nullptr),
                0);
      H5Pclose(creation);
      const hsize_t stored = H5Dget_storage_size(dataset);
      const hsize_t size = (name[0] == 't' ? 8 : name[0] == 's' ? 8 * nodes : nodes) * steps;
      const hsize_t unused = steps * nodes < 8192 ? 0 : 65'536;
      EXPECT_GE(stored, size) << name;
      EXPECT_LE(stored, size + size / 1000 + 8 + unused) << name << " of " << steps << " steps of " << nodes;
      H5Dclose(dataset);
    }
    H5Fclose(file);
  }
}

TEST(Recording, MetaKeepsShortAndLongTexts) {
  const Scratch scratch;
  const std::string scene = "name = \"long\"\n" + std::string(100'000, '#') + "\n";  // over the 64 KiB of an attribute
  {
    HistoryWriter writer(scratch / "history.h5", some_ids(1), kQuantities,
                         {{"producer", "test"}, {"scene", scene}, {"greek", "\xce\xb8"}, {"empty", ""}}, -2e-9);
    write_rows(writer, 2, 1);
    writer.close({{"summary", "ended well"}});
  }
  const HistoryReader reader(scratch / "history.h5");
  EXPECT_EQ(reader.start_time_s(), -2e-9);
  EXPECT_EQ(reader.meta("format"), "shearbus-history");
  EXPECT_EQ(reader.meta("version"), "1");
  EXPECT_EQ(reader.meta("units_system"), "SI");
  EXPECT_THAT(reader.meta("created").value_or(""),
              testing::MatchesRegex("[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}Z"));
  EXPECT_EQ(reader.meta("producer"), "test");
  EXPECT_EQ(reader.meta("scene"), scene);
  EXPECT_EQ(reader.meta("greek"), "\xce\xb8");
  EXPECT_EQ(reader.meta("empty"), "");
  EXPECT_EQ(reader.meta("summary"), "ended well");
  EXPECT_EQ(reader.meta("absent"), std::nullopt);
}

TEST(Recording, StepLengthsAreTheHostsOwn) {
  const Scratch scratch;
  const double dt = 1e-9 / 3;
  {
    HistoryWriter writer(scratch / "history.h5", some_ids(1), {}, {}, 5e-6);
    double time = 5e-6;
    for (int step = 0; step < 1000; ++step) {
      time += dt;
      writer.begin_row(time, dt);
      writer.end_row();
    }
    EXPECT_THROW(writer.begin_row(time + dt), wire::Error);
    writer.close();
  }
  const HistoryReader reader(scratch / "history.h5");
  EXPECT_THAT(reader.dt_s(), testing::Each(dt));
  // The differences of the rounded times are not exactly dt, so the file also stores the step lengths, in /dt.
  EXPECT_NE(reader.times_s()[500] - reader.times_s()[499], dt);
}

TEST(Recording, StepLengthsAreDifferencesOfTimesOtherwise) {
  const Scratch scratch;
  {
    HistoryWriter writer(scratch / "history.h5", some_ids(1), {}, {}, 1.0);
    for (const double time : {1.5, 2.5, 4.5}) {
      writer.begin_row(time);
      writer.end_row();
    }
    writer.close();
  }
  EXPECT_THAT(HistoryReader(scratch / "history.h5").dt_s(), ElementsAre(0.5, 1.0, 2.0));
}

TEST(Recording, HashOfFileIsThatOfXxhsum) {
  const Scratch scratch;
  std::ofstream(scratch / "empty").close();
  EXPECT_EQ(hash_of_file(scratch / "empty"), "xxh3-64:2d06800538d394c2");  // the published XXH3 value of an empty input
  std::ofstream(scratch / "large") << std::string(3'000'000, 'a');
  std::ofstream(scratch / "other") << std::string(2'999'999, 'a') + "b";
  EXPECT_NE(hash_of_file(scratch / "large"), hash_of_file(scratch / "other"));
  EXPECT_THROW(hash_of_file(scratch / "absent"), wire::Error);
}

TEST(Recording, StaticValuesAreReadPerNode) {
  const Scratch scratch;
  HistoryWriter writer(scratch / "history.h5", some_ids(3), kQuantities, {});
  writer.add_static({.name = "mass_soft", .units = "kg m-2", .long_name = "mass"}, std::vector{1.0, 2.0, 3.0});
  write_rows(writer, 1, 3);
  writer.close();
  const HistoryReader reader(scratch / "history.h5");
  EXPECT_THAT(reader.per_node("mass_soft"), ElementsAre(1.0, 2.0, 3.0));
  EXPECT_TRUE(reader.has("mass_soft"));
  EXPECT_FALSE(reader.has("mass_hard"));
}

TEST(Recording, TextsAndGroupsOfNodesAreReadAsWritten) {
  const Scratch scratch;
  HistoryWriter writer(scratch / "history.h5", some_ids(3), kQuantities, {});
  const std::vector<std::string> names = {"", "copper_steel", "\u00b5"};
  writer.add_texts({.name = "pair", .units = "1", .long_name = "pair"}, names);
  for (const char* key : {"parameter/soft.b", "parameter/interface.a"})
    writer.add_static({.name = key, .units = {}, .long_name = key}, std::vector<double>{1.0, 2.0, 3.0});
  write_rows(writer, 1, 3);
  writer.close();
  const HistoryReader reader(scratch / "history.h5");
  EXPECT_EQ(reader.texts("pair"), names);
  EXPECT_THAT(reader.names_in("parameter"), ElementsAre("interface.a", "soft.b"));
  EXPECT_TRUE(reader.names_in("absent").empty());
  EXPECT_THAT(reader.per_node("parameter/soft.b"), ElementsAre(1.0, 2.0, 3.0));
  EXPECT_THAT(said_by<wire::Error>([&] { static_cast<void>(reader.texts("shear_stress")); }),
              HasSubstr("/shear_stress holds float values; expected texts"));
  EXPECT_THAT(said_by<wire::Error>([&] { static_cast<void>(reader.texts("absent")); }),
              HasSubstr("/absent is not a dataset"));
  EXPECT_THAT(said_by<wire::Error>([&] { static_cast<void>(reader.names_in("pair")); }),
              HasSubstr("/pair is not a group"));
}

TEST(Recording, RegimesAreAnEnumOfBytes) {
  const Scratch scratch;
  write_file(scratch, 1, 5);
  const hid_t file = H5Fopen((scratch / "history.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  const hid_t dataset = H5Dopen2(file, "regime", H5P_DEFAULT);
  const hid_t type = H5Dget_type(dataset);
  EXPECT_EQ(H5Tget_class(type), H5T_ENUM);
  EXPECT_EQ(H5Tget_size(type), 1u);
  std::uint8_t melting = 0;
  EXPECT_GE(H5Tenum_valueof(type, "MELTING", &melting), 0);
  EXPECT_EQ(melting, static_cast<std::uint8_t>(wire::Regime::kMelting));
  std::array<std::uint8_t, 5> values{};
  EXPECT_GE(H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
  EXPECT_THAT(values, ElementsAre(0, 1, 2, 3, 4));
  EXPECT_GT(H5Aexists(dataset, "units"), 0);
  EXPECT_GT(H5Aexists(dataset, "legend"), 0);
  H5Tclose(type);
  H5Dclose(dataset);
  H5Fclose(file);
}

TEST(Recording, InterruptedWriterLeavesNoFile) {
  const Scratch scratch;
  {
    HistoryWriter writer(scratch / "history.h5", some_ids(2), kQuantities, {});
    write_rows(writer, 10, 2);
    EXPECT_FALSE(std::filesystem::is_empty(scratch.path()));
    EXPECT_FALSE(std::filesystem::exists(scratch / "history.h5"));
  }
  EXPECT_TRUE(std::filesystem::is_empty(scratch.path()));
}

TEST(Recording, InterruptedWriterLeavesTheOlderFileAlone) {
  const Scratch scratch;
  write_file(scratch, 1, 1, {{"producer", "older"}});
  {
    HistoryWriter writer(scratch / "history.h5", some_ids(1), kQuantities, {{"producer", "newer"}});
    write_rows(writer, 1, 1);
  }
  EXPECT_EQ(HistoryReader(scratch / "history.h5").meta("producer"), "older");
  write_file(scratch, 1, 1, {{"producer", "newer"}});
  EXPECT_EQ(HistoryReader(scratch / "history.h5").meta("producer"), "newer");
}

TEST(Recording, WriterRefusesWhatItsReaderWouldRefuse) {
  const Scratch scratch;
  EXPECT_THAT(said_by<wire::Error>([&] { HistoryWriter(scratch / "h.h5", {}, kQuantities, {}); }),
              HasSubstr("no nodes"));
  EXPECT_THAT(said_by<wire::Error>([&] { HistoryWriter(scratch / "absent/h.h5", some_ids(1), kQuantities, {}); }),
              HasSubstr("no directory"));
  HistoryWriter writer(scratch / "h.h5", some_ids(2), kQuantities, {});
  EXPECT_THAT(said_by<wire::Error>([&] { writer.set(0, std::vector{1.0, 2.0}); }), HasSubstr("outside a row"));
  EXPECT_THAT(said_by<wire::Error>([&] { writer.begin_row(0.0); }), HasSubstr("must increase"));
  EXPECT_THAT(said_by<wire::Error>([&] { writer.begin_row(std::numeric_limits<double>::quiet_NaN()); }),
              HasSubstr("must increase"));
  writer.begin_row(1e-9);
  EXPECT_THAT(said_by<wire::Error>([&] { writer.set(0, std::vector{1.0}); }),
              HasSubstr("takes 2 values a row, given 1"));
  EXPECT_THAT(said_by<wire::Error>([&] { writer.set(1, std::vector{1.0, 2.0}); }), HasSubstr("takes uint8"));
  writer.set(0, std::vector{1.0, 2.0});
  EXPECT_THAT(said_by<wire::Error>([&] { writer.end_row(); }), HasSubstr("/regime has no values in the row"));
  EXPECT_THAT(said_by<wire::Error>([&] { writer.close(); }), HasSubstr("inside a row"));
}

}  // namespace
}  // namespace shearbus::files
