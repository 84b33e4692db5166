// Sessions over several servers, each with a simulated network, disk and clock of its own (world.hpp). Every answered
// call is repeated on one reference server that runs undisturbed, and the answers must have the same bits. Clients die
// between any two requests to the shards, and their successors, too.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <limits>
#include <map>

#include "client/src/sharded_connection.hpp"
#include "tests/durability/simulation/connections.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus::simulation {
namespace {

using wire::Strategy;

// A connection of a client that dies: with its last request, which is sent, and any later one, which is not.
class MortalConnection final : public Connection {
 public:
  MortalConnection(World& world, std::shared_ptr<int> requests_left)
      : Connection({.reply_deadline = 20s, .retry_after = 100ms}), inner_(world), left_(std::move(requests_left)) {}

  Received call(const wire::Request& request, std::chrono::milliseconds deadline) override {
    if (*left_ == 0) throw Error({.code = Code::kUnknownOutcome, .text = "the client is dead"});
    inner_.dies_next = --*left_ == 0;
    return inner_.call(request, deadline);
  }
  void post(const wire::Request& request) override {
    if (*left_ != 0) inner_.post(request);
  }
  void post_behind(const wire::Request& request) override {
    if (*left_ != 0) inner_.post_behind(request);
  }
  void say(const wire::Request&) noexcept override {}
  Clock::time_point now() const override { return inner_.now(); }
  void pause(std::chrono::milliseconds time) override { inner_.pause(time); }

