// Tests of nodes for which the solver finds no answer. No input that a server accepts makes the solver fail. The tests
// therefore write a checkpoint in which a state is NaN, and recover from it. The solver then fails, and the same code
// as in production handles the failure.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>

#include "server/capsule_replay.hpp"
#include "server/store/checkpoint.hpp"
#include "shearbus_places.hpp"
#include "tests/support/durable_server.hpp"
#include "tests/support/scratch.hpp"
#include "tests/support/server_process.hpp"

namespace shearbus::service {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kNodes = 11;
constexpr std::size_t kBadRow = 4;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

void write_file(const std::filesystem::path& file, std::span<const std::byte> bytes) {
  std::ofstream(file, std::ios::binary).write(reinterpret_cast<const char*>(bytes.data()), std::ssize(bytes));
}

store::Snapshot snapshot_of(MemoryStorage& disk, std::uint64_t generation) {
  const std::string name = store::checkpoint_name(generation);
  return store::read_checkpoint(disk.bytes(name), name, generation);
}

wire::Request step(Strategy strategy, std::uint64_t sequence, int number, Policy policy, Mode mode = Mode::kAdvance,
                   bool commit_previous = false) {
  wire::Request request =
      ServiceHarness::step(sequence, support::step_columns(strategy, support::node_ids(kNodes), number), mode);
  auto& body = std::get<wire::Downscale>(request.body);
  body.policy = policy;
  body.commit_previous = commit_previous;
  body.step = static_cast<std::uint64_t>(number);
  return request;
}

// A scene, and the name of a column of its state: a NaN in this column makes the solver fail in the next step.
struct Kind {
  const char* name;
  Strategy strategy;
  bool modes;
  const char* column;
  bool controlled = false;  // true: the scene has a tolerance

