// Sessions over several servers: which lists of endpoints are accepted, which shard has a node, and what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "client/src/client.hpp"
#include "client/src/sharded_connection.hpp"
#include "client/src/shards.hpp"
#include "tests/support/direct_connection.hpp"
#include "tests/support/durable_server.hpp"
#include "tests/support/memory_storage.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/scratch.hpp"

namespace shearbus {
namespace {

using support::fault_of;
using wire::Strategy;

TEST(Shards, AListHasACommaBetweenTwoEndpoints) {
  using Endpoints = std::vector<std::string>;
  EXPECT_EQ(endpoints_in("tcp://a:1"), Endpoints{"tcp://a:1"});
  EXPECT_EQ(endpoints_in("tcp://a:1,ipc:///b , file:///c"), (Endpoints{"tcp://a:1", "ipc:///b", "file:///c"}));
  EXPECT_EQ(endpoints_in("ipc:///a,b"), Endpoints{"ipc:///a,b"});  // a comma in a path
  EXPECT_EQ(endpoints_in(""), Endpoints{""});                      // which no connection accepts
  for (const char* text : {"tcp://a:1,", "tcp://a:1,,tcp://b:1", "tcp://a:1, ,tcp://b:1", ",tcp://a:1"}) {
    const wire::Status fault = fault_of([&] { endpoints_in(text); });
    EXPECT_EQ(fault.code, Code::kInvalidValue) << text;
    EXPECT_NE(fault.text.find("empty endpoint"), std::string::npos) << fault.text;
  }
  EXPECT_NE(fault_of([] { endpoints_in("tcp://a:1,tcp://b:1,tcp://a:1"); }).text.find("tcp://a:1 is named twice"),
            std::string::npos);
}

TEST(Shards, ADirectoryStandsForItsEndpointFiles) {
  const test::Scratch scratch;
  const std::string directory = (scratch.path() / "endpoints").string();
  std::filesystem::create_directory(directory);
  EXPECT_NE(fault_of([&] { endpoints_in("file://" + directory); }).text.find("no endpoint files"), std::string::npos);
  std::ofstream(directory + "/log") << "x";  // of another kind
  for (const char* name : {"1", "0", "2.partial"})
    std::ofstream(directory + "/" + name)
        << "version = \"1\"\nhost = \"h\"\nserver_key = \"\"\nendpoint = \"tcp://127.0.0.1:1\"\nepoch = \"1\"\n";
  EXPECT_EQ(endpoints_in("file://" + directory),
            (std::vector<std::string>{"file://" + directory + "/0", "file://" + directory + "/1"}));
  EXPECT_EQ(fault_of([&] { endpoints_in("file://" + directory + ",file://" + directory + "/0"); }).code,
            Code::kInvalidValue);
}

// The contract's values (proto/WIRE.md, "Several servers"): other languages must have the same.
TEST(Shards, ANodesShardIsTheSameEverywhere) {
  std::string found;
  for (const std::uint64_t id : {0UL, 1UL, 2UL, 3UL, 100UL, 1UL << 40U, ~0UL})
    for (const std::uint32_t shards : {2U, 3U, 5U}) found += std::to_string(shard_of(id, shards));
  EXPECT_EQ(found, "003003111003000111114");
  EXPECT_EQ(shard_of(7, 1), 0u);
}

TEST(Shards, AreOfEqualSizeAndAnotherOneMovesFewNodes) {
  constexpr std::uint64_t kNodes = 60'000;
  for (const std::uint32_t shards : {2U, 5U}) {
    std::vector<int> nodes(shards + 1);
    for (std::uint64_t id = 0; id < kNodes; ++id) {
      const std::uint32_t before = shard_of(id, shards), after = shard_of(id, shards + 1);
      EXPECT_TRUE(after == before || after == shards) << id;
      ++nodes[after];
    }
    const double expected = static_cast<double>(kNodes) / (shards + 1);
    for (const int count : nodes) EXPECT_NEAR(count, expected, 5.0 * std::sqrt(expected));
  }
}

class ServerConnection final : public Connection {
 public:
  ServerConnection(support::DurableServer& server, std::string endpoint)
      : Connection({.endpoint = std::move(endpoint)}), server_(server) {}
  void post(const wire::Request& request) override { note("post", request); }
  void post_behind(const wire::Request& request) override { note("behind", request); }
  Received call(const wire::Request& request, std::chrono::milliseconds) override {
    ++calls;
    note("call", request);
    if (is_gone) throw Error({.code = Code::kUnreachable, .text = "gone"});
    Received received = support::received(server_.ask(request));
    if (auto* welcome = std::get_if<wire::Welcome>(&received.reply.body); welcome != nullptr && !version.empty())
      welcome->server_version = version;
    if (auto* welcome = std::get_if<wire::Welcome>(&received.reply.body); welcome != nullptr && rows_of_message > 0)
      welcome->limits.max_rows_per_message = rows_of_message;
    return received;
  }
  void say(const wire::Request&) noexcept override {}

