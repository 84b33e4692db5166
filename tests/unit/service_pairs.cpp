// Sessions of several material pairs, and of nodes with parameters of their own.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "proto/scene/scene.hpp"
#include "server/service/pairs.hpp"
#include "server/service/scene_model.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Ids = std::vector<std::uint64_t>;

constexpr const char* kYield = "soft.yield_strength_pa";

constexpr const char* kPairs = R"(
[pair.lead.soft]
material = "aluminium_dlp"
yield_strength_pa = 20e6
thermal_conductivity_w_per_m_k = 35
[pair.thick.layer]
thickness_m = 35e-6
cells = 24
grading = 1.15
initial_temperature_k = 340
)";

std::string scene_with_pairs(Strategy strategy) {
  return support::text_of(support::scene_of(strategy)) + kPairs;
}

// A node's pair, by its place in {"", "lead", "thick"}, and its yield strength.
using Kind = std::pair<std::size_t, double>;
const std::vector<std::string> kNames = {"", "lead", "thick"};

wire::Batch new_nodes(const Ids& ids, const std::vector<Kind>& kinds, bool with_parameter = true) {
  std::vector<Field> fields = {Field::kNodeId, Field::kPair};
  if (with_parameter) fields.push_back(Field::kParameter);
  wire::Batch batch = wire::Batch::of(fields, ids.size());
  std::ranges::copy(ids, batch.u64(Field::kNodeId).begin());
  for (std::size_t i = 0; i < ids.size(); ++i) {
    batch.u64(Field::kPair)[i] = kinds[i].first;
    if (with_parameter) batch.f64(Field::kParameter)[i] = kinds[i].second;
  }
  return batch;
}

// The text of the scene of one kind of nodes alone.
std::string scene_alone(const std::string& effective, const Kind& kind) {
  const scene::SceneFile file = scene::parse(effective, "effective");
  v1::Scene whole =
      scene::scene_of_pair(scene::without_pairs(file.scene),
                           kind.first == 0 ? v1::Pair() : file.scene.pair(static_cast<int>(kind.first) - 1));
  scene::set_value(whole, kYield, kind.second);
  return scene::to_toml(whole);
}

// A session of several pairs, and beside it one session for each kind of nodes, which gets the same nodes. The answers
// of both have the same bits.
class Twins {
 public:
  Twins(Strategy strategy, unsigned threads) : strategy_(strategy), harness_(threads, {.nodes_per_task = 4}) {
    wire::Request opening = ServiceHarness::opening(scene_with_pairs(strategy), {});
    auto& body = std::get<wire::OpenSession>(opening.body);
    body.domain = "several";
    body.parameters = {kYield};
    opening.batch = {};
    const Answer opened = harness_.granted(opening);
    const auto& answer = std::get<wire::SessionOpened>(opened.reply.body);
    effective_ = answer.effective_scene;
    EXPECT_THAT(answer.pairs, ElementsAre("lead", "thick"));
    EXPECT_THAT(answer.parameters, ElementsAre(kYield));
  }

