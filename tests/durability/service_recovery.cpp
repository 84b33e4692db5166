// Tests of a service with a store, without sockets. After a restart the new server must give, to the last bit, the
// answers of a server that was never restarted.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "server/store/store.hpp"
#include "tests/durability/deaths.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::service {
namespace {

using ::testing::ElementsAre;
using ::testing::StartsWith;
using Call = MemoryStorage::Call;

constexpr std::size_t kNodes = 11;

wire::Request opening(Strategy strategy) {
  return ServiceHarness::opening(support::scene_of(strategy), support::node_ids(kNodes));
}

// Returns the request number `sequence` of a conversation that contains every kind of step: trials that are committed,
// replaced, rolled back, or committed by the next request, and steps of a part of the nodes.
wire::Request request_at(Strategy strategy, std::uint64_t sequence) {
  const auto ids = support::node_ids(kNodes);
  const int step = static_cast<int>(sequence);
  const auto columns = [&](bool some) {
    return some ? support::step_columns(strategy, std::span(ids).subspan(2, 5), step, true)
                : support::step_columns(strategy, ids, step);
  };
  switch (sequence % 7) {
    case 1:
      return ServiceHarness::step(sequence, columns(false));
    case 2:
      return ServiceHarness::step(sequence, columns(false), Mode::kTrial);
    case 3:
      return ServiceHarness::in_session(wire::Rollback{}, sequence);
    case 4:
      return ServiceHarness::step(sequence, columns(true), Mode::kTrial);
    case 5: {
      wire::Request next = ServiceHarness::step(sequence, columns(false), Mode::kTrial);
      std::get<wire::Downscale>(next.body).commit_previous = true;
      return next;
    }
    case 6:
      return ServiceHarness::in_session(wire::Commit{}, sequence);
    default:
      return ServiceHarness::step(sequence, columns(true));
  }
}

struct Bits {
  Code code;
  std::uint64_t state_version;
  std::vector<std::byte> payload;
  bool operator==(const Bits&) const = default;
};

Bits bits_of(const support::Answer& answer) {
  std::uint64_t version = 0;
  if (const auto* step = std::get_if<wire::Upscale>(&answer.reply.body)) version = step->state_version;
  if (const auto* committed = std::get_if<wire::Committed>(&answer.reply.body)) version = committed->state_version;
  if (const auto* rolled = std::get_if<wire::RolledBack>(&answer.reply.body)) version = rolled->state_version;
  return {answer.code(), version, answer.payload()};
}

class Recovery : public testing::TestWithParam<Strategy> {};
INSTANTIATE_TEST_SUITE_P(Strategies, Recovery, support::both<Strategy>(), support::name_of_strategy);

TEST_P(Recovery, ServersThatDieAfterEveryRequestAnswerAndRepeatAsOneThatNeverDoes) {
  std::vector<wire::Request> conversation = {opening(GetParam())};
  for (std::uint64_t i = 1; i <= 30; ++i) conversation.push_back(request_at(GetParam(), i));
  expect_deaths_change_nothing(conversation, bits_of);
}

TEST(Recovery, ARequestOfTheLastEpochIsResumedNotRun) {
  MemoryStorage disk;
  std::uint64_t old_epoch = 0;
  {
    DurableServer server(disk, store::Durability::kProcess, 77);
    old_epoch = server.ask(opening(Strategy::kVelocityDriven)).reply.epoch;
    server.ask(request_at(Strategy::kVelocityDriven, 1));
  }
  DurableServer server(disk, store::Durability::kProcess, 78);
  wire::Request next = request_at(Strategy::kVelocityDriven, 2);
  next.epoch = old_epoch;
  EXPECT_EQ(server.ask(next).code(), Code::kEpoch);

  wire::Request resume = ServiceHarness::in_session(wire::ResumeSession{}, 0);
  EXPECT_EQ(server.ask(resume).code(), Code::kResumeRefused);
  auto& body = std::get<wire::ResumeSession>(resume.body);
  body.resume_token.fill(9);
  EXPECT_EQ(std::get<wire::SessionResumed>(server.ask(resume).reply.body).claim, 0u);
  body.claim = 1;
  resume.epoch = old_epoch;
  EXPECT_EQ(server.ask(resume).code(), Code::kEpoch) << "claims are counted from the start of the server";
  resume.epoch = 78;
  body.claimant = 5;
  const auto where = server.ask(resume);
  ASSERT_EQ(where.code(), Code::kOk);
  const auto& resumed = std::get<wire::SessionResumed>(where.reply.body);
  EXPECT_EQ(resumed.last_sequence, 1u);
  EXPECT_EQ(resumed.state_version, 1u);
  EXPECT_FALSE(resumed.trial_stands);
  const auto ids = where.reply.batch.u64(wire::Field::kNodeId);
  EXPECT_EQ(std::vector<std::uint64_t>(ids.begin(), ids.end()), support::node_ids(kNodes));
  const std::uint64_t first_epoch = where.reply.epoch;
  next.epoch = first_epoch;
  EXPECT_EQ(server.ask(next).code(), Code::kOk);

  // A late copy of the request that claimed the session changes nothing. The same claim by another client does not give
  // that client the session.
  EXPECT_EQ(server.ask(resume).reply.epoch, first_epoch);
  body.claimant = 6;
  EXPECT_EQ(server.ask(resume).code(), Code::kSuperseded);

  // After a second claim of the session, requests of its earlier owner may still arrive; they do not disturb the new
  // owner.
  body.claim = 2;
  const std::uint64_t second_epoch = server.ask(resume).reply.epoch;
  EXPECT_NE(second_epoch, first_epoch);
  wire::Request late = request_at(Strategy::kVelocityDriven, 3);
  late.epoch = first_epoch;
  EXPECT_EQ(server.ask(late).code(), Code::kSuperseded);
  late.epoch = 78;
  EXPECT_EQ(server.ask(late).code(), Code::kSuperseded);
  late.epoch = second_epoch;
  EXPECT_EQ(server.ask(late).code(), Code::kOk);
}

// After a rollback to a mark, the same steps must give the same bits: the steps that were rolled back have no effect.
// The server is restarted before every request.
TEST_P(Recovery, AMarkBringsBackItsStatesToTheLastBit) {
  MemoryStorage disk;
  std::uint64_t sequence = 0;
  const auto ask = [&](auto body, wire::Batch batch = {}) {
    DurableServer server(disk);
    wire::Request request = ServiceHarness::in_session(std::move(body), ++sequence);
    request.batch = std::move(batch);
    auto answer = server.ask(request);
    EXPECT_EQ(answer.code(), Code::kOk) << answer.reply.status.text;
    if (sequence % 4 == 0) server.service.checkpoint();
    return answer;
  };
  const auto ids = support::node_ids(kNodes);
  const auto steps = [&](int first) {
    std::vector<Bits> all;
    for (int i = first; i < first + 4; ++i)
      all.push_back(bits_of(ask(wire::Downscale{.dt_s = 1e-9}, support::step_columns(GetParam(), ids, i))));
    return all;
  };
  const auto names = [](const support::Answer& answer) { return std::get<wire::Marked>(answer.reply.body).names; };
  using Names = std::vector<std::string>;

  EXPECT_EQ(DurableServer(disk).ask(opening(GetParam())).code(), Code::kOk);
  steps(0);
  EXPECT_EQ(names(ask(wire::Mark{.name = "dump 4"})), (Names{"dump 4"}));
  const auto after = steps(4);
  EXPECT_EQ(names(ask(wire::Mark{.name = "dump 8"})), (Names{"dump 4", "dump 8"}));
  steps(8);
  ask(wire::Downscale{.dt_s = 1e-9, .mode = Mode::kTrial}, support::step_columns(GetParam(), ids, 0));
  const auto back = ask(wire::Rollback{.to_mark = "dump 4"});
  EXPECT_EQ(std::get<wire::RolledBack>(back.reply.body).state_version, 4u);
  EXPECT_EQ(steps(4), after);
  EXPECT_EQ(names(ask(wire::Mark{.name = "dump 4"})), (Names{"dump 8", "dump 4"})) << "the same name replaces";
  EXPECT_EQ(names(ask(wire::Mark{.name = "dump 9"})), (Names{"dump 4", "dump 9"})) << "the oldest makes room";
  DurableServer server(disk);
  EXPECT_EQ(server.ask(ServiceHarness::in_session(wire::Rollback{.to_mark = "dump 8"}, sequence + 1)).code(),
            Code::kUnknownMark);
  EXPECT_EQ(server.ask(ServiceHarness::in_session(wire::Commit{}, sequence + 1)).code(), Code::kNothingToCommit);
  const std::uint64_t with_marks = server.service.status().state_bytes;
  server.ask(ServiceHarness::in_session(wire::CloseSession{}, sequence + 1));
  EXPECT_GT(with_marks, 0u);
  EXPECT_EQ(server.service.status().state_bytes, 0u);
}

TEST(Recovery, ARefusedRequestIsNotInTheJournal) {
  MemoryStorage disk;
  DurableServer server(disk);
  server.ask(opening(Strategy::kVelocityDriven));
  const auto records = server.store.counters().records;
  wire::Request bad = request_at(Strategy::kVelocityDriven, 1);
  bad.batch.f64(wire::Field::kPressure)[3] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(server.ask(bad).code(), Code::kInvalidValue);
  EXPECT_EQ(server.ask(request_at(Strategy::kVelocityDriven, 3)).code(), Code::kSequenceGap);
  EXPECT_EQ(server.ask(ServiceHarness::in_session(wire::Commit{}, 1)).code(), Code::kNothingToCommit);
  EXPECT_EQ(server.store.counters().records, records);
}

TEST(Recovery, ADiskThatIsFullChangesNothingAndGoesOnWhenThereIsRoom) {
  MemoryStorage quiet, disk;
  DurableServer undisturbed(quiet), server(disk);
  for (DurableServer* one : {&undisturbed, &server}) one->ask(opening(Strategy::kForceDriven));
  for (std::uint64_t i = 1; i <= 12; ++i) {
    disk.plan({.at_call = 1, .code = ENOSPC, .for_ever = true, .of = Call::kAppend});
    server.log.clear();
    for (int again = 0; again < 3; ++again)
      EXPECT_EQ(server.ask(request_at(Strategy::kForceDriven, i)).code(), Code::kNoSpace);
    EXPECT_THAT(server.log, ElementsAre(StartsWith("ALARM: no room in the state directory; requests are refused")));
    EXPECT_EQ(server.ask(ServiceHarness::in_session(wire::ServerStatusQuery{}, 0)).code(), Code::kOk);
    disk.heal();
    ASSERT_EQ(bits_of(server.ask(request_at(Strategy::kForceDriven, i))),
              bits_of(undisturbed.ask(request_at(Strategy::kForceDriven, i))));
    EXPECT_EQ(server.log.back(), "the journal takes requests again");
  }
  MemoryStorage full;
  full.plan({.at_call = 2, .code = ENOSPC, .for_ever = true, .of = Call::kAppend});
  DurableServer other(full);
  EXPECT_EQ(other.ask(opening(Strategy::kForceDriven)).code(), Code::kNoSpace);
  EXPECT_EQ(other.service.status().sessions, 0u);
}

TEST(Recovery, NothingIsAnsweredOnceTheJournalFails) {
  for (const auto call : {Call::kAppend, Call::kSync}) {
    MemoryStorage disk;
    DurableServer server(disk, store::Durability::kPower);
    server.ask(opening(Strategy::kVelocityDriven));
    disk.plan({.at_call = 1, .code = EIO, .of = call});
    EXPECT_THROW(server.ask(request_at(Strategy::kVelocityDriven, 1)), std::runtime_error);
    disk.heal();
    EXPECT_TRUE(server.service.failed());
    EXPECT_THROW(server.ask(ServiceHarness::in_session(wire::ServerStatusQuery{}, 0)), std::runtime_error);
  }
}

TEST(Recovery, AJournalOfAnotherPhysicsIsRefused) {
  MemoryStorage disk;
  {
    DurableServer server(disk);
    server.ask(opening(Strategy::kVelocityDriven));
    for (std::uint64_t i = 1; i <= 3; ++i) server.ask(request_at(Strategy::kVelocityDriven, i));
  }
  // Writes the same records to the journal again, with one change: the hash of the reply to request 1, which the record
  // of request 2 contains, is not that of the reply that the server gives in a replay.
  const auto bytes = disk.bytes(store::segment_name(1));
  const auto segment = store::read_segment(bytes, "file");
  disk.remove(store::segment_name(1));
  {
    store::JournalWriter writer(disk, store::segment_name(1), segment, false);
    for (store::Record record : segment.records) {
      if (record.sequence == 2) record.previous_reply ^= 1;
      writer.append(record);
    }
  }
  EXPECT_THAT(support::said_by<store::DamagedFile>([&] { DurableServer{disk}; }), testing::HasSubstr("other numbers"));
}

TEST(Recovery, WithoutAJournalTheSessionComesBackWhereTheCheckpointLeftIt) {
  MemoryStorage disk;
  {
    DurableServer server(disk, store::Durability::kNone, 77);
    EXPECT_EQ(std::get<wire::Welcome>(server.ask(ServiceHarness::in_session(wire::Hello{}, 0)).reply.body).durability,
              "none");
    server.ask(opening(Strategy::kVelocityDriven));
    server.ask(request_at(Strategy::kVelocityDriven, 1));
    ASSERT_TRUE(server.service.checkpoint());
    server.ask(request_at(Strategy::kVelocityDriven, 2));
  }
  DurableServer server(disk, store::Durability::kNone, 78);
  EXPECT_EQ(std::get<wire::SessionResumed>(server.ask(ServiceHarness::resuming()).reply.body).last_sequence, 1u);
}

}  // namespace
}  // namespace shearbus::service
