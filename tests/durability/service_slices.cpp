// Steps computed in slices: what other requests find meanwhile, and what a server that dies in between leaves behind.
// Also what an operator leaves out of a recovery, and what a recovery proves. Every comparison is of bits, with a
// server that computes each step at once and never dies.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/store/checkpoint.hpp"
#include "server/store/store.hpp"
#include "tests/support/durable_server.hpp"
#include "tests/support/refused.hpp"

namespace shearbus::service {
namespace {

using testing::HasSubstr;

constexpr std::array<std::uint8_t, 2> kSessions = {1, 2};
constexpr std::size_t kNodes = 40;  // five tiles, so a step has at least as many slices as the server makes of it

// A request as the router keeps it.
struct Message {
  explicit Message(const wire::Request& request)
      : header(wire::encode_header(request)),
        payload(request.batch.bytes().begin(), request.batch.bytes().end()),
        views{std::as_bytes(std::span(header)), payload},
        frames(std::span(views).first(request.batch.columns().empty() ? 1 : 2)) {}
  Message(const Message&) = delete;
  Message& operator=(const Message&) = delete;

  std::string header;
  std::vector<std::byte> payload;
  std::array<std::span<const std::byte>, 2> views;
  Frames frames;
};

struct SlicedServer {
  // `aside`: everything that may be long is done aside.
  explicit SlicedServer(store::Storage& disk, std::uint64_t epoch = 77, store::StoreOptions options = {},
                        unsigned threads = 1, bool aside = false)
      : store(disk,
              [&] {
                options.epoch = epoch;
                return options;
              }()),
        pool(threads),
        service({.epoch = epoch,
                 .server_version = "test",
                 .nodes_per_task = 4,
                 .slice_work = 1.0,
                 .now_ns = [this] { return clock += 1'000'000; },
                 .aside_from = 1,
                 .wake = aside ? [] {} : std::function<void()>()},
                pool, &store) {
    service.recover();
  }

  // Asks once. Nothing: the request waits.
  std::optional<support::Answer> ask(const Message& message, Turn* turn_out = nullptr) {
    Turn turn{};
    auto answered = service.handle(message.frames, {}, &turn);
    if (turn_out != nullptr) *turn_out = turn;
    if (!answered) return std::nullopt;
    return support::decoded(std::move(*answered));
  }
  // Asks until there is an answer.
  support::Answer insist(const wire::Request& request, int* slices = nullptr) {
    const Message message(request);
    for (;;) {
      if (auto answer = ask(message)) return std::move(*answer);
      while (!service.work())
        if (slices != nullptr) ++*slices;
    }
  }

  std::uint64_t clock = 0;
  store::Store store;
  shard::TaskPool pool;
  Service service;
};

// Asks for something that has no answer yet.
void expect_turn(SlicedServer& server, const Message& message, Turn expected, const char* what = "") {
  Turn turn{};
  EXPECT_FALSE(server.ask(message, &turn)) << what;
  EXPECT_EQ(turn, expected) << what;
}

// A server that computes in slices and one that does not, both with session 1.
struct Pair {
  Pair() {
    server.insist(ServiceHarness::opening(support::velocity_scene(), support::node_ids(kNodes)));
    whole.ask(ServiceHarness::opening(support::velocity_scene(), support::node_ids(kNodes)));
  }
  void expect_same(const wire::Request& request) {
    EXPECT_EQ(server.insist(request).payload(), whole.ask(request).payload());
  }