  void add(const Ids& ids, const std::vector<Kind>& kinds) {
    ok(1, wire::RegisterNodes{.pairs = kNames}, new_nodes(ids, kinds));
    for (std::size_t i = 0; i < ids.size(); ++i) {
      kind_of_[ids[i]] = kinds[i];
      ids_.push_back(ids[i]);
    }
    for (const auto& [kind, some] : by_kind(ids)) ok(alone(kind), wire::RegisterNodes{}, support::id_column(some));
  }
  void retire(const Ids& ids) {
    ok(1, wire::RetireNodes{}, support::id_column(ids));
    for (const auto& [kind, some] : by_kind(ids)) ok(alone(kind), wire::RetireNodes{}, support::id_column(some));
    for (const std::uint64_t id : ids) std::erase(ids_, id);
  }
  void move(const Ids& ids) {  // the nodes leave for an offer and come back, behind the others
    const auto go = [&](std::uint8_t session, const Ids& some) {
      wire::TransferId transfer{};
      transfer.fill(session);
      ok(session, wire::OfferNodes{transfer}, support::id_column(some));
      ok(session, wire::AcceptNodes{transfer});
    };
    go(1, ids);
    for (const auto& [kind, some] : by_kind(ids)) go(alone(kind), some);
    for (const std::uint64_t id : ids) std::erase(ids_, id);
    ids_.insert(ids_.end(), ids.begin(), ids.end());
  }
  void mark() {
    for (const auto& [kind, session] : sessions_) ok(session, wire::Mark{"here"});
    ok(1, wire::Mark{"here"});
    marked_ = {ids_, kind_of_, sessions_.size()};
  }
  void back() {
    if (marked_.ids.empty() || marked_.sessions != sessions_.size()) return;
    for (const auto& [kind, session] : sessions_) ok(session, wire::Rollback{"here"});
    ok(1, wire::Rollback{"here"});
    ids_ = marked_.ids;
    kind_of_ = marked_.kind_of;
  }
  void step(const Ids& ids, int number) {
    const auto ask = [&](std::uint8_t session, const Ids& some) {
      return ok(session, wire::Downscale{.dt_s = number % 3 == 0 ? 2e-9 : 1e-9},
                support::step_columns(strategy_, some, number, true));
    };
    const Answer together = ask(1, ids);
    const auto row_of = [&](std::uint64_t id) {
      return static_cast<std::size_t>(std::ranges::find(ids, id) - ids.begin());
    };
    for (const auto& [kind, some] : by_kind(ids)) {
      const Answer apart = ask(alone(kind), some);
      for (const wire::Column& column : apart.reply.batch.columns())
        for (std::size_t row = 0; row < some.size(); ++row) {
          if (column.element == wire::Element::kFloat64) {
            ASSERT_EQ(apart.reply.batch.f64(column.field)[row],
                      together.reply.batch.f64(column.field)[row_of(some[row])])
                << wire::name(column.field) << " of node " << some[row] << ", step " << number;
          } else {
            ASSERT_EQ(apart.reply.batch.u8(column.field)[row],
                      together.reply.batch.u8(column.field)[row_of(some[row])]);
          }
        }
    }
  }
  const Ids& ids() const { return ids_; }

 private:
  template <typename Body>
  Answer ok(std::uint8_t session, Body body, wire::Batch batch = {}) {
    wire::Request request = ServiceHarness::in_session(std::move(body), ++sequence_[session], session);
    request.batch = std::move(batch);
    return harness_.granted(request);
  }
  std::map<Kind, Ids> by_kind(const Ids& ids) const {
    std::map<Kind, Ids> kinds;
    for (const std::uint64_t id : ids) kinds[kind_of_.at(id)].push_back(id);
    return kinds;
  }
  std::uint8_t alone(const Kind& kind) {
    const auto [at, fresh] = sessions_.emplace(kind, static_cast<std::uint8_t>(10 + sessions_.size()));
    if (!fresh) return at->second;
    wire::Request opening = ServiceHarness::opening(scene_alone(effective_, kind), {}, at->second);
    std::get<wire::OpenSession>(opening.body).domain = "alone " + std::to_string(at->second);
    opening.batch = {};
    harness_.granted(opening);
    return at->second;
  }

  struct Marked {
    Ids ids;
    std::map<std::uint64_t, Kind> kind_of;
    std::size_t sessions = 0;
  };
  Strategy strategy_;
  ServiceHarness harness_;
  std::string effective_;
  std::map<std::uint8_t, std::uint64_t> sequence_;
  std::map<Kind, std::uint8_t> sessions_;
  std::map<std::uint64_t, Kind> kind_of_;
  Ids ids_;
  Marked marked_;
};

class Pairs : public testing::TestWithParam<std::tuple<Strategy, unsigned>> {};
INSTANTIATE_TEST_SUITE_P(Strategies, Pairs,
                         testing::Combine(testing::Values(Strategy::kVelocityDriven, Strategy::kForceDriven),
                                          testing::Values(1u, 3u)),
                         [](const auto& of) {
                           return std::string(std::get<0>(of.param) == Strategy::kVelocityDriven ? "VelocityDriven"
                                                                                                 : "ForceDriven") +
                                  "OnThreads" + std::to_string(std::get<1>(of.param));
                         });

