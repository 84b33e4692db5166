// Changes of a session's set of nodes, and steps without nodes, when the server dies and restarts in between.
#include <gtest/gtest.h>

#include "tests/durability/deaths.hpp"

namespace shearbus::service {
namespace {

using Ids = std::vector<std::uint64_t>;

constexpr const char* kYield = "soft.yield_strength_pa";
constexpr const char* kPairs =
    "[pair.weak.soft]\nmaterial = \"aluminium_dlp\"\nyield_strength_pa = 20e6\n"
    "[pair.thick.layer]\nthickness_m = 35e-6\ncells = 24\ngrading = 1.15\n";

// Nodes of three pairs and two yield strengths, which follow from their ids.
wire::Batch of_pairs(const Ids& ids) {
  wire::Batch batch = wire::Batch::of(std::vector{Field::kNodeId, Field::kPair, Field::kParameter}, ids.size());
  std::ranges::copy(ids, batch.u64(Field::kNodeId).begin());
  for (std::size_t i = 0; i < ids.size(); ++i) {
    batch.u64(Field::kPair)[i] = ids[i] % 3;
    batch.f64(Field::kParameter)[i] = ids[i] % 2 == 0 ? 30e6 : 40e6;
  }
  return batch;
}

struct Case {
  Strategy strategy;
  bool pairs;  // the scene has several pairs, and the nodes a parameter
};

// Returns the requests of two sessions of a domain. The first session offers nodes, retires nodes, registers nodes and
// rolls back to a mark. The second session accepts the offered nodes.
std::vector<wire::Request> conversation(const Case& of) {
  const Strategy strategy = of.strategy;
  const std::string scene = support::text_of(support::scene_of(strategy)) + (of.pairs ? kPairs : "");
  const std::vector<std::string> names = {"thick", "", "weak"};
  std::vector<wire::Request> all;
  std::map<std::uint8_t, std::uint64_t> last;
  const auto open = [&](std::uint8_t session, const Ids& ids) {
    all.push_back(ServiceHarness::opening(scene, ids, session));
    auto& body = std::get<wire::OpenSession>(all.back().body);
    if (of.pairs) {
      body.parameters = {kYield};
      if (!ids.empty()) body.pairs = names;
      all.back().batch = of_pairs(ids);
    }
    body.domain = "run";
    body.resume_token.fill(9);
    if (ids.empty()) all.back().batch = {};
  };
  const auto ask = [&](std::uint8_t session, auto body, wire::Batch batch = {}) {
    all.push_back(ServiceHarness::in_session(std::move(body), ++last[session], session));
    all.back().batch = std::move(batch);
  };
  const auto step = [&](std::uint8_t session, const Ids& ids, bool some = false) {
    const int number = static_cast<int>(all.size());
    ask(session, wire::Downscale{.dt_s = 1e-9}, support::step_columns(strategy, ids, number, some));
  };
  wire::TransferId first{}, second{}, third{};
  first.fill(1), second.fill(2), third.fill(3);
  open(1, {1, 2, 3, 4, 5, 6, 7, 8, 9});
  open(2, {});
  step(2, {});
  step(1, {1, 2, 3, 4, 5, 6, 7, 8, 9});
  ask(1, wire::Mark{"start"});
  ask(1, wire::OfferNodes{first}, support::id_column({8, 2}));
  step(1, {1, 3, 4, 5, 6, 7, 9});
  ask(2, wire::AcceptNodes{first});
  step(2, {8, 2});
  if (of.pairs)
    ask(2, wire::RegisterNodes{.pairs = names}, of_pairs({20, 21}));
  else
    ask(2, wire::RegisterNodes{}, support::id_column({20, 21}));
  step(2, {8, 2, 20, 21});
  ask(1, wire::RetireNodes{}, support::id_column({1, 9}));
  step(1, {5, 3}, true);
  step(1, {}, true);
  ask(2, wire::RetireNodes{}, support::id_column({2, 8}));
  ask(1, wire::OfferNodes{second}, support::id_column({3}));
  ask(1, wire::OfferNodes{third}, support::id_column({7}));
  ask(1, wire::AcceptNodes{third});
  step(1, {4, 5, 6, 7});
  ask(1, wire::Rollback{"start"});
  step(1, {1, 2, 3, 4, 5, 6, 7, 8, 9});
  step(2, {20, 21});
  return all;
}

class NodesOver : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Strategies, NodesOver,
                         testing::Values(Case{Strategy::kVelocityDriven, false}, Case{Strategy::kForceDriven, false},
                                         Case{Strategy::kVelocityDriven, true}, Case{Strategy::kForceDriven, true}),
                         [](const auto& of) {
                           return std::string(of.param.strategy == Strategy::kVelocityDriven ? "VelocityDriven"
                                                                                             : "ForceDriven") +
                                  (of.param.pairs ? "WithPairs" : "");
                         });

TEST_P(NodesOver, AServerThatDiesAfterEveryRequestLosesNoneAndHasNoneTwice) {
  expect_deaths_change_nothing(conversation(GetParam()), [](const Answer& answer) { return answer.payload(); });
}

// Nodes go to a session of the same scene with the same parameters only.
TEST(PairsOver, NodesDoNotMoveToASessionOfOtherParameters) {
  MemoryStorage disk;
  DurableServer server(disk);
  const auto requests = conversation({Strategy::kForceDriven, true});
  for (const wire::Request& request : requests) {
    if (std::holds_alternative<wire::AcceptNodes>(request.body)) break;
    ASSERT_EQ(server.ask(request).code(), Code::kOk);
  }
  wire::Request other =
      ServiceHarness::opening(support::text_of(support::scene_of(Strategy::kForceDriven)) + kPairs, Ids{}, 3);
  std::get<wire::OpenSession>(other.body).domain = "run";
  other.batch = {};
  ASSERT_EQ(server.ask(other).code(), Code::kOk);
  wire::TransferId first{};
  first.fill(1);
  EXPECT_EQ(server.ask(ServiceHarness::in_session(wire::AcceptNodes{first}, 1, 3)).code(), Code::kOtherScene);
}

// A checkpoint pads texts with zeros. Two names that differ only in zeros at their ends would become one name in a
// checkpoint, and two domains one domain, in which a node could have two owners.
TEST(Names, WithControlCharactersAreRefusedWhereverANameComesIn) {
  MemoryStorage disk;
  const Ids ids = {1, 2};
  const auto open = [&](DurableServer& server, std::uint8_t session, const std::string& domain,
                        const char* name = "s") {
    v1::Scene scene = support::scene_of(Strategy::kVelocityDriven);
    scene.set_name(name);
    wire::Request request = ServiceHarness::opening(scene, ids, session);
    std::get<wire::OpenSession>(request.body).domain = domain;
    return server.ask(request).code();
  };
  const std::vector<std::string> bad = {
      std::string("run\0", 4), std::string("r\0un", 4), "run\n", "\trun", "run\x7f", "run\xc2\x85"};
  {
    DurableServer server(disk);
    ASSERT_EQ(open(server, 1, "run"), Code::kOk);
    std::uint64_t sequence = 0;
    for (const std::string& name : bad) {
      EXPECT_EQ(open(server, 2, name), Code::kInvalidValue) << name;
      EXPECT_EQ(server.ask(ServiceHarness::in_session(wire::Mark{name}, sequence + 1)).code(), Code::kInvalidValue);
      EXPECT_EQ(server.ask(ServiceHarness::in_session(wire::Hello{.client_name = name}, 0)).code(),
                Code::kInvalidValue);
    }
    EXPECT_EQ(open(server, 2, "", "run\n"), Code::kInvalidScene);
    EXPECT_EQ(open(server, 2, "", "r\x01un"), Code::kInvalidScene);
    EXPECT_EQ(server.ask(ServiceHarness::in_session(wire::Mark{"dépôt"}, ++sequence)).code(), Code::kOk);
    ASSERT_TRUE(server.service.checkpoint());
  }
  DurableServer server(disk);
  EXPECT_EQ(open(server, 2, bad[0]), Code::kInvalidValue);
  EXPECT_NE(open(server, 2, "run"), Code::kOk) << "the nodes have their owner still";
}

}  // namespace
}  // namespace shearbus::service