  std::string version;
  std::uint64_t rows_of_message = 0;  // 0: as many as the server says
  bool is_gone = false;
  int calls = 0;
  std::vector<std::string> parts;  // of steps, such as "post 1"

 private:
  void note(const std::string& what, const wire::Request& request) {
    if (const auto* step = std::get_if<wire::Downscale>(&request.body))
      parts.push_back(what + " " + std::to_string(step->part));
  }

  support::DurableServer& server_;
};

struct Servers {
  explicit Servers(unsigned count) {
    for (unsigned k = 0; k < count; ++k)
      servers.emplace_back(disks.emplace_back(), store::Durability::kProcess, 77 + k);
  }
  // The servers in the order of `numbers`.
  Client client(const std::vector<unsigned>& numbers, const std::string& version_of_last = {}) {
    std::vector<std::shared_ptr<Connection>> shards;
    connections.clear();
    for (const unsigned k : numbers) {
      connections.push_back(std::make_shared<ServerConnection>(servers[k], "server " + std::to_string(k)));
      connections.back()->rows_of_message = rows_of_message;
      shards.push_back(connections.back());
    }
    connections.back()->version = version_of_last;
    return Client(std::make_shared<ShardedConnection>(ClientOptions{}, std::move(shards)));
  }

  std::deque<support::MemoryStorage> disks;
  std::deque<support::DurableServer> servers;
  std::vector<std::shared_ptr<ServerConnection>> connections;
  std::uint64_t rows_of_message = 0;
};

const auto kNodes = support::node_ids(12);
Session open(Client& client, const std::string& domain = {}, std::span<const std::uint64_t> nodes = kNodes) {
  return client.open(support::text_of(support::velocity_scene()), "scene", nodes, {.domain = domain});
}

TEST(Shards, MustBeDistinctServersOfOneVersion) {
  Servers servers(2);
  EXPECT_NE(fault_of([&] {
              servers.client({0, 1, 0});
            }).text.find("server 0 is a server that another endpoint"),
            std::string::npos);
  const wire::Status mixed = fault_of([&] { servers.client({0, 1}, "other"); });
  EXPECT_EQ(mixed.code, Code::kVersion);
  EXPECT_NE(mixed.text.find("server 1 is a server of version other, and server 0 one of test"), std::string::npos)
      << mixed.text;
  EXPECT_EQ(servers.client({0, 1}).welcome().durability, "process");
  Client client = servers.client({0, 1});
  EXPECT_EQ(fault_of([&] { client.server_status(); }).code, Code::kUnsupported);
  EXPECT_EQ(fault_of([&] { open(client, {}, {}); }).code, Code::kShape);
}

TEST(Shards, OfARunAreTheSameForEveryClient) {
  Servers servers(3);
  Client first = servers.client({0, 1});
  const Session session = open(first, "run");
  for (const auto& others : {std::vector<unsigned>{1, 0}, {0, 1, 2}, {2, 0}}) {
    Client client = servers.client(others);
    const wire::Status fault = fault_of([&] { open(client, "run", support::node_ids(4, 900)); });
    EXPECT_EQ(fault.code, Code::kInvalidValue);
    EXPECT_NE(fault.text.find("divide the nodes over different servers"), std::string::npos) << fault.text;
  }
  Client alone = Client(std::make_shared<ServerConnection>(servers.servers[1], "server 1"));
  EXPECT_EQ(fault_of([&] { open(alone, "run", support::node_ids(4, 900)); }).code, Code::kInvalidValue);
  Client rank = servers.client({0, 1});
  EXPECT_EQ(fault_of([&] { open(rank, "run", support::node_ids(4, 900)); }).code, Code::kOk);
  EXPECT_EQ(fault_of([&] { open(rank, "run"); }).code, Code::kNodeOwned);
  // What a refused opening had opened on some servers is closed again.
  std::vector<std::uint64_t> mixed = support::node_ids(10, 500);
  mixed.push_back(kNodes.front());
  EXPECT_EQ(fault_of([&] { open(rank, "run", mixed); }).code, Code::kNodeOwned);
  mixed.pop_back();
  EXPECT_EQ(fault_of([&] { open(rank, "run", mixed); }).code, Code::kOk);
}

TEST(Shards, ATicketIsOfAllServersInTheirOrder) {
  Servers servers(3);
  Session::Ticket ticket;
  {
    Client client = servers.client({0, 1});
    Session session = open(client);
    ticket = session.ticket();
    session.leave();
  }
  for (const auto& others : {std::vector<unsigned>{1, 0}, {0, 1, 2}, {0, 2}}) {
    Client client = servers.client(others);
    const wire::Status fault = fault_of([&] { client.resume(ticket); });
    EXPECT_EQ(fault.code, Code::kUnknownSession);
    EXPECT_NE(fault.remedy.find("all of them, in the same order"), std::string::npos);
  }
  Client client = servers.client({0, 1});
  Session session = client.resume(ticket);
  EXPECT_EQ(session.node_ids, kNodes);
  EXPECT_EQ(session.advance(support::step_columns(Strategy::kVelocityDriven, kNodes, 0), {.dt_s = 1e-9})
                .batch()
                .u8(Field::kOutcome)
                .size(),
            kNodes.size());
}

// The nodes of a resumed session are compared with what the host takes them for, over all servers.
TEST(Shards, TellPairsAndParametersOfAResumedSession) {
  const std::string key = "soft.yield_strength_pa";
  const std::vector<std::string> names = {"", "weak"};
  std::vector<std::uint64_t> pair;
  std::vector<double> strength;
  for (std::size_t i = 0; i < kNodes.size(); ++i) {
    pair.push_back(i % 2);
    strength.push_back(1e8 + 1e6 * static_cast<double>(i));
  }
  Servers servers(3);
  Session::Ticket ticket;
  {
    Client client = servers.client({0, 1, 2});
    Session session =
        client.open(support::text_of(support::velocity_scene()) +
                        "\n[pair.weak.soft]\nmaterial = \"aluminium_dlp\"\nyield_strength_pa = 20e6\n",
                    "scene", kNodes, {.nodes = {.pairs = names, .pair = pair, .parameters = {{key, strength}}}});
    ticket = session.ticket();
    session.leave();
  }
  Client client = servers.client({0, 1, 2});
  const auto resume = [&](std::span<const std::uint64_t> nodes) {
    return fault_of([&] {
      client
          .resume(ticket,
                  {.node_ids = nodes, .options = {.pairs = names, .pair = pair, .parameters = {{key, strength}}}})
          .leave();
    });
  };
  pair[3] = 0;
  const wire::Status other = resume(kNodes);
  EXPECT_EQ(other.code, Code::kResumeRefused) << other.text;
  EXPECT_EQ(other.node_ids, std::vector{kNodes[3]});
  EXPECT_NE(other.text.find("has the pair \"weak\" in the session, the host \"\" (1 of 12"), std::string::npos)
      << other.text;
  pair[3] = 1;
  strength[5] = 2e8;
  EXPECT_EQ(resume(kNodes).field, key);
  strength[5] = 1.05e8;
  EXPECT_EQ(resume(support::node_ids(12, 900)).field, "node_id");
  EXPECT_EQ(resume(kNodes).code, Code::kOk) << resume(kNodes).text;
}

TEST(Shards, ThatAreMissingLeaveTheCallToBeRepeated) {
  Servers servers(2);
  Client client = servers.client({0, 1});
  Session session = open(client);
  const Batch columns = support::step_columns(Strategy::kVelocityDriven, kNodes, 0);
  servers.connections[1]->is_gone = true;
  EXPECT_EQ(fault_of([&] { session.advance(columns, {.dt_s = 1e-9}); }).code, Code::kUnknownOutcome);
  EXPECT_EQ(fault_of([&] { session.advance(columns, {.dt_s = 1e-9}); }).code, Code::kUnknownOutcome);
  servers.connections[1]->is_gone = false;
  // Another call first completes the interrupted one, which the shard that was there has run.
  EXPECT_EQ(fault_of([&] { session.mark("a"); }).code, Code::kSequenceReused);
  EXPECT_EQ(session.mark("a").state_version, 1u);
  // Of a step that no shard has run nothing remains.
  servers.connections[0]->is_gone = servers.connections[1]->is_gone = true;
  EXPECT_EQ(fault_of([&] { session.trial(columns, {.dt_s = 1e-9}); }).code, Code::kUnreachable);
  servers.connections[0]->is_gone = servers.connections[1]->is_gone = false;
  EXPECT_EQ(fault_of([&] { session.commit(); }).code, Code::kNothingToCommit);
}

TEST(Shards, AllStayWhereARollbackIsRefusedForANodeOfAnotherSession) {
  Servers servers(3);
  Client client = servers.client({0, 1, 2});
  Session session = open(client, "run");
  Client other_client = servers.client({0, 1, 2});
  Session other = open(other_client, "run", support::node_ids(4, 900));
  const auto step = [&] {
    session.advance(support::step_columns(Strategy::kVelocityDriven, session.node_ids, 0), {.dt_s = 1e-9});
  };
  step();
  session.mark("before");
  const std::vector<std::uint64_t> moved = {kNodes[4]};
  other.accept_nodes(session.offer_nodes(moved));
  step();
  for (const bool trial : {false, true}) {
    if (trial) session.trial(support::step_columns(Strategy::kVelocityDriven, session.node_ids, 0), {.dt_s = 1e-9});
    const wire::Status refused = fault_of([&] { session.rollback_to("before"); });
    EXPECT_EQ(refused.code, Code::kNodeOwned) << refused.text;
    EXPECT_EQ(refused.node_ids, moved);
    step();
  }
  EXPECT_EQ(session.mark("after").state_version, 4u);
  // Once the node is free, all go back.
  other.retire_nodes(moved);
  EXPECT_EQ(session.rollback_to("before"), 1u);
  EXPECT_EQ(session.node_ids, kNodes);
  step();
  EXPECT_EQ(session.mark("again").state_version, 2u);
}

TEST(Shards, ThatAreMissingLeaveTheOpeningToBeRepeated) {
  Servers servers(2);
  Client client = servers.client({0, 1});
  servers.connections[1]->is_gone = true;
  EXPECT_EQ(fault_of([&] { open(client, "run"); }).code, Code::kUnknownOutcome);
  servers.connections[1]->is_gone = false;
  const Session session = open(client, "run");  // the same one: on shard 0 its nodes have no other owner
  EXPECT_EQ(session.node_ids, kNodes);
  // A refusal counts, whatever the others answer, and the next opening is another one.
  servers.connections[1]->is_gone = true;
  EXPECT_EQ(fault_of([&] { open(client, "run"); }).code, Code::kNodeOwned);
  servers.connections[1]->is_gone = false;
  EXPECT_EQ(fault_of([&] { open(client, "run", support::node_ids(4, 900)); }).code, Code::kOk);
}

TEST(Shards, GetEachPartBeforeTheyHaveAnsweredThePartBefore) {
  Servers servers(3);
  Client alone = servers.client({2});
  Session whole = open(alone);
  servers.rows_of_message = 5;
  Client client = servers.client({0, 1});
  Session session = open(client);
  const Batch columns = support::step_columns(Strategy::kVelocityDriven, kNodes, 0);
  const auto stress = session.advance(columns, {.dt_s = 1e-9}).shear_stress_pa();
  EXPECT_TRUE(std::ranges::equal(stress, whole.advance(columns, {.dt_s = 1e-9}).shear_stress_pa()));
  for (const auto& connection : servers.connections) {
    EXPECT_THAT(connection->parts,
                testing::ElementsAre("post 1", "behind 2", "call 1", "behind 3", "call 2", "call 3"));
  }
}

// A step was refused by one shard after it had committed the trial before: all shards are at that step, and say so.
TEST(Shards, ThatHaveRefusedAStepSayTheStepBefore) {
  Servers servers(2);
  Client client = servers.client({0, 1});
  Session session = open(client);
  Batch columns = support::step_columns(Strategy::kVelocityDriven, kNodes, 0);
  session.trial(columns, {.dt_s = 1e-9});
  columns.f64(Field::kPressure)[3] = 1e30;
  EXPECT_EQ(fault_of([&] { session.trial(columns, {.dt_s = 1e-9, .commit_previous = true}); }).code,
            Code::kInvalidValue);
  EXPECT_EQ(session.commit(), 1u);
  EXPECT_EQ(session.rollback(), 1u);
  EXPECT_EQ(fault_of([&] { session.commit(); }).code, Code::kNothingToCommit);
}

// One shard returns with older states: nothing is stepped until all are at the same step again.
TEST(Shards, AtDifferentStepsAreRolledBackToACommonMark) {
  Servers servers(2);
  Client client = servers.client({0, 1});
  Session session = open(client);
  const Batch columns = support::step_columns(Strategy::kVelocityDriven, kNodes, 0);
  session.mark("start");
  session.advance(columns, {.dt_s = 1e-9});
  session.mark("later");
  const Session::Ticket ticket = session.ticket();
  session.leave();
  // A host that uses a shard's own session advances it alone.
  Client alone(std::make_shared<ServerConnection>(servers.servers[1], "server 1"));
  Session of_shard =
      alone.resume({.session_id = session_of_shard(ticket.session_id, 1, 2), .resume_token = ticket.resume_token});
  for (int step = 0; step < 2; ++step)
    of_shard.advance(support::step_columns(Strategy::kVelocityDriven, of_shard.node_ids, step), {.dt_s = 1e-9});
  of_shard.mark("its own");
  of_shard.leave();

  Client successor = servers.client({0, 1});
  Session resumed = successor.resume(ticket);
  const wire::Status fault = fault_of([&] { resumed.advance(columns, {.dt_s = 1e-9}); });
  EXPECT_EQ(fault.code, Code::kEpoch);
  EXPECT_NE(fault.text.find("state versions are 1, 3"), std::string::npos) << fault.text;
  EXPECT_EQ(fault_of([&] { resumed.rollback_to("start"); }).code, Code::kUnknownMark);  // server 1 keeps two marks
  EXPECT_EQ(fault_of([&] { resumed.commit(); }).code, Code::kEpoch);
  EXPECT_EQ(resumed.rollback_to("later"), 1u);
  EXPECT_EQ(resumed.advance(columns, {.dt_s = 1e-9}).upscale().state_version, 2u);
  resumed.close();
}

}  // namespace
}  // namespace shearbus