TEST_P(Pairs, EachNodeHasTheBitsOfASessionOfItsPairAlone) {
  std::mt19937 random(5);
  Twins twins(std::get<0>(GetParam()), std::get<1>(GetParam()));
  std::uint64_t next = 1;
  std::size_t most = 0;
  const auto pick = [&](std::size_t count) {
    Ids picked = twins.ids();
    std::ranges::shuffle(picked, random);
    picked.resize(std::min(count, picked.size()));
    return picked;
  };
  for (int step = 0; step < 60; ++step) {
    const auto kind = step == 0 ? 0 : random() % 7;
    if (kind == 0) {
      Ids fresh(random() % 30 + 1);
      std::vector<Kind> kinds;
      for (std::uint64_t& id : fresh) {
        id = next++;
        kinds.emplace_back(random() % 3, 25e6 + 5e6 * static_cast<double>(random() % 3));
      }
      twins.add(fresh, kinds);
    } else if (kind == 1 && twins.ids().size() > 20) {
      twins.retire(pick(random() % 18 + 1));
    } else if (kind == 2 && !twins.ids().empty()) {
      twins.move(pick(random() % 9 + 1));
    } else if (kind == 3) {
      twins.mark();
    } else if (kind == 4) {
      twins.back();
    }
    most = std::max(most, twins.ids().size());
    const Ids asked = random() % 2 == 0 ? twins.ids() : pick(random() % 20 + 1);
    if (asked.empty()) continue;
    ASSERT_NO_FATAL_FAILURE(twins.step(asked, step));
  }
  EXPECT_GT(most, 40u);
}

// A node that was retired and came back with another pair is, after the rollback, what it was at the mark.
TEST(ServicePairs, ARollbackRestoresThePairsOfTheMark) {
  ServiceHarness harness;
  wire::Request opening = ServiceHarness::opening(scene_with_pairs(Strategy::kForceDriven), Ids{1, 2, 3});
  opening.batch = new_nodes({1, 2, 3}, {{0, 0}, {1, 0}, {2, 0}}, false);
  std::get<wire::OpenSession>(opening.body).pairs = kNames;
  harness.granted(opening);
  const auto step = [&](std::uint64_t sequence) {
    return harness.ask(ServiceHarness::step(sequence, support::step_columns(Strategy::kForceDriven, Ids{1, 2, 3}, 1)));
  };
  const auto change = [&](std::uint64_t sequence, auto body, wire::Batch batch) {
    wire::Request request = ServiceHarness::in_session(std::move(body), sequence);
    request.batch = std::move(batch);
    harness.granted(request);
  };
  change(1, wire::Mark{"start"}, {});
  const auto first = step(2).payload();
  change(3, wire::RetireNodes{}, support::id_column({1, 2, 3}));
  change(4, wire::RegisterNodes{.pairs = {"thick", "lead"}}, new_nodes({1, 2, 3}, {{0, 0}, {1, 0}, {1, 0}}, false));
  EXPECT_NE(step(5).payload(), first);
  change(6, wire::Rollback{"start"}, {});
  EXPECT_EQ(step(7).payload(), first);
}

// session_resumed tells the pairs and parameters of the nodes, in the order of their rows, whatever tiles they are in.
TEST(ServicePairs, AResumedSessionTellsPairsAndParameters) {
  ServiceHarness harness;
  wire::ResumeToken token{};
  token.fill(3);
  wire::Request opening = ServiceHarness::opening(scene_with_pairs(Strategy::kForceDriven), Ids{1});
  opening.batch = new_nodes({7, 8, 9}, {{1, 21e6}, {0, 22e6}, {2, 23e6}});
  auto& open = std::get<wire::OpenSession>(opening.body);
  open.pairs = kNames;
  open.parameters = {kYield};
  open.resume_token = token;
  harness.granted(opening);
  wire::Request more = ServiceHarness::in_session(wire::RegisterNodes{.pairs = {"lead"}}, 1);
  more.batch = new_nodes({4, 5}, {{0, 24e6}, {0, 25e6}});
  harness.granted(more);
  wire::Request fewer = ServiceHarness::in_session(wire::RetireNodes{}, 2);
  fewer.batch = support::id_column({7});
  harness.granted(fewer);
  wire::Request resume = ServiceHarness::in_session(wire::ResumeSession{.resume_token = token}, 0);
  const Answer answer = harness.granted(resume);
  const wire::Batch& told = answer.reply.batch;
  std::map<std::uint64_t, Kind> kind_of;
  for (std::size_t i = 0; i < told.u64(Field::kNodeId).size(); ++i)
    kind_of[told.u64(Field::kNodeId)[i]] = {told.u64(Field::kPair)[i], told.f64(Field::kParameter)[i]};
  const std::map<std::uint64_t, Kind> expected = {{4, {1, 24e6}}, {5, {1, 25e6}}, {8, {0, 22e6}}, {9, {2, 23e6}}};
  EXPECT_EQ(kind_of, expected);
  EXPECT_THAT(std::get<wire::SessionResumed>(answer.reply.body).session.pairs, ElementsAre("lead", "thick"));
}

