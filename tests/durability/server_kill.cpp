// Kills the server program with SIGKILL under load, many times. Every answer that its clients receive is compared, bit
// for bit, with the answer of a server that is never killed. If one request were lost or run twice, all later answers
// would differ.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <filesystem>
#include <iostream>
#include <random>
#include <thread>

#include "client/src/client.hpp"
#include "client/src/sharded_connection.hpp"
#include "server/embedded.hpp"
#include "shearbus_places.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/server_process.hpp"

namespace shearbus {
namespace {

using namespace std::chrono_literals;
using support::ScratchDirectory;
using wire::Strategy;

int rounds_wanted() {
  const char* text = std::getenv("SHEARBUS_KILL_ROUNDS");
  return text != nullptr ? std::atoi(text) : 50;
}

// Starts server processes one after the other, on the same socket and the same state directory.
class Incarnations {
 public:
  explicit Incarnations(std::vector<std::string> options = {}) : options_(std::move(options)) {}

  void start() {
    std::vector<std::string> arguments = {"--bind", endpoint(), "--threads", "2", "--state-dir", state().string()};
    arguments.insert(arguments.end(), options_.begin(), options_.end());
    server_.emplace(arguments);
    if (!server_->ready(30s)) throw std::runtime_error("no server: " + log_text());
  }
  void kill() {
    server_->process().signal(SIGKILL);
    server_->process().exit_code(10s);
  }
  std::optional<int> terminate() {
    server_->process().signal(SIGTERM);
    return server_->process().exit_code(30s);
  }
  std::string endpoint() const { return scratch_.ipc(); }
  std::string log_text() const { return server_->log(); }
  std::filesystem::path state() const { return scratch_.path() / "state"; }

 private:
  ScratchDirectory scratch_;
  std::vector<std::string> options_;
  std::optional<support::ServerProcess> server_;
};

// A host with two equal sessions: one on the server that is killed, and a twin on a server that is never killed. The
// host makes the same steps in both sessions and compares the answers. It also registers nodes, retires nodes and moves
// nodes between its session and a partner session of the same domain.
class Host {
 public:
  // `endpoint`: of one server, or of the shards of the run.
  Host(const std::string& endpoint, Strategy strategy, std::size_t nodes, unsigned seed)
      : strategy_(strategy),
        random_(seed),
        is_sharded_(endpoint.find(',') != std::string::npos),
        connection_(connect_to({.endpoint = endpoint, .reply_deadline = 60s, .retry_after = 100ms})),
        client_(connection_),
        twin_connection_(std::make_shared<SocketConnection>(
            ClientOptions{.endpoint = embedded_.endpoint(), .context = embedded_.context()})),
        twin_client_(twin_connection_),
        domain_("host " + std::to_string(seed)),
        session_(client_.open(support::text_of(support::scene_of(strategy)), "scene", support::node_ids(nodes),
                              {.domain = domain_})),
        twin_(twin_client_.open(support::text_of(support::scene_of(strategy)), "scene", support::node_ids(nodes),
                                {.domain = domain_})),
        partner_(client_.open(support::text_of(support::scene_of(strategy)), "scene", {}, {.domain = domain_})),
        partner_twin_(
            twin_client_.open(support::text_of(support::scene_of(strategy)), "scene", {}, {.domain = domain_})) {
    if (seed == 1)  // steps in parts
      for (const auto& connection : {connection_, twin_connection_}) connection->set_max_rows(17);
  }

  void step() {
    const int number = static_cast<int>(steps_++);
    StepOptions options{.dt_s = 1e-9, .step = steps_};
    const auto choice = random_() % 10;
    if (choice >= 8) change_nodes(choice == 8);
    const Batch columns = support::step_columns(strategy_, session_.node_ids, number);
    if (choice >= 8) {
      const Batch of_partner = support::step_columns(strategy_, partner_.node_ids, number);
      same(partner_.advance(of_partner, options), partner_twin_.advance(of_partner, options), number);
    }
    if (choice == 0) {
      same(session_.trial(columns, options), twin_.trial(columns, options), number);
      ASSERT_EQ(session_.rollback(), twin_.rollback()) << "step " << number;
    } else if (choice == 1) {
      same(session_.trial(columns, options), twin_.trial(columns, options), number);
      ASSERT_EQ(session_.commit(), twin_.commit()) << "step " << number;
    } else if (choice < 4) {
      same(session_.trial(columns, options), twin_.trial(columns, options), number);
      options.commit_previous = true;
      same(session_.trial(columns, options), twin_.trial(columns, options), number);
    } else {
      same(session_.advance(columns, options), twin_.advance(columns, options), number);
    }
  }
  void close() {
    const auto totals = session_.close();
    const auto expected = twin_.close();
    EXPECT_TRUE(is_sharded_ || totals.requests == expected.requests);  // several servers count their own
    EXPECT_EQ(totals.node_steps, expected.node_steps);
    EXPECT_EQ(partner_.close().node_steps, partner_twin_.close().node_steps);
  }
  std::uint64_t moved() const { return moved_; }
  std::uint64_t requests() const { return session_.last_sequence + partner_.last_sequence; }
  std::uint64_t compared() const { return compared_; }

