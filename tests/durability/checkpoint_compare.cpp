// Tests of the comparison of two checkpoints: it returns an empty text if the states have the same bits, otherwise a
// text that names the first difference.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "server/store/compare.hpp"
#include "tests/support/durable_server.hpp"
#include "tests/support/scratch.hpp"

namespace shearbus::service {
namespace {

using ::testing::HasSubstr;

const std::vector<std::uint64_t> kNodes = support::node_ids(12);

class Compare : public testing::Test {
 protected:
  // Writes a checkpoint of a session after three steps. `change` alters the inputs of the last step.
  template <typename Change>
  std::filesystem::path checkpoint(std::uint8_t session, Change change, bool trial = false,
                                   const v1::Scene& scene = support::velocity_scene()) {
    support::MemoryStorage disk;
    DurableServer server(disk);
    EXPECT_TRUE(server.ask(ServiceHarness::opening(scene, kNodes, session)).reply.status.ok());
    for (std::uint64_t i = 1; i <= 3; ++i) {
      wire::Batch columns = support::step_columns(support::strategy_of(scene), kNodes, static_cast<int>(i));
      if (i == 3) change(columns);
      const auto mode = trial && i == 3 ? wire::Mode::kTrial : wire::Mode::kAdvance;
      EXPECT_TRUE(server.ask(ServiceHarness::step(i, std::move(columns), mode, session)).reply.status.ok());
    }
    EXPECT_TRUE(server.service.checkpoint());
    const auto bytes = disk.bytes(store::checkpoint_name(1));
    const auto file = scratch_ / ("copy" + std::to_string(files_++));
    std::ofstream(file, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    return file;
  }
  static void nothing(wire::Batch&) {}

  test::Scratch scratch_;
  int files_ = 0;
};

TEST_F(Compare, TheSameStatesAreTheSameInAnySession) {
  const auto a = checkpoint(1, nothing);
  EXPECT_EQ(store::first_difference(a, a), "");
  EXPECT_EQ(store::first_difference(a, checkpoint(1, nothing)), "");
  EXPECT_EQ(store::first_difference(a, checkpoint(2, nothing)), "") << "another run draws another id";
}

TEST_F(Compare, TheFirstNodeAndQuantityThatDifferAreNamed) {
  const auto a = checkpoint(1, nothing);
  const auto b = checkpoint(2, [](wire::Batch& columns) { columns.f64(wire::Field::kVelocityJump)[7] *= 1 + 1e-12; });
  const std::string text = store::first_difference(a, b);
  EXPECT_THAT(text, HasSubstr("session 01010101, node " + std::to_string(kNodes[7]) + ", temperature_k"));
  EXPECT_THAT(text, HasSubstr(" K"));
  EXPECT_NE(store::first_difference(b, a), "");
}

TEST_F(Compare, WithoutAProfileTheModesAreCompared) {
  const v1::Scene scene = support::modes_scene();
  const auto a = checkpoint(1, nothing, false, scene);
  EXPECT_EQ(store::first_difference(a, checkpoint(2, nothing, false, scene)), "");
  const auto b = checkpoint(
      1, [](wire::Batch& columns) { columns.f64(wire::Field::kVelocityJump)[7] *= 1 + 1e-12; }, false, scene);
  EXPECT_THAT(store::first_difference(a, b), HasSubstr("node " + std::to_string(kNodes[7]) + ", heat_modes_k"));
}

TEST_F(Compare, WhatIsNotOfOneNodeIsNamedToo) {
  const auto a = checkpoint(1, nothing);
  EXPECT_THAT(store::first_difference(a, checkpoint(1, nothing, true)), HasSubstr("state version: 3 and 2"));
  support::MemoryStorage disk;
  DurableServer empty(disk);
  ASSERT_TRUE(empty.service.checkpoint());
  const auto bytes = disk.bytes(store::checkpoint_name(1));
  const auto none = scratch_ / "none";
  std::ofstream(none, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  EXPECT_THAT(store::first_difference(a, none), HasSubstr("session 01010101 is in " + a.string() + " only"));
  EXPECT_THAT(store::first_difference(none, a), HasSubstr("session 01010101 is in " + a.string() + " only"));
}

TEST_F(Compare, ADamagedFileIsNoCheckpoint) {
  const auto a = checkpoint(1, nothing);
  const auto b = scratch_ / "b";
  std::filesystem::copy_file(a, b);
  std::filesystem::resize_file(b, std::filesystem::file_size(b) - 1);
  EXPECT_THROW(store::first_difference(a, b), store::DamagedFile);
  EXPECT_THROW(store::first_difference(a, scratch_ / "absent"), std::runtime_error);
}

}  // namespace
}  // namespace shearbus::service