TEST(ServicePairs, TheEffectiveSceneOfPairsIsThatSceneAgain) {
  for (const Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    const SceneModel made = scene_model(scene_with_pairs(strategy), "scene");
    ASSERT_EQ(made.pairs.size(), 2u);
    EXPECT_EQ(made.pairs[0].name, "lead");
    EXPECT_EQ(made.pairs[0].options.soft.yield_strength, 20e6);
    EXPECT_EQ(made.pairs[1].options.initial_temperature, 340.0);
    EXPECT_EQ(made.pairs[1].options.grid.thickness, 35e-6);
    EXPECT_EQ(scene_model(made.effective, "effective").effective, made.effective);
    EXPECT_THAT(made.effective, HasSubstr("\n[pair.lead]\n\n[pair.lead.soft]\nmaterial = \"aluminium_dlp\"\n"));
  }
}

std::string refusal_of(const std::string& pairs, Strategy strategy = Strategy::kForceDriven) {
  const wire::Status fault = support::fault_of(
      [&] { scene_model("# a scene\n" + support::text_of(support::scene_of(strategy)) + pairs, "scene.toml"); });
  EXPECT_TRUE(fault.ok() || fault.code == Code::kInvalidScene);
  return fault.text;
}

TEST(ServicePairs, APairMayDifferInConstantsOnly) {
  EXPECT_EQ(refusal_of(kPairs), "");
  EXPECT_THAT(refusal_of("[pair.a.layer]\ncells = 30\ngrading = 1.15\nthickness_m = 20e-6\n"),
              HasSubstr("pair.a.layer.cells differs from the scene's layer.cells"));
  EXPECT_THAT(refusal_of("[pair.a.layer]\ncells = 24\ngrading = 1.15\nthickness_m = 20e-6\nsleep = true\n"),
              HasSubstr("pair.a.layer.sleep differs"));
  EXPECT_THAT(
      refusal_of("[pair.a.interface]\nfriction_coefficient = 0.2\nyield_strength_pa = 1e8\nplastic_layer = true\n"),
      HasSubstr("pair.a.interface.plastic_layer differs"));
  EXPECT_THAT(refusal_of("[pair.a.junctions]\ncontact_fraction = 0.5\nheight_m = 1e-7\n"),
              HasSubstr("pair.a.junctions differs"));
  EXPECT_THAT(refusal_of("[pair.a.velocity_driven]\nfriction_coefficient = 0.2\n", Strategy::kVelocityDriven),
              HasSubstr("pair.a.velocity_driven.friction_coefficient differs"));
  EXPECT_THAT(refusal_of("[pair.a]\nstrategy = \"velocity_driven\"\n"),
              HasSubstr("pair.a.strategy is not a key of [pair.a]"));
}