  MemoryStorage disk, other_disk;
  SlicedServer server{disk};
  DurableServer whole{other_disk};
};

wire::Request opening(std::uint8_t session, Strategy strategy = Strategy::kVelocityDriven) {
  return ServiceHarness::opening(support::scene_of(strategy), support::node_ids(kNodes), session);
}

wire::Request step(std::uint64_t sequence, std::uint8_t session, Strategy strategy = Strategy::kVelocityDriven,
                   Mode mode = Mode::kAdvance) {
  return ServiceHarness::step(
      sequence, support::step_columns(strategy, support::node_ids(kNodes), static_cast<int>(sequence)), mode, session);
}

std::vector<std::byte> answer_of_twin(std::uint8_t session, std::uint64_t sequence) {
  MemoryStorage disk;
  DurableServer twin(disk);
  twin.ask(opening(session));
  for (std::uint64_t i = 1; i < sequence; ++i) twin.ask(step(i, session));
  return twin.ask(step(sequence, session)).payload();
}

TEST(Slices, EveryKindOfStepHasTheBitsOfAStepComputedAtOnce) {
  for (const Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven})
    for (const unsigned threads : {1U, 3U}) {
      MemoryStorage disk, other_disk;
      SlicedServer sliced(disk, 77, {}, threads);
      DurableServer whole(other_disk);
      v1::Scene scene = support::scene_of(strategy);
      scene.mutable_layer()->clear_cells();
      scene.mutable_layer()->clear_grading();
      scene.set_tolerance(1e-3);
      wire::Request open = ServiceHarness::opening(scene, support::node_ids(kNodes));
      ASSERT_EQ(sliced.insist(open).code(), Code::kOk);
      whole.ask(open);
      int slices = 0;
      for (std::uint64_t i = 1; i <= 12; ++i) {
        wire::Request request = step(i, 1, strategy, i % 3 == 0 ? Mode::kAdvance : Mode::kTrial);
        auto& body = std::get<wire::Downscale>(request.body);
        body.dt_s = 2e-8;
        body.commit_previous = i % 3 == 2;
        if (i % 4 == 0) body.policy = wire::Policy::kAllOrNothing;
        const auto answer = sliced.insist(request, &slices);
        const auto expected = whole.ask(request);
        ASSERT_EQ(answer.code(), Code::kOk) << describe(answer.reply.status);
        EXPECT_FALSE(answer.reply.replayed);
        ASSERT_EQ(answer.payload(), expected.payload()) << "request " << i;
        ASSERT_EQ(std::get<wire::Upscale>(answer.reply.body).state_version,
                  std::get<wire::Upscale>(expected.reply.body).state_version);
      }
      EXPECT_GT(slices, 60);
    }
}

TEST(Slices, OthersAreAnsweredAndTheSessionItselfWaitsInLine) {
  MemoryStorage disk;
  SlicedServer server(disk);
  for (const std::uint8_t session : kSessions) server.insist(opening(session));
  const Message slow(step(1, 1));
  expect_turn(server, slow, Turn::kComputing);
  EXPECT_TRUE(server.service.computing());

  const Message repeat(step(1, 1));
  expect_turn(server, repeat, Turn::kWaiting);
  const Message successor(ServiceHarness::resuming());
  expect_turn(server, successor, Turn::kWaiting);
  EXPECT_EQ(server.ask(Message(ServiceHarness::in_session(wire::ServerStatusQuery{}, 0)))->code(), Code::kOk);

  const Message other(step(1, 2));
  EXPECT_FALSE(server.ask(other));  // it is computed in slices, too, each session in turn
  int complete = 0;
  for (int slice = 0; slice < 1000 && complete < 2; ++slice) complete += server.service.work() ? 1 : 0;
  ASSERT_EQ(complete, 2);
  EXPECT_EQ(server.ask(other)->payload(), answer_of_twin(2, 1));
  const auto first = server.ask(slow);
  ASSERT_TRUE(first);
  EXPECT_FALSE(first->reply.replayed);
  EXPECT_EQ(first->payload(), answer_of_twin(1, 1));
  EXPECT_TRUE(server.ask(repeat)->reply.replayed);
  EXPECT_EQ(std::get<wire::SessionResumed>(server.ask(successor)->reply.body).last_sequence, 1u);
}

// Parts of one step, each sent before the part before it is answered; part 1 may be refused.
std::vector<wire::Request> parts_ahead(bool refused) {
  constexpr std::uint32_t kParts = 3;
  const auto ids = support::node_ids(kNodes);
  std::vector<wire::Request> parts;
  for (std::uint32_t i = 0; i < kParts; ++i) {
    const auto few = std::span(ids).subspan(13 * i, i + 1 < kParts ? 13 : kNodes - 26);
    parts.push_back(ServiceHarness::step(1 + i, support::step_columns(Strategy::kVelocityDriven, few, 1, true)));
    auto& body = std::get<wire::Downscale>(parts.back().body);
    body.part = 1 + i;
    body.parts = kParts;
    if (refused && i == 0) {
      body.policy = wire::Policy::kAllOrNothing;
      parts.back().batch.f64(wire::Field::kPressure)[2] = -std::numeric_limits<double>::infinity();
    }
    if (i > 0) parts[i] = ServiceHarness::ahead(std::move(parts[i]), parts[i - 1]);
  }
  return parts;
}

TEST(Slices, APartSentAheadWaitsForThePartBefore) {
  Pair pair;
  SlicedServer& server = pair.server;
  const std::vector<wire::Request> parts = parts_ahead(false);
  std::vector<std::unique_ptr<Message>> messages;
  for (const wire::Request& part : parts) messages.push_back(std::make_unique<Message>(part));
  const auto finish = [&](const Message& message) {
    while (!server.service.work()) {
    }
    return server.ask(message);
  };
  expect_turn(server, *messages[0], Turn::kComputing);
  expect_turn(server, *messages[1], Turn::kWaiting);
  wire::Request stranger = std::move(parts_ahead(false)[1]);
  ++std::get<wire::Downscale>(stranger.body).follows;
  EXPECT_EQ(server.ask(Message(stranger))->code(), Code::kSequenceGap) << "it follows another part";
  stranger.sequence = 3;
  stranger.body = parts[1].body;
  EXPECT_EQ(server.ask(Message(stranger))->code(), Code::kSequenceGap) << "it has another place";
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto answer = finish(*messages[i]);
    ASSERT_TRUE(answer);
    ASSERT_EQ(answer->code(), Code::kOk) << describe(answer->reply.status);
    EXPECT_EQ(answer->payload(), pair.whole.ask(parts[i]).payload());
    if (i + 1 == parts.size()) break;
    expect_turn(server, *messages[i + 1], Turn::kComputing);
    if (i + 2 < parts.size()) expect_turn(server, *messages[i + 2], Turn::kWaiting);
    EXPECT_TRUE(server.ask(*messages[i])->reply.replayed) << "while the next part is computed";
  }
  EXPECT_TRUE(server.ask(*messages[1])->reply.replayed);
  EXPECT_TRUE(server.ask(*messages[2])->reply.replayed);
  pair.expect_same(step(4, 1));
}