 private:
  void move(Session& from, Session& to, Session& from_twin, Session& to_twin, std::size_t count) {
    std::vector<std::uint64_t> ids = from.node_ids;
    ids.resize(std::min(ids.size(), count));
    if (ids.empty()) return;
    std::ranges::sort(ids);  // several servers hand nodes over in the order of their ids
    to.accept_nodes(from.offer_nodes(ids));
    to_twin.accept_nodes(from_twin.offer_nodes(ids));
    moved_ += ids.size();
  }
  void change_nodes(bool moves) {
    ASSERT_EQ(session_.rollback(), twin_.rollback());  // discards an uncommitted trial, if there is one
    if (moves) {
      if (partner_.node_ids.size() < 20 && session_.node_ids.size() > 7)
        move(session_, partner_, twin_, partner_twin_, 1 + random_() % 5);
      else
        move(partner_, session_, partner_twin_, twin_, 20);
    } else if (session_.node_ids.size() > 2) {
      const std::vector<std::uint64_t> fresh = {next_id_, next_id_ + 1};
      next_id_ += 2;
      const std::vector<std::uint64_t> old(session_.node_ids.begin(), session_.node_ids.begin() + 2);
      session_.register_nodes(fresh);
      twin_.register_nodes(fresh);
      session_.retire_nodes(old);
      twin_.retire_nodes(old);
    }
    ASSERT_EQ(session_.node_ids, twin_.node_ids);
    ASSERT_EQ(partner_.node_ids, partner_twin_.node_ids);
  }
  void same(const StepResult& answer, const StepResult& expected, int number) {
    ASSERT_EQ(answer.upscale().state_version, expected.upscale().state_version) << "step " << number;
    ASSERT_EQ(answer.upscale().flagged_nodes, expected.upscale().flagged_nodes) << "step " << number;
    const auto bits = [](std::span<const double> column) { return std::as_bytes(column); };
    for (const auto& [a, b] :
         {std::pair{bits(answer.shear_stress_pa()), bits(expected.shear_stress_pa())},
          {bits(answer.batch().f64(Field::kSlidingVelocity)), bits(expected.batch().f64(Field::kSlidingVelocity))},
          {bits(answer.interface_temperature_k()), bits(expected.interface_temperature_k())},
          {bits(answer.batch().f64(Field::kVelocityJumpNew)), bits(expected.batch().f64(Field::kVelocityJumpNew))},
          {bits(answer.batch().f64(Field::kFrictionHeat)), bits(expected.batch().f64(Field::kFrictionHeat))}})
      ASSERT_TRUE(std::equal(a.begin(), a.end(), b.begin(), b.end())) << "step " << number;
    ++compared_;
  }