TEST(ServicePairs, FaultsOfAPairAreCitedWhereTheyStand) {
  const std::string soft = "[pair.a.soft]\nmaterial = \"aluminium_dlp\"\n";
  EXPECT_THAT(
      refusal_of(soft + "yield_strength_pa = -1\n"),
      ::testing::MatchesRegex("scene.toml:[0-9]+:1: \\[pair.a\\]: soft.yield_strength_pa = -1 Pa is out of range.*"));
  EXPECT_THAT(refusal_of(soft + "yield_strenght_pa = 1\n"),
              HasSubstr("pair.a.soft.yield_strenght_pa is not a key of [pair.a.soft]"));
  EXPECT_THAT(refusal_of(soft + "yield_strength_pa = \"much\"\n"),
              HasSubstr("pair.a.soft.yield_strength_pa: expected a number in Pa"));
  EXPECT_THAT(refusal_of("[pair.a.interface]\nfriction_coefficient = 0.2\n"),
              HasSubstr("[pair.a]: interface.yield_strength_pa is missing"));
  EXPECT_THAT(refusal_of("[pair.a.soft]\nmaterial = \"unobtainium\"\n"), HasSubstr("[pair.a]: soft.material"));
  EXPECT_THAT(refusal_of("[pair.\"a b\"]\n"), HasSubstr("has no proper name"));
  EXPECT_THAT(refusal_of("[pair]\na = 1\n"), HasSubstr("pair.a is a table"));
  EXPECT_THAT(refusal_of("[[pair]]\n"), HasSubstr("pair holds tables with names"));
  std::string many;
  for (int i = 0; i < 257; ++i) many += "[pair.p" + std::to_string(i) + "]\n";
  EXPECT_THAT(refusal_of(many), HasSubstr("257 tables [pair.NAME], at most 256 are allowed"));
}

TEST(ServicePairs, AToleranceThatChoosesOtherCellsIsRefused) {
  v1::Scene scene = support::force_scene();
  scene.mutable_layer()->clear_cells();
  scene.mutable_layer()->clear_grading();
  scene.set_tolerance(1e-3);
  const std::string text = support::text_of(scene);
  EXPECT_NO_THROW(scene_model(text + "[pair.a.interface]\nfriction_coefficient = 0.1\nyield_strength_pa = 1e8\n", "s"));
  EXPECT_THAT(support::said_by<wire::Error>([&] { scene_model(text + "[pair.a.layer]\nthickness_m = 200e-6\n", "s"); }),
              HasSubstr("the tolerance chooses its cells by its constants"));
}

TEST(ServicePairs, AWarningOfAPairNamesItAndANoteStaysANote) {
  const std::string text = support::text_of(support::force_scene());
  const SessionPairs made(
      scene_model(text + "[pair.a.layer]\nthickness_m = 30e-6\ncells = 24\ngrading = 1.15\n", "scene"), {});
  EXPECT_THAT(made.warnings(), ::testing::Contains(::testing::StartsWith("note: [pair.a]: the far face is insulated")));
  const SessionPairs soft(
      scene_model(text + "[pair.a.soft]\nmaterial = \"aluminium_dlp\"\nyield_strength_pa = 400e6\n", "scene"), {});
  EXPECT_THAT(soft.warnings(), ::testing::Contains(::testing::StartsWith("[pair.a]: the hard body's yield strength")));
}

// Requests about new nodes at fault, each refused with nothing changed.
TEST(ServicePairs, AParameterInAnotherUnitIsNamedWithItsFirstNode) {
  ServiceHarness harness;
  for (const double value : {25e6, 25.0}) {
    wire::Request opening =
        ServiceHarness::opening(scene_with_pairs(Strategy::kForceDriven), Ids{1}, value == 25.0 ? 2 : 1);
    opening.batch = new_nodes({7, 8}, {{0, 25e6}, {0, value}});
    std::get<wire::OpenSession>(opening.body).pairs = {""};
    std::get<wire::OpenSession>(opening.body).parameters = {kYield};
    const Answer answer = harness.granted(opening);
    EXPECT_EQ(std::ranges::count(std::get<wire::SessionOpened>(answer.reply.body).warnings,
                                 "soft.yield_strength_pa of node 8 = 25 Pa is unusual: values from 1e5 to 5e10 Pa are "
                                 "expected. Is it in Pa?"),
              value == 25.0 ? 1 : 0);
  }
}

TEST(ServicePairs, AnInitialTemperatureInCelsiusIsNamedWithItsFirstNode) {
  ServiceHarness harness;
  for (const double value : {300.0, 27.0}) {
    wire::Request opening =
        ServiceHarness::opening(scene_with_pairs(Strategy::kForceDriven), Ids{1}, value > 100 ? 2 : 1);
    opening.batch = wire::Batch::of(std::array{Field::kNodeId, Field::kInitialTemperature}, 2);
    std::ranges::copy(Ids{7, 8}, opening.batch.u64(Field::kNodeId).begin());
    std::ranges::copy(std::array{300.0, value}, opening.batch.f64(Field::kInitialTemperature).begin());
    const Answer answer = harness.ask(opening);
    ASSERT_TRUE(answer.reply.status.ok()) << answer.reply.status.text;
    EXPECT_EQ(std::ranges::count(std::get<wire::SessionOpened>(answer.reply.body).warnings,
                                 "initial_temperature_k of node 8 = 27 K is unusual: values from 50 to 3000 K are "
                                 "expected. Is it in K?"),
              value == 27.0 ? 1 : 0);
  }
}