TEST(Slices, APartSentAheadOfARefusedOneIsRefused) {
  Pair pair;
  const std::vector<wire::Request> parts = parts_ahead(true);
  EXPECT_EQ(pair.server.insist(parts[0]).code(), Code::kInvalidValue);
  EXPECT_EQ(pair.server.insist(parts[1]).code(), Code::kSequenceGap);
  pair.expect_same(step(1, 1));
  EXPECT_EQ(pair.server.insist(parts[1]).code(), Code::kSequenceGap) << "a late copy";
  pair.expect_same(step(2, 1));
}

// A server that dies in the middle of a step, while other sessions went on, with and without a checkpoint in between.
TEST(Slices, AServerThatDiesWithinAStepLosesNothing) {
  for (const bool checkpoint : {false, true}) {
    MemoryStorage disk;
    const wire::Request trial = step(1, 1, Strategy::kVelocityDriven, Mode::kTrial);
    wire::Request slow = step(2, 1);
    std::get<wire::Downscale>(slow.body).commit_previous = true;
    {
      SlicedServer server(disk);
      for (const std::uint8_t session : kSessions) server.insist(opening(session));
      server.insist(trial);
      const Message begun(slow);
      ASSERT_FALSE(server.ask(begun));
      server.service.work();
      EXPECT_EQ(server.ask(Message(ServiceHarness::in_session(wire::Mark{.name = "here"}, 1, 2)))->code(), Code::kOk);
      if (checkpoint) {
        EXPECT_TRUE(server.service.checkpoint());
      }
      EXPECT_EQ(server.ask(Message(ServiceHarness::in_session(wire::Mark{.name = "there"}, 2, 2)))->code(), Code::kOk);
    }
    SlicedServer server(disk, 78);
    MemoryStorage other_disk;
    DurableServer twin(other_disk);
    twin.ask(opening(1));
    twin.ask(trial);
    const auto expected = twin.ask(slow);
    const auto repeated = server.insist(slow);
    EXPECT_TRUE(repeated.reply.replayed) << "the step was journaled, so the recovery has run it";
    EXPECT_EQ(repeated.payload(), expected.payload());
    EXPECT_EQ(std::get<wire::Upscale>(repeated.reply.body).state_version, 2u);
    EXPECT_EQ(server.insist(step(3, 1)).payload(), twin.ask(step(3, 1)).payload());
    EXPECT_EQ(server.insist(ServiceHarness::in_session(wire::Mark{.name = "there"}, 2, 2)).code(), Code::kOk);
  }
}