  Strategy strategy_;
  std::mt19937 random_;
  server::Embedded embedded_;
  bool is_sharded_;
  std::shared_ptr<Connection> connection_;
  Client client_;
  std::shared_ptr<Connection> twin_connection_;
  Client twin_client_;
  std::string domain_;
  Session session_;
  Session twin_;
  Session partner_;
  Session partner_twin_;
  std::uint64_t next_id_ = 10'000;
  std::uint64_t moved_ = 0;
  std::uint64_t steps_ = 0;
  std::uint64_t compared_ = 0;
};

// Three hosts step on the servers while one server at a time is killed and started again.
void kill_under_load(std::deque<Incarnations>& servers, int rounds) {
  std::string endpoint;
  for (Incarnations& server : servers) {
    server.start();
    if (!endpoint.empty()) endpoint += ',';
    endpoint += server.endpoint();
  }
  std::atomic<bool> stop{false};
  std::atomic<std::uint64_t> requests{0};
  std::atomic<std::uint64_t> compared{0};
  std::atomic<std::uint64_t> moved{0};
  std::atomic<int> opened{0};
  std::vector<std::thread> hosts;
  for (unsigned i = 0; i < 3; ++i)
    hosts.emplace_back([&, i] {
      try {
        Host host(endpoint, i % 2 == 0 ? Strategy::kVelocityDriven : Strategy::kForceDriven, 20 + 60 * i, i);
        ++opened;
        while (!stop && !testing::Test::HasFatalFailure()) host.step();
        requests += host.requests();
        compared += host.compared();
        moved += host.moved();
        host.close();
      } catch (const std::exception& fault) {
        ADD_FAILURE() << "host " << i << ": " << fault.what();
        ++opened;
      }
    });
  while (opened < 3) std::this_thread::sleep_for(5ms);

  std::mt19937 random(2026);
  std::uniform_int_distribution<int> wait_ms(0, 120);
  int kills = 0;
  for (; kills < rounds && !testing::Test::HasFailure(); ++kills) {
    std::this_thread::sleep_for(std::chrono::milliseconds(wait_ms(random)));
    Incarnations& server = servers[random() % servers.size()];
    server.kill();
    server.start();
  }
  std::this_thread::sleep_for(200ms);
  stop = true;
  for (std::thread& host : hosts) host.join();
  for (Incarnations& server : servers) EXPECT_EQ(server.terminate(), 0) << server.log_text();
  EXPECT_GT(compared, 0u);
  std::cout << "kill -9 of " << servers.size() << " servers: " << kills << " rounds, " << requests << " requests, "
            << compared << " answers compared bit for bit, " << moved
            << " nodes moved; lost or run twice: " << (testing::Test::HasFailure() ? "SOME" : "0") << "\n";
  testing::Test::RecordProperty("kills", kills);
  testing::Test::RecordProperty("requests", static_cast<int>(requests.load()));
}

TEST(Kill, MinusNineUnderLoadLosesNothing) {
  std::deque<Incarnations> server;
  server.emplace_back(std::vector<std::string>{"--checkpoint-after", "1"});
  kill_under_load(server, rounds_wanted());
}

TEST(Kill, MinusNineOfAnyShardLosesNothing) {
  std::deque<Incarnations> servers;
  for (int k = 0; k < 3; ++k) servers.emplace_back(std::vector<std::string>{"--checkpoint-after", "1"});
  kill_under_load(servers, (rounds_wanted() + 3) / 4);
}

TEST(Kill, SigtermWritesACheckpointAndTheClientGoesOnWithTheNextServer) {
  Incarnations server;
  server.start();
  Host host(server.endpoint(), Strategy::kVelocityDriven, 30, 1);
  for (int i = 0; i < 5; ++i) host.step();
  EXPECT_EQ(server.terminate(), 0);
  EXPECT_TRUE(std::filesystem::exists(server.state() / "checkpoint-000000000001.h5"));
  server.start();
  EXPECT_NE(server.log_text().find("restored checkpoint-"), std::string::npos) << server.log_text();
  EXPECT_EQ(server.log_text().find("replayed"), std::string::npos) << "the checkpoint holds everything";
  for (int i = 0; i < 5; ++i) host.step();
  host.close();
}

TEST(Kill, H5pyReadsACheckpoint) {
  Incarnations server;
  server.start();
  const auto nodes = support::node_ids(5);
  Client client({.endpoint = server.endpoint()});
  Session session = client.open(support::text_of(support::velocity_scene()), "scene", nodes);
  for (int i = 0; i < 3; ++i)
    session.advance(support::step_columns(Strategy::kVelocityDriven, nodes, i), {.dt_s = 1e-9});
  ASSERT_EQ(server.terminate(), 0);
  const std::string script =
      "import h5py,sys; f=h5py.File(sys.argv[1],'r'); s=list(f['sessions'].values())[0]; c=s['committed'];"
      "assert f.attrs['format']==b'shearbus checkpoint', f.attrs['format'];"
      "assert c['temperature_k'].shape==(5,25) and c['temperature_k'].attrs['units']==b'K';"
      "assert 299<c['temperature_k'][0,0]<1221; assert list(s['node_id'])==[100,101,102,103,104];"
      "assert b'[layer]' in s['scene_toml'][()]";
  const ScratchDirectory scratch;
  support::Process python({"/usr/bin/python3", "-c", script, (server.state() / "checkpoint-000000000001.h5").string()},
                          (scratch.path() / "log").string());
  EXPECT_EQ(python.exit_code(30s), 0) << support::text_of(scratch.path() / "log");
  session.leave();
}

}  // namespace
}  // namespace shearbus