TEST(ServicePairs, FaultyPairsAndParametersOfNodesAreRefused) {
  ServiceHarness harness;
  const auto open = [&](std::vector<std::string> pairs, std::vector<std::string> parameters, wire::Batch batch,
                        const std::string& scene = scene_with_pairs(Strategy::kForceDriven)) {
    wire::Request opening = ServiceHarness::opening(scene, Ids{1});
    opening.batch = std::move(batch);
    std::get<wire::OpenSession>(opening.body).pairs = std::move(pairs);
    std::get<wire::OpenSession>(opening.body).parameters = std::move(parameters);
    return harness.ask(opening).reply.status;
  };
  const auto two = [](std::uint64_t pair, double value) { return new_nodes({7, 8}, {{0, 25e6}, {pair, value}}); };
  const auto expect = [](const wire::Status& status, Code code, const std::string& field, const std::string& text) {
    EXPECT_EQ(status.code, code) << status.text;
    EXPECT_EQ(status.field, field);
    EXPECT_THAT(status.text, HasSubstr(text));
  };
  expect(open({"lead"}, {kYield}, two(1, 25e6)), Code::kInvalidValue, "pair",
         "pair of node 8 is 1; expected a place from 0 to 0");
  expect(open({"", "tin"}, {kYield}, two(1, 25e6)), Code::kInvalidValue, "pairs",
         "the scene has no pair \"tin\"; it has lead, thick");
  EXPECT_THAT(open({"", "tin"}, {kYield}, two(1, 25e6)).node_ids, ElementsAre(8)) << "the first node that names it";
  expect(open({}, {kYield}, two(0, 25e6)), Code::kShape, "pair", "without a list");
  expect(open({""}, {}, support::id_column({7})), Code::kShape, "pair", "has no column pair");
  expect(open({""}, {}, two(0, 25e6)), Code::kShape, "parameter", "the session has 0 parameters");
  expect(open({""}, {kYield}, two(0, -1.0)), Code::kInvalidValue, kYield,
         "parameters of node 8: soft.yield_strength_pa = -1 Pa is out of range");
  expect(open({""}, {kYield}, two(0, std::nan(""))), Code::kInvalidValue, kYield,
         "soft.yield_strength_pa of node 8 is not a finite number");
  expect(open({""}, {"layer.cells"}, two(0, 1.0)), Code::kUnsupported, "open_session.parameters",
         "layer.cells cannot be a parameter");
  expect(open({""}, {"interface.friction_coeficient"}, two(0, 1.0)), Code::kUnsupported, "open_session.parameters",
         "did you mean \"interface.friction_coefficient\"?");
  expect(open({""}, {"layer.initial_temperature_k"}, two(0, 1.0)), Code::kUnsupported, "open_session.parameters",
         "cannot be a parameter");
  expect(open({""}, {kYield, kYield}, two(0, 25e6)), Code::kInvalidValue, "open_session.parameters", "given twice");
  expect(open({""}, {"junctions.height_m"}, two(0, 1.0)), Code::kInvalidScene, "junctions.height_m",
         "the scene has no such key");
  expect(open({""}, {}, new_nodes({7, 8}, {{0, 0}, {0, 0}}, false), support::text_of(support::force_scene())),
         Code::kShape, "pair", "in a session of one pair");
  EXPECT_EQ(harness.service.status().sessions, 0u);

  wire::Request opening = ServiceHarness::opening(support::text_of(support::force_scene()), Ids{1});
  harness.granted(opening);
  wire::Request more = ServiceHarness::in_session(wire::RegisterNodes{.pairs = {"lead"}}, 1);
  more.batch = support::id_column({9});
  expect(harness.ask(more).reply.status, Code::kInvalidValue, "pairs", "the scene has no [pair.NAME]");
}

}  // namespace
}  // namespace shearbus::service