// Requests of every verb that may be long, of two sessions of one domain.
std::vector<wire::Request> long_requests() {
  const auto nodes = support::node_ids(kNodes);
  const auto in_domain = [](wire::Request open) {
    std::get<wire::OpenSession>(open.body).domain = "run";
    return open;
  };
  const wire::TransferId transfer = {7};
  const auto first = std::span(nodes).first(13);
  std::vector<wire::Request> all;
  all.push_back(in_domain(opening(1)));
  all.push_back(step(1, 1));
  all.push_back(ServiceHarness::in_session(wire::Mark{.name = "here"}, 2));
  all.push_back(ServiceHarness::of_nodes(wire::RetireNodes{}, first, 3));
  all.push_back(ServiceHarness::of_nodes(wire::RegisterNodes{}, first, 4));
  all.push_back(step(5, 1));
  all.push_back(ServiceHarness::in_session(wire::Rollback{.to_mark = "here"}, 6));
  all.push_back(step(7, 1));
  all.push_back(ServiceHarness::in_session(wire::Rollback{.to_mark = "here"}, 8));
  all.push_back(ServiceHarness::of_nodes(wire::ReadProfiles{}, first, 0));
  all.push_back(ServiceHarness::of_nodes(wire::OfferNodes{.transfer_id = transfer}, first, 9));
  all.push_back(in_domain(opening(2)));
  all.back().batch = support::id_column(std::vector<std::uint64_t>{5000, 5001});
  all.push_back(ServiceHarness::in_session(wire::AcceptNodes{.transfer_id = transfer}, 1, 2));
  all.push_back(ServiceHarness::in_session(wire::Mark{.name = "here"}, 10));
  all.push_back(ServiceHarness::resuming());
  // Refused: the nodes are the other session's.
  all.push_back(ServiceHarness::of_nodes(wire::RegisterNodes{}, first, 11));
  all.push_back(ServiceHarness::in_session(wire::Mark{.name = "there"}, 2, 2));
  all.push_back(ServiceHarness::in_session(wire::CloseSession{}, 11));
  return all;
}

TEST(LongRequests, HaveTheAnswersOfThoseThatAreAnsweredAtOnceAndOutliveTheServer) {
  for (const std::size_t checkpoint_behind : std::array<std::size_t, 4>{0, 4, 8, 100}) {
    MemoryStorage disk, other_disk;
    DurableServer whole(other_disk);
    {
      SlicedServer server(disk, 77, {}, 1, true);
      const std::vector<wire::Request> requests = long_requests();
      for (std::size_t i = 0; i < requests.size(); ++i) {
        const auto answer = server.insist(requests[i]);
        const auto expected = whole.ask(requests[i]);
        ASSERT_EQ(answer.code(), expected.code()) << i << ": " << describe(answer.reply.status);
        ASSERT_EQ(answer.code() == Code::kNodeOwned, i == 15) << describe(answer.reply.status);
        ASSERT_EQ(answer.code() == Code::kOk, i != 15) << describe(answer.reply.status);
        EXPECT_EQ(answer.reply.body.index(), expected.reply.body.index()) << i;
        EXPECT_EQ(answer.payload(), expected.payload()) << i;
        if (i == checkpoint_behind) {
          EXPECT_TRUE(server.service.checkpoint());
        }
      }
      EXPECT_FALSE(server.service.busy());
      EXPECT_EQ(server.service.status().state_bytes, whole.service.status().state_bytes);
      EXPECT_EQ(server.service.status().nodes, whole.service.status().nodes);
    }
    SlicedServer server(disk, 78, {}, 1, true);
    const auto nodes = std::vector<std::uint64_t>{5000, 5001};
    const auto request =
        ServiceHarness::step(3, support::step_columns(Strategy::kVelocityDriven, nodes, 1, true), Mode::kAdvance, 2);
    EXPECT_EQ(server.insist(request).payload(), whole.ask(request).payload());
  }
}