  operator Strategy() const { return strategy; }  // NOLINT(google-explicit-constructor)
  v1::Scene scene() const {
    v1::Scene scene = modes ? support::modes_scene() : support::scene_of(strategy);
    if (controlled) {
      scene.clear_layer();
      scene.mutable_layer();

      scene.set_tolerance(1e-2);
    }
    return scene;
  }
};

class Failures : public testing::TestWithParam<Kind> {
 protected:
  // Runs a server with one session on `disk` for three steps, and writes a checkpoint.
  void prepare(MemoryStorage& disk) {
    DurableServer server(disk);
    server.ask(ServiceHarness::opening(GetParam().scene(), support::node_ids(kNodes)));
    for (int i = 0; i < 3; ++i)
      server.ask(step(GetParam(), static_cast<std::uint64_t>(i) + 1, i, Policy::kUnspecified));
    ASSERT_TRUE(server.service.checkpoint());
  }
  // Runs prepare(), and then sets one temperature or one mode amplitude of the node in row kBadRow of the checkpoint to
  // NaN.
  void prepare_damaged(MemoryStorage& disk) {
    prepare(disk);
    store::Snapshot snapshot = snapshot_of(disk, 1);
    for (shard::StateColumn& column : snapshot.sessions.front().committed.columns)
      if (column.name == GetParam().column) column.values[kBadRow * column.width + 2] = kNan;
    disk.put(store::checkpoint_name(1), store::checkpoint_bytes(snapshot, 1));
  }
  // Returns a copy of a capsule, the file that records a step without an answer, with a number in place of the NaN. The
  // step then has an answer, which differs from the recorded failure.
  static std::vector<std::byte> mended(std::span<const std::byte> recorded) {
    store::Capsule capsule = store::read_capsule(recorded, "capsule");
    for (shard::StateColumn& column : capsule.state.columns)
      if (column.name == GetParam().column) column.values[2] = GetParam().modes ? 0.0 : 300.0;
    return store::capsule_bytes(capsule);
  }
  static std::vector<std::string> capsules(const MemoryStorage& disk) {
    std::vector<std::string> found;
    for (const std::string& name : disk.names())
      if (name.starts_with("capsule-")) found.push_back(name);
    return found;
  }
};
INSTANTIATE_TEST_SUITE_P(Strategies, Failures,
                         testing::Values(Kind{"VelocityDriven", Strategy::kVelocityDriven, false, "temperature_k"},
                                         Kind{"ForceDriven", Strategy::kForceDriven, false, "temperature_k"},
                                         Kind{"WithoutProfile", Strategy::kForceDriven, true, "heat_modes_k"},
                                         Kind{"Controlled", Strategy::kVelocityDriven, false, "temperature_k", true}),
                         [](const auto& kind) { return kind.param.name; });

TEST_P(Failures, AcceptedTheNodeKeepsItsStateAndTheOthersStep) {
  MemoryStorage sound_disk, disk;
  prepare(sound_disk);
  prepare_damaged(disk);
  DurableServer sound(sound_disk), server(disk);
  for (int i = 3; i < 6; ++i) {
    const auto sequence = static_cast<std::uint64_t>(i) + 1;
    const auto expected = sound.ask(step(GetParam(), sequence, i, Policy::kAccept));
    const auto answer = server.ask(step(GetParam(), sequence, i, Policy::kAccept));
    ASSERT_EQ(answer.code(), Code::kOk) << answer.reply.status.text;
    const auto& batch = answer.reply.batch;
    EXPECT_EQ(batch.u8(Field::kOutcome)[kBadRow], wire::kFailed);
    EXPECT_EQ(batch.f64(Field::kSlidingVelocity)[kBadRow], 0.0);
    EXPECT_EQ(batch.f64(Field::kFrictionHeat)[kBadRow], 0.0);
    EXPECT_GE(std::get<wire::Upscale>(answer.reply.body).flagged_nodes, 1u);
    for (const Field field : {Field::kShearStress, Field::kInterfaceTemperature, Field::kFrictionHeat})
      for (std::size_t row = 0; row < kNodes; ++row)
        EXPECT_TRUE(row == kBadRow || batch.f64(field)[row] == expected.reply.batch.f64(field)[row]) << row;
  }
  ASSERT_TRUE(server.service.checkpoint());
  const auto before = snapshot_of(disk, 1).sessions.front().committed;
  const auto after = snapshot_of(disk, 2).sessions.front().committed;
  for (std::size_t i = 0; i < before.columns.size(); ++i)
    for (std::size_t j = 0; j < before.columns[i].width; ++j) {
      const std::size_t at = kBadRow * before.columns[i].width + j;
      const double was = before.columns[i].values[at], is = after.columns[i].values[at];
      EXPECT_TRUE(was == is || (std::isnan(was) && std::isnan(is))) << before.columns[i].name << " " << j;
    }
}

TEST_P(Failures, AllOrNothingChangesNothingNotEvenAStandingTrial) {
  MemoryStorage sound_disk, disk;
  prepare(sound_disk);
  prepare_damaged(disk);
  DurableServer sound(sound_disk), server(disk);
  const auto records = server.store.counters().records;
  const auto refused = server.ask(step(GetParam(), 4, 3, Policy::kAllOrNothing));
  EXPECT_EQ(refused.code(), Code::kStepFailed);
  EXPECT_EQ(refused.reply.status.node_ids, std::vector{support::node_ids(kNodes)[kBadRow]});
  EXPECT_EQ(server.store.counters().records, records) << "a refused request is not in the journal";

  // First a trial of all nodes but the failing node succeeds. A step of all nodes whose request also commits the trial
  // is then refused, and the trial remains uncommitted.
  auto others = support::node_ids(kNodes);
  others.erase(others.begin() + kBadRow);
  const auto of_others = [&](std::uint64_t sequence, int number, Policy policy, Mode mode, bool commit_previous) {
    wire::Request request =
        ServiceHarness::step(sequence, support::step_columns(GetParam(), others, number, true), mode);
    std::get<wire::Downscale>(request.body).policy = policy;
    std::get<wire::Downscale>(request.body).commit_previous = commit_previous;
    return request;
  };
  const auto trial = of_others(4, 3, Policy::kAllOrNothing, Mode::kTrial, false);
  EXPECT_EQ(server.ask(trial).payload(), sound.ask(trial).payload());
  EXPECT_EQ(server.ask(step(GetParam(), 5, 4, Policy::kAllOrNothing, Mode::kTrial, true)).code(), Code::kStepFailed);
  EXPECT_EQ(server.ask(step(GetParam(), 5, 4, Policy::kAllOrNothing, Mode::kAdvance, true)).code(), Code::kStepFailed);
  EXPECT_EQ(server.ask(step(GetParam(), 5, 4, Policy::kAllOrNothing, Mode::kTrial, false)).code(), Code::kStepFailed);
  for (std::uint64_t i = 5; i < 9; ++i) {
    const auto next = of_others(i, static_cast<int>(i), i % 2 == 0 ? Policy::kAccept : Policy::kAllOrNothing,
                                i == 8 ? Mode::kAdvance : Mode::kTrial, true);
    const auto answer = server.ask(next);
    ASSERT_EQ(answer.code(), Code::kOk) << answer.reply.status.text;
    EXPECT_EQ(answer.payload(), sound.ask(next).payload());
    EXPECT_EQ(std::get<wire::Upscale>(answer.reply.body).state_version, i == 8 ? 8u : i - 1);
  }
  // A new server that recovers from the same disk must give the same answers.
  DurableServer next(disk);
  EXPECT_EQ(next.ask(of_others(9, 9, Policy::kAccept, Mode::kAdvance, false)).payload(),
            sound.ask(of_others(9, 9, Policy::kAccept, Mode::kAdvance, false)).payload());
}

TEST_P(Failures, TheCapsuleRunsAgainWithTheSameBits) {
  MemoryStorage disk;
  prepare_damaged(disk);
  DurableServer server(disk);
  EXPECT_EQ(server.ask(step(GetParam(), 4, 3, Policy::kAllOrNothing)).code(), Code::kStepFailed);
  wire::Request few = step(GetParam(), 4, 3, Policy::kAccept);
  std::get<wire::Downscale>(few.body).wanted = {Field::kInterfaceTemperature};
  EXPECT_EQ(server.ask(few).code(), Code::kOk);
  ASSERT_EQ(capsules(disk).size(), 2u);
  const test::Scratch scratch;
  const auto file = scratch.path() / "capsule.h5";
  const auto replayed = [&](std::span<const std::byte> bytes) {
    write_file(file, bytes);
    return server::replay_capsule(file);
  };
  const auto all = replayed(disk.bytes("capsule-000000000001.h5"));
  EXPECT_TRUE(all.same());
  EXPECT_EQ(all.node_id, support::node_ids(kNodes)[kBadRow]);
  EXPECT_EQ(all.step, 3u);
  EXPECT_EQ(all.answer.size(), GetParam().strategy == Strategy::kVelocityDriven ? 6u : 7u);
  for (const auto& part : all.state) EXPECT_EQ(part.not_finite, part.name == GetParam().column ? 1u : 0u) << part.name;
  const auto some = replayed(disk.bytes("capsule-000000000002.h5"));
  EXPECT_TRUE(some.same());
  EXPECT_EQ(some.answer.size(), 1u);

  EXPECT_FALSE(replayed(mended(disk.bytes("capsule-000000000001.h5"))).same());
}

TEST_P(Failures, TheProgramRunsACapsuleAgainAndTellsWhatDiffers) {
  MemoryStorage disk;
  prepare_damaged(disk);
  DurableServer server(disk);
  EXPECT_EQ(server.ask(step(GetParam(), 4, 3, Policy::kAllOrNothing)).code(), Code::kStepFailed);
  const test::Scratch scratch;
  const auto file = scratch.path() / "capsule.h5";
  const std::string log = (scratch.path() / "log").string();
  const auto run = [&](std::span<const std::byte> bytes) {
    write_file(file, bytes);
    return support::Process({SHEARBUS_BINARY_DIR "/bin/shearbus-replay", "--capsule", file.string()}, log)
        .exit_code(30s);
  };
  const std::vector<std::byte> recorded = disk.bytes("capsule-000000000001.h5");
  EXPECT_EQ(run(recorded), 0);
  const std::string node = "node " + std::to_string(support::node_ids(kNodes)[kBadRow]);
  for (const std::string& word : {node, std::string("the same answer, to the last bit")})
    EXPECT_NE(support::text_of(log).find(word), std::string::npos) << word << " in " << support::text_of(log);

  EXPECT_EQ(run(mended(recorded)), 1);
  EXPECT_NE(support::text_of(log).find("ANOTHER ANSWER"), std::string::npos) << support::text_of(log);
}

TEST_P(Failures, TheFirstCapsulesStayAndNoMoreAreWritten) {
  MemoryStorage disk;
  prepare_damaged(disk);
  DurableServer server(disk);
  for (std::uint64_t i = 4; i < 40; ++i)
    ASSERT_EQ(server.ask(step(GetParam(), i, static_cast<int>(i), Policy::kAccept)).code(), Code::kOk);
  EXPECT_EQ(capsules(disk).size(), 16u);
  EXPECT_EQ(store::read_capsule(disk.bytes("capsule-000000000001.h5"), "capsule").sequence, 4u);
  disk.remove("capsule-000000000007.h5");
  server.ask(step(GetParam(), 40, 40, Policy::kAccept));
  EXPECT_TRUE(disk.exists("capsule-000000000017.h5"));
  // A server that replays its journal writes no capsules.
  DurableServer next(disk);
  EXPECT_EQ(capsules(disk).size(), 16u);
}

TEST_P(Failures, ADiskThatTakesNoCapsuleTakesNoAnswer) {
  MemoryStorage disk;
  prepare_damaged(disk);
  DurableServer server(disk);
  // The first two files that are made are the journal segment and the file `store` that names it.
  disk.plan({.at_call = 3, .code = EIO, .for_ever = true, .of = MemoryStorage::Call::kCreate});
  EXPECT_EQ(server.ask(step(GetParam(), 4, 3, Policy::kAccept)).code(), Code::kOk);
  disk.heal();
  EXPECT_TRUE(capsules(disk).empty());
}

}  // namespace
}  // namespace shearbus::service