 private:
  SimulatedConnection inner_;
  std::shared_ptr<int> left_;
};

struct Cluster {
  Cluster(unsigned seed, unsigned shards, Tally& tally) : random(seed) {
    for (unsigned k = 0; k < shards; ++k)
      worlds.push_back(std::make_unique<World>(seed * 8 + k, tally, 100'000 * k, 4));
    if (seed % 3 != 0) rows = 2 + seed % 5;
  }
  bool chance(unsigned one_in) { return random() % one_in == 0; }

  std::mt19937 random;
  std::vector<std::unique_ptr<World>> worlds;
  support::ServiceHarness reference;
  std::map<TransferId, TransferId> offers;  // to the id of the same offer on the reference server
  std::uint64_t next_id = 1000;
  std::size_t rows =
      wire::kMaxRowsPerMessage;  // of a message: a step of more nodes is sent in parts, some of them ahead
};

class ShardedHost {
 public:
  ShardedHost(Cluster& run, Tally& tally, unsigned number, Strategy strategy)
      : run_(run),
        tally_(tally),
        strategy_(strategy),
        client_(connect()),
        reference_client_(std::make_shared<DirectConnection>(run.reference)),
        session_(insist([&] { return client_.open(scene(), "scene", nodes_at_first(number), {.domain = "run"}); })),
        reference_(reference_client_.open(scene(), "scene", nodes_at_first(number), {.domain = "run"})) {}

  void act(ShardedHost& other) {
    ++tally_.calls;
    switch (run_.random() % 12) {
      case 0:
      case 1:
        return die_and_be_succeeded();
      case 2:
        return ask_nonsense();
      case 3:
        return mark_or_go_back();
      case 4:
        return register_some(other);
      case 5:
        return retire_some();
      case 6:
        return move_some(other);
      default:
        return step();
    }
  }

  void close() {
    // The shards also count steps that were undone.
    ASSERT_GE(insist([&] { return session_.close(); }).node_steps, reference_.close().node_steps);
  }

 private:
  static std::vector<std::uint64_t> nodes_at_first(unsigned number) {
    return support::node_ids(4 + 9 * std::uint64_t{number}, 100 * (number + 1));
  }
  std::string scene() const { return support::text_of(support::scene_of(strategy_)); }

  Client connect(int requests_left = -1) {
    left_ = std::make_shared<int>(requests_left);
    std::vector<std::shared_ptr<Connection>> shards;
    for (const auto& world : run_.worlds) shards.push_back(std::make_shared<MortalConnection>(*world, left_));
    auto connection = std::make_shared<ShardedConnection>(
        ClientOptions{.reply_deadline = 20s, .check_closure = CheckClosure::kOff}, std::move(shards));
    Client client = insist([&] { return Client(std::shared_ptr<Connection>(connection)); });
    connection->set_max_rows(run_.rows);
    return client;
  }

  std::vector<std::uint64_t> some_nodes() {
    std::vector<std::uint64_t> picked = session_.node_ids;
    std::shuffle(picked.begin(), picked.end(), run_.random);
    picked.resize(std::min<std::size_t>(picked.size(), 1 + run_.random() % 6));
    std::ranges::sort(picked);  // accepted nodes come in the order of their ids
    return picked;
  }

  Batch columns(const Session& session, int number, const std::vector<std::uint64_t>& named) const {
    return support::step_columns(strategy_, named.empty() ? session.node_ids : named, number, !named.empty());
  }
  const StepResult& made(Session& session, wire::Mode mode, bool commit_previous, int number,
                         const std::vector<std::uint64_t>& named) const {
    const StepOptions options{.dt_s = 1e-9, .mode = mode, .commit_previous = commit_previous};
    const Batch batch = columns(session, number, named);
    if (mode == wire::Mode::kAdvance || number % 2 == 0) return session.step(batch, options);
    session.start(batch, options);
    return session.finish();
  }
  void compare(wire::Mode mode, bool commit_previous = false) {
    const int number = steps_++;
    const std::vector<std::uint64_t> named = run_.chance(3) ? some_nodes() : std::vector<std::uint64_t>();
    const StepResult& expected = made(reference_, mode, commit_previous, number, named);
    const StepResult& answer = *insist([&] { return &made(session_, mode, commit_previous, number, named); });
    ASSERT_EQ(answer.upscale().state_version, expected.upscale().state_version);
    ASSERT_EQ(answer.upscale().nodes, expected.upscale().nodes);
    ASSERT_EQ(answer.upscale().flagged_nodes, expected.upscale().flagged_nodes);
    std::map<std::uint64_t, std::size_t> row_of;  // a successor has the rows in another order
    const auto& ids = named.empty() ? reference_.node_ids : named;
    for (std::size_t row = 0; row < ids.size(); ++row) row_of[ids[row]] = row;
    const auto& mine = named.empty() ? session_.node_ids : named;
    for (const auto& column : expected.batch().columns()) {
      if (column.element != wire::Element::kFloat64) continue;
      const auto a = answer.batch().f64(column.field), b = expected.batch().f64(column.field);
      for (std::size_t row = 0; row < mine.size(); ++row)
        ASSERT_EQ(std::bit_cast<std::uint64_t>(a[row]), std::bit_cast<std::uint64_t>(b[row_of.at(mine[row])]))
            << wire::name(column.field) << " of node " << mine[row] << " in step " << number;
    }
  }
  void step() {
    if (run_.chance(3)) return compare(wire::Mode::kAdvance);
    compare(wire::Mode::kTrial);
    switch (run_.random() % 3) {
      case 0:
        ASSERT_EQ(insist([&] { return session_.commit(); }), reference_.commit());
        return;
      case 1:
        ASSERT_EQ(insist([&] { return session_.rollback(); }), reference_.rollback());
        return;
      default:
        compare(wire::Mode::kTrial, true);
    }
  }

  template <typename Call, typename Expected>
  Code both(const Call& call, const Expected& expected) {
    std::string text;
    const auto code_of = [&](const auto& made) {
      try {
        made();
        return Code::kOk;
      } catch (const Error& fault) {
        text = fault.what();
        return fault.status().code;
      }
    };
    const Code wanted = code_of(expected);
    EXPECT_EQ(code_of([&] { insist(call); }), wanted) << text;
    same_nodes();
    if (wanted != Code::kOk) ++tally_.refused;
    return wanted;
  }
  void same_nodes() const {
    std::vector<std::uint64_t> a = session_.node_ids, b = reference_.node_ids;
    if (succeeded_) {
      std::ranges::sort(a);
      std::ranges::sort(b);
    }
    EXPECT_EQ(a, b);
  }

  // Registers new nodes, and at times one of another session, which one shard refuses.
  void register_some(const ShardedHost& other) {
    ++tally_.node_changes;
    std::vector<std::uint64_t> ids;
    for (unsigned i = 0; i <= run_.random() % 5; ++i) ids.push_back(run_.next_id++);
    if (run_.chance(4) && !other.session_.node_ids.empty()) ids.push_back(other.session_.node_ids.front());
    both([&] { return session_.register_nodes(ids), 0; }, [&] { reference_.register_nodes(ids); });
  }
  void retire_some() {
    ++tally_.node_changes;
    auto ids = some_nodes();
    if (ids.empty()) return;
    if (run_.chance(6)) ids.push_back(run_.chance(2) ? ids.front() : 77);
    both([&] { return session_.retire_nodes(ids), 0; }, [&] { reference_.retire_nodes(ids); });
  }
  void move_some(ShardedHost& other) {
    ++tally_.node_changes;
    const auto ids = some_nodes();
    if (ids.empty()) return;
    TransferId mine{}, of_reference{};
    if (both([&] { return mine = session_.offer_nodes(ids), 0; },
             [&] { of_reference = reference_.offer_nodes(ids); }) != Code::kOk)
      return;
    other.drop_trial();
    ASSERT_EQ(other.both([&] { return other.session_.accept_nodes(mine).size(); },
                         [&] { other.reference_.accept_nodes(of_reference); }),
              Code::kOk);
    ASSERT_EQ(other.both([&] { return other.session_.accept_nodes(mine).size(); },
                         [&] { other.reference_.accept_nodes(of_reference); }),
              Code::kUnknownTransfer);
    tally_.moved += ids.size();
    marks_.clear();  // a rollback would want the moved nodes
    other.marks_.clear();
  }

  void mark_or_go_back() {
    if (marks_.empty() || run_.chance(2)) {
      const std::string name = "dump " + std::to_string(steps_);
      ASSERT_EQ(insist([&] { return session_.mark(name).names; }), reference_.mark(name).names);
      marks_.push_back(name);
      return;
    }
    drop_trial();
    const std::string mark = marks_.size() > 1 && run_.chance(3) ? marks_[marks_.size() - 2] : marks_.back();
    both([&] { return session_.rollback_to(mark); }, [&] { reference_.rollback_to(mark); });
  }

  // A value at fault in one row: the shard of that node refuses the step, and the others must not have made it.
  void ask_nonsense() {
    if (session_.node_ids.empty()) return;
    drop_trial();
    Batch batch = columns(session_, steps_, {});
    batch.f64(Field::kPressure)[run_.random() % session_.node_ids.size()] = std::numeric_limits<double>::infinity();
    const bool advances = run_.chance(2);
    try {
      insist(
          [&] { return advances ? &session_.advance(batch, {.dt_s = 1e-9}) : &session_.trial(batch, {.dt_s = 1e-9}); });
      FAIL() << "nonsense was answered";
    } catch (const Error& fault) {
      ASSERT_EQ(fault.status().code, Code::kInvalidValue) << fault.what();
      ASSERT_EQ(fault.status().node_ids.size(), 1u);
    }
    ++tally_.refused;
    for (int calls = 0;; ++calls) {
      try {
        insist([&] { return session_.commit(); });
        FAIL() << "a trial stands after a refused step";
      } catch (const Error& fault) {
        // The client drops the parts before the refused one; the answer to that request may be lost.
        if (fault.status().code == Code::kSequenceReused && calls == 0) continue;
        ASSERT_EQ(fault.status().code, Code::kNothingToCommit) << fault.what();
        break;
      }
    }
  }

  void drop_trial() {
    ASSERT_EQ(insist([&] { return session_.rollback(); }), reference_.rollback());
  }

  // The client dies after some of the requests of a call. Its successor must find the call run by all shards or by none;
  // of a change of the nodes each node for itself.
  void die_and_be_succeeded() {
    ++tally_.successors;
    drop_trial();
    const std::uint64_t before = reference_.rollback();
    const int kind = static_cast<int>(run_.random() % 5);
    const int number = steps_;
    if (kind == 1 || kind == 2) compare(wire::Mode::kTrial);
    const auto changed =
        kind == 3 ? std::vector<std::uint64_t>{run_.next_id, run_.next_id + 1, run_.next_id + 2} : some_nodes();
    if (kind == 3) run_.next_id += 3;
    *left_ = 1 + static_cast<int>(run_.random() % (2 * run_.worlds.size()));
    try {
      if (kind == 0) session_.advance(columns(session_, number, {}), {.dt_s = 1e-9});
      if (kind == 1) session_.commit();
      if (kind == 2) session_.trial(columns(session_, number + 1, {}), {.dt_s = 1e-9, .commit_previous = true});
      if (kind == 3) session_.register_nodes(changed);
      if (kind == 4 && !changed.empty()) session_.retire_nodes(changed);
    } catch (const Error&) {
    }
    const Session::Ticket ticket = session_.ticket();
    session_.leave();
    for (bool resumed = false; !resumed;) {
      const bool lives = run_.chance(3);
      client_ = connect();
      *left_ = lives ? -1 : static_cast<int>(run_.random() % 8);
      try {
        session_ = insist([&] { return client_.resume(ticket); });
        resumed = lives;
        if (!lives) session_.leave();
      } catch (const Error& fault) {
        // A late claim of a dead client may come between this client's question and its claim.
        const Code code = fault.status().code;
        ASSERT_TRUE(code == Code::kSuperseded || (code == Code::kUnknownOutcome && !lives)) << fault.what();
      }
    }
    succeeded_ = true;
    const std::uint64_t after = insist([&] { return session_.rollback(); });
    ASSERT_GE(after, before);
    ASSERT_LE(after, before + 1);
    if (after == before + 1) {
      ++forward_;
      ASSERT_LT(kind, 3);
      if (kind == 0)
        made(reference_, wire::Mode::kAdvance, false, number, {});
      else
        reference_.commit();
    }
    ASSERT_EQ(reference_.rollback(), after);
    std::vector<std::uint64_t> present = session_.node_ids, named;
    std::ranges::sort(present);
    const auto is_present = [&](std::uint64_t id) { return std::ranges::binary_search(present, id); };
    if (kind == 3) {
      std::ranges::copy_if(changed, std::back_inserter(named), is_present);
      if (!named.empty()) reference_.register_nodes(named);
    } else if (kind == 4) {
      std::ranges::copy_if(changed, std::back_inserter(named), [&](std::uint64_t id) { return !is_present(id); });
      if (!named.empty()) reference_.retire_nodes(named);
    }
    same_nodes();
    steps_ = number + 2;
  }

 public:
  std::uint64_t forward() const { return forward_; }

 private:
  Cluster& run_;
  Tally& tally_;
  Strategy strategy_;
  std::shared_ptr<int> left_;
  Client client_;
  Client reference_client_;
  Session session_;
  Session reference_;
  int steps_ = 0;
  bool succeeded_ = false;
  std::uint64_t forward_ = 0;
  std::vector<std::string> marks_;
};

// Two hosts on as many servers as the seed says. Adds the calls that successors have completed to `forward`.
void simulate_shards(unsigned seed, Tally& tally, std::uint64_t& forward) {
  SCOPED_TRACE("SHEARBUS_SEED=" + std::to_string(seed));
  constexpr unsigned kShards[] = {2, 3, 5, 1};
  try {
    Cluster run(seed, kShards[seed % 4], tally);
    const Strategy strategy = seed / 4 % 2 == 0 ? Strategy::kForceDriven : Strategy::kVelocityDriven;
    ShardedHost a(run, tally, 0, strategy), b(run, tally, 1, strategy);
    for (int i = 0; i < 30 && !::testing::Test::HasFailure(); ++i) run.chance(2) ? a.act(b) : b.act(a);
    if (::testing::Test::HasFailure()) return;
    forward += a.forward() + b.forward();
    a.close();
    b.close();
  } catch (const std::exception& fault) {
    ADD_FAILURE() << fault.what();
  }
}

// Seed 38 found a client that was superseded by a claim of its own, whose answer had been lost over two restarts. Seeds
// 358 and 773 found a segment that could not be read, and was told as an empty one that follows it.
TEST(Simulation, SeedsOfShardsThatOnceFoundABugFindNone) {
  Tally tally;
  std::uint64_t forward = 0;
  for (const unsigned seed : {38U, 358U, 773U}) simulate_shards(seed, tally, forward);
}

// The environment variables SHEARBUS_SEED and SHEARBUS_SEEDS are those of the simulation of one server.
TEST(Simulation, AnyNumberOfShardsAnswersAsOneServerToWhichNothingHappens) {
  const char* one = std::getenv("SHEARBUS_SEED");
  const char* many = std::getenv("SHEARBUS_SEEDS");
  const unsigned first = one != nullptr ? static_cast<unsigned>(std::strtoul(one, nullptr, 10)) : 1;
  const unsigned count = many != nullptr  ? static_cast<unsigned>(std::strtoul(many, nullptr, 10))
                         : one != nullptr ? 1
                                          : 30;
  Tally tally;
  std::uint64_t forward = 0;
  for (unsigned seed = first; seed < first + count && !HasFailure(); ++seed) simulate_shards(seed, tally, forward);
  std::cout << count << " seeds from " << first << ": " << tally.calls << " calls, " << tally.crashes << " crashes, "
            << tally.dropped << " messages lost, " << tally.successors << " clients died, " << forward
            << " of them in a call that their successor completed, " << tally.node_changes
            << " changes of the set of nodes, " << tally.moved << " nodes moved, " << tally.refused
            << " requests refused\n";
  EXPECT_GE(tally.crashes, count / 2);
  EXPECT_TRUE(forward > 0 || count < 20);
}

}  // namespace
}  // namespace shearbus::simulation