TEST(LongRequests, LetOthersBeAnsweredAndTheirOwnSessionWaits) {
  MemoryStorage disk;
  SlicedServer server(disk, 77, {}, 1, true);
  for (const std::uint8_t session : kSessions) {
    wire::Request open = opening(session);
    std::get<wire::OpenSession>(open.body).domain = session == 1 ? "one" : "";
    ASSERT_EQ(server.insist(open).code(), Code::kOk);
  }
  const Message marking(ServiceHarness::in_session(wire::Mark{.name = "here"}, 1));
  expect_turn(server, marking, Turn::kComputing);
  EXPECT_TRUE(server.service.busy());
  const Message rival(step(1, 1));
  expect_turn(server, rival, Turn::kWaiting, "a step of the session");
  wire::Request same_domain = opening(3);
  same_domain.batch = support::id_column(std::vector<std::uint64_t>{7000});
  std::get<wire::OpenSession>(same_domain.body).domain = "one";
  const Message neighbour(same_domain);
  expect_turn(server, neighbour, Turn::kWaiting, "another session of the domain");
  EXPECT_EQ(server.ask(Message(ServiceHarness::in_session(wire::ServerStatusQuery{}, 0)))->code(), Code::kOk);
  const Message other(step(1, 2));
  expect_turn(server, other, Turn::kComputing, "a step of another session");
  expect_turn(server, marking, Turn::kComputing, "it is asked again, as after the end of another request");

  std::optional<support::Answer> step_of_other, marked, refused, opened;
  for (int n = 0; n < 10'000'000 && !(step_of_other && marked && refused && opened); ++n) {
    if (!server.service.work()) continue;
    if (!marked) marked = server.ask(marking);
    if (!step_of_other) step_of_other = server.ask(other);
    if (marked && !refused) refused = server.ask(rival);
    if (marked && !opened) opened = server.ask(neighbour);
  }
  ASSERT_TRUE(step_of_other && marked && refused && opened);
  EXPECT_EQ(step_of_other->payload(), answer_of_twin(2, 1));
  EXPECT_EQ(marked->code(), Code::kOk);
  EXPECT_EQ(refused->code(), Code::kSequenceReused) << "the mark had its number";
  EXPECT_EQ(opened->code(), Code::kOk);
}

TEST(LongRequests, OfAServerThatEndsAreGivenUpAndRunAgain) {
  MemoryStorage disk;
  const auto requests = long_requests();
  const Message last(ServiceHarness::in_session(wire::Mark{.name = "late"}, 2));
  {
    SlicedServer server(disk, 77, {}, 1, true);
    server.insist(requests[0]);
    server.insist(requests[1]);
    EXPECT_FALSE(server.ask(last));
  }
  SlicedServer server(disk, 78, {}, 1, true);
  const auto marked = server.insist(ServiceHarness::in_session(wire::Mark{.name = "late"}, 2));
  EXPECT_EQ(marked.code(), Code::kOk);
  EXPECT_FALSE(marked.reply.replayed) << "it was not journaled before its work aside was done";
}

TEST(Checkpoints, AreWrittenWhileRequestsAreAnsweredAndHoldTheirMoment) {
  MemoryStorage disk;
  {
    SlicedServer server(disk);
    server.insist(opening(1));
    server.insist(step(1, 1));
    server.service.begin_checkpoint();
    server.insist(step(2, 1));
    server.service.end_checkpoint(true);
    server.insist(step(3, 1));
    EXPECT_EQ(server.store.counters().checkpoints, 1u);
  }
  SlicedServer server(disk, 78);
  EXPECT_EQ(server.store.counters().replayed, 2u) << "the checkpoint holds the first two requests";
  EXPECT_EQ(server.insist(step(4, 1)).payload(), answer_of_twin(1, 4));
}

TEST(Checkpoints, AreDueAfterSoMuchWork) {
  MemoryStorage disk;
  {
    SlicedServer server(disk, 77, {.checkpoint_work = 2e4});
    server.insist(opening(1));
    EXPECT_FALSE(server.store.checkpoint_due());
    for (std::uint64_t i = 1; i <= 8; ++i) server.insist(step(i, 1));
    EXPECT_TRUE(server.store.checkpoint_due());
    EXPECT_EQ(std::get<wire::Welcome>(server.insist(ServiceHarness::in_session(wire::Hello{}, 0)).reply.body)
                  .limits.max_replay_work,
              20'000u);
  }
  SlicedServer server(disk, 78, {.checkpoint_work = 2e4});
  EXPECT_TRUE(server.store.checkpoint_due()) << "what a recovery replays counts, so that the next one is shorter";
  EXPECT_TRUE(server.service.checkpoint());
  EXPECT_FALSE(server.store.checkpoint_due());
}

std::string digits(std::uint8_t session) {
  return store::hexadecimal(ServiceHarness::id(session)).substr(0, 8);
}

std::vector<std::string> dropped_files(MemoryStorage& disk) {
  std::vector<std::string> files;
  for (const std::string& file : disk.list())
    if (file.starts_with("dropped-")) files.push_back(file);
  std::sort(files.begin(), files.end());
  return files;
}

TEST(LeftOut, ASessionIsSetAsideAndTheOthersKeepEveryBit) {
  MemoryStorage disk;
  {
    SlicedServer server(disk);
    for (const std::uint8_t session : kSessions) server.insist(opening(session));
    server.insist(step(1, 1));
    server.insist(step(1, 2));
    ASSERT_TRUE(server.service.checkpoint());
    server.insist(step(2, 2));
    server.insist(step(2, 1));
  }
  { SlicedServer server(disk, 78, {.leave_out = {.sessions = {digits(2)}}}); }
  const auto files = dropped_files(disk);
  ASSERT_EQ(files.size(), 2u);
  const auto image = store::read_checkpoint(disk.bytes(files[0]), files[0], 1);
  ASSERT_EQ(image.sessions.size(), 1u);
  EXPECT_EQ(image.sessions[0].id, ServiceHarness::id(2));
  const auto log = disk.bytes(files[1]);
  const auto records = store::read_segment(log, files[1]).records;
  ASSERT_EQ(records.size(), 1u);
  EXPECT_EQ(records[0].session, ServiceHarness::id(2));
  EXPECT_EQ(records[0].sequence, 2u);

  SlicedServer server(disk, 79);  // without the option: the session does not come back
  EXPECT_EQ(server.insist(step(3, 2)).code(), Code::kUnknownSession);
  EXPECT_EQ(server.insist(step(3, 1)).payload(), answer_of_twin(1, 3));
}

TEST(LeftOut, ARecordTakesTheRestOfItsSessionWithIt) {
  MemoryStorage disk;
  {
    SlicedServer server(disk);
    for (const std::uint8_t session : kSessions) server.insist(opening(session));
    for (std::uint64_t i = 1; i <= 3; ++i)
      for (const std::uint8_t session : kSessions) server.insist(step(i, session));
  }
  { SlicedServer server(disk, 78, {.leave_out = {.records = {5}}}); }  // request 2 of session 2
  ASSERT_EQ(dropped_files(disk).size(), 1u);
  SlicedServer server(disk, 79);
  EXPECT_EQ(server.insist(step(4, 1)).payload(), answer_of_twin(1, 4));
  EXPECT_EQ(server.insist(step(2, 2)).payload(), answer_of_twin(2, 2)) << "the session stands before the record";
}

TEST(LeftOut, WhatIsNotThereIsRefusedAndNothingIsChanged) {
  MemoryStorage disk;
  {
    SlicedServer server(disk);
    server.insist(opening(1));
    server.insist(step(1, 1));
  }
  const auto before = disk.list();
  EXPECT_THROW(SlicedServer(disk, 78, {.leave_out = {.sessions = {"00000000"}}}), std::invalid_argument);
  EXPECT_THROW(SlicedServer(disk, 78, {.leave_out = {.sessions = {"0101"}}}), std::invalid_argument);
  EXPECT_THROW(SlicedServer(disk, 78, {.leave_out = {.records = {9}}, .accept_empty = true}), std::invalid_argument);
  EXPECT_EQ(disk.list(), before);
  SlicedServer server(disk, 79);
  EXPECT_EQ(server.insist(step(2, 1)).payload(), answer_of_twin(1, 2));
}

wire::Request claim(std::uint64_t epoch, std::uint64_t number, std::uint64_t claimant) {
  wire::Request request = ServiceHarness::resuming(1, number, claimant);
  request.epoch = epoch;
  return request;
}

TEST(Claims, OfASuccessorSurviveARestart) {
  for (const bool checkpoint : {false, true}) {
    MemoryStorage disk;
    std::uint64_t of_successor = 0;
    {
      DurableServer server(disk, store::Durability::kProcess, 700);
      server.ask(opening(1));
      const auto granted = server.ask(claim(700, 1, 5));
      ASSERT_EQ(granted.code(), Code::kOk);
      of_successor = granted.reply.epoch;
      if (checkpoint) {
        ASSERT_TRUE(server.service.checkpoint());
      }
    }
    DurableServer server(disk, store::Durability::kProcess, 900);
    wire::Request late = step(1, 1);
    late.epoch = 700;
    EXPECT_EQ(server.ask(late).code(), Code::kSuperseded) << "the client before must not take the session back";
    wire::Request next = step(1, 1);
    next.epoch = of_successor;
    EXPECT_EQ(server.ask(next).code(), Code::kEpoch) << "the successor resumes";
    EXPECT_EQ(server.ask(claim(700, 1, 5)).code(), Code::kEpoch) << "a claim of the server before";
    const auto asked = server.ask(claim(0, 0, 0));
    EXPECT_EQ(std::get<wire::SessionResumed>(asked.reply.body).claim, 1u);
    const auto again = server.ask(claim(900, 2, 5));
    ASSERT_EQ(again.code(), Code::kOk);
    next.epoch = again.reply.epoch;
    EXPECT_EQ(server.ask(next).payload(), answer_of_twin(1, 1));
  }
}

TEST(Recovery, TheLastReplyOfASessionIsProvenToo) {
  MemoryStorage disk;
  {
    SlicedServer server(disk);
    server.insist(opening(1));
    server.insist(step(1, 1));
    server.clock += 2'000'000'000;
    server.service.prove_last_replies();
    server.service.prove_last_replies();  // once is enough
  }
  const auto bytes = disk.bytes(store::segment_name(1));
  const auto segment = store::read_segment(bytes, "file");
  ASSERT_EQ(segment.records.size(), 3u);
  EXPECT_TRUE(segment.records[2].header_frame.empty());
  { SlicedServer server(disk, 78); }
  // The same journal, in which the last reply was another one.
  disk.remove(store::segment_name(1));
  {
    store::JournalWriter writer(disk, store::segment_name(1), segment, false);
    for (store::Record record : segment.records) {
      if (record.header_frame.empty()) record.previous_reply ^= 1;
      writer.append(record);
    }
  }
  EXPECT_THAT(support::said_by<store::DamagedFile>([&] { SlicedServer(disk, 79); }), HasSubstr("other numbers"));
}

}  // namespace
}  // namespace shearbus::service
